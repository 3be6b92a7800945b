"""Importing what a wish is asked by brings nothing heavy: that waits for the first wish."""

import subprocess
import sys

import pytest

HEAVY = (
    "torch",
    "numba",
    "cv2",
    "trimesh",
    "mujoco",
    "scipy",
    "h5py",
    "zarr",
    "av",
    "transformers",
)
STARTED = "import {module}, sys; print(sorted(set({heavy}) & set(sys.modules)))"


@pytest.mark.parametrize("name", ["asking", "rounds", "messages", "prompting"])
def test_an_import_without_a_model_brings_nothing_heavy(name: str) -> None:
    code = STARTED.format(module=f"rpaug.language.{name}", heavy=HEAVY)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_what_is_heavy_would_be_seen() -> None:
    code = STARTED.format(module="rpaug.language.manager", heavy=HEAVY)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "numba" in done.stdout
