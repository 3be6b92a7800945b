"""Runs a script under somebody else's reader, in a process of its own without rpaug, and returns what it says."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent


def reader(name: str) -> Path:
    """A folder or program of `RPAUG_READERS` (docs/readers.md). Without that variable a skip; with it, one that is
    missing fails: no reader is left out in silence."""
    if "RPAUG_READERS" not in os.environ:
        pytest.skip(f"RPAUG_READERS is not set: no {name} here (docs/readers.md)")
    path = Path(os.environ["RPAUG_READERS"]) / name
    if not path.exists():
        pytest.fail(f"{path} is not there (docs/readers.md)")
    return path


def run(
    python: Path, script: str, *arguments: object, options: tuple[str, ...] = (), **environment: str
) -> dict[str, Any]:
    """What `script`, beside this file, prints as JSON in its last line. It sees no GPU and goes to no network."""
    alone = {"PATH": os.environ["PATH"], "CUDA_VISIBLE_DEVICES": "", "HF_HUB_OFFLINE": "1"}
    done = subprocess.run(
        [python, *options, HERE / script, *map(str, arguments)],
        env=alone | {"OMP_NUM_THREADS": "1"} | environment,
        capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    stated = json.loads(done.stdout.splitlines()[-1])
    assert not stated["rpaug"]
    return stated
