"""What a command imports: help no library of numbers or images, edits of images no torch, workers included."""

import inspect
import os
import subprocess
import sys
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path

import pytest

from rpaug.cli import COMMANDS, GROUPS

HEAVY = {
    "av",
    "cv2",
    "google_crc32c",
    "h5py",
    "jaxtyping",
    "mujoco",
    "numba",
    "numpy",
    "pycolmap",
    "torch",
    "transformers",
    "trimesh",
    "yaml",
    "zarr",
}
RECOLOR = "{version: 1, edits: [{op: recolor, target: {role: manipulated}, color: blue}]}"
CAMERA = "{version: 1, edits: [{op: camera_pose, camera: front}]}"


def imported(*arguments: object) -> set[str]:
    """The packages that a command and the processes it starts import."""
    done = subprocess.run(
        [sys.executable, "-m", "rpaug", *map(str, arguments)],
        env={**os.environ, "PYTHONPROFILEIMPORTTIME": "1"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    lines = done.stderr.splitlines()
    names = {line.split("|")[-1].strip() for line in lines if line.startswith("import time:")}
    assert done.returncode == 0, [line for line in lines if not line.startswith("import time:")]
    assert "rpaug.cli" in names
    return {name.split(".")[0] for name in names}


@pytest.mark.parametrize("command", [(), ("inspect",), ("augment",), ("bench", "tiers")])
def test_help_imports_nothing_heavy(command: tuple[str, ...]) -> None:
    assert not HEAVY & imported(*command, "--help")


@pytest.mark.parametrize("commands", [COMMANDS, *(inner for _, inner in GROUPS.values())])
def test_the_list_says_what_each_command_says(commands: Mapping[str, tuple[str, str]]) -> None:
    for name, (module, words) in commands.items():
        function = getattr(import_module(f"rpaug.cli.{module}"), name.replace("-", "_"))
        assert words == (inspect.getdoc(function) or "").split("\n\n")[0], name


@pytest.mark.parametrize(
    ("recipe", "tier", "workers"), [(RECOLOR, 0, 1), (RECOLOR, 0, 2), (CAMERA, 1, 1)]
)
def test_edits_of_images_never_import_torch(
    tmp_path: Path, recipe: str, tier: int, workers: int
) -> None:
    (tmp_path / "recipe.yaml").write_text(recipe)
    out = tmp_path / "out"
    given = ("--recipe", tmp_path / "recipe.yaml", "--tier", tier, "--workers", workers)
    found = imported("augment", "sample", *given, "--out", out)
    assert "numba" in found  # the images were made, in this process or in a worker
    assert "torch" not in found
    assert list(out.rglob("rpaug.json"))
    assert "torch" not in imported("verify", out, "--against", "sample")


@pytest.mark.parametrize(
    "command",
    [
        ("inspect", "sample"),
        ("ask", "sample", "make the drawer blue"),
        ("convert", "sample", "--to", "rdt", "--out", "{out}"),
    ],
    ids=lambda command: command[0],
)
def test_looking_asking_and_converting_never_import_torch(
    tmp_path: Path, command: tuple[str, ...]
) -> None:
    given = [word.format(out=tmp_path / "out") for word in command]
    assert "torch" not in imported(*given)
