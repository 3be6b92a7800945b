"""A small share of `tools/fuzz`: spoilt datasets are read or refused by name, and never crash, hang or run code."""

import subprocess
import sys
from pathlib import Path

import pytest

RUN = Path(__file__).parents[2] / "tools/fuzz/run.py"


def test_spoilt_datasets_are_refused_by_name() -> None:
    pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")
    done = subprocess.run(
        [sys.executable, RUN, "--cases", "600"],
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    assert "600 cases, 0 wrong" in done.stdout
