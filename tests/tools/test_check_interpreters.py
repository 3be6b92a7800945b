"""The other Pythons that the wheel is tried under: which are found, and what is said where torch is not to be had."""

import json
import subprocess
import sys

import pytest

from tools import check_interpreters


def answering(
    monkeypatch: pytest.MonkeyPatch, code: int, needs: list[str], said: str = ""
) -> tuple[str | None, str]:
    """What comes of torch where pip answers so."""
    report = json.dumps({"install": [{"metadata": {"requires_dist": needs}}]})
    done = subprocess.CompletedProcess([], code, report, said)
    monkeypatch.setattr(check_interpreters, "run", lambda *_: done)
    return check_interpreters.torch_for_cpu(["pip"])


def test_torch_that_brings_cuda_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    torch, said = answering(monkeypatch, 0, ["numpy", "nvidia-cudnn-cu13==9.20.0.48"])
    assert torch is None
    assert "gigabytes" in said
    assert answering(monkeypatch, 0, ["numpy"])[0] == check_interpreters.TORCH
    torch, said = answering(monkeypatch, 1, [], "ERROR: none\nERROR: No matching distribution")
    assert (torch, said) == (None, "without torch: ERROR: No matching distribution")


def test_a_python_is_found_by_its_version(monkeypatch: pytest.MonkeyPatch) -> None:
    own = f"{sys.version_info.major}.{sys.version_info.minor}"
    assert check_interpreters.found(own)
    assert check_interpreters.found("3.99") is None
    monkeypatch.setattr(check_interpreters, "found", lambda version: None)
    well, said = check_interpreters.outcome("3.99", None, None)
    assert (well, said) == (True, "not checked, none is installed")


def test_all_that_the_wheel_needs_but_torch_is_asked_for() -> None:
    names = check_interpreters.needed()
    assert any(name.startswith("numpy") for name in names)
    assert not any(name.startswith("torch") for name in names)
