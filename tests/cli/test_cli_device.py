"""`--device`: `cuda` where something is missing is one line that says what, `auto` goes on and says why."""

import json

import pytest
from typer.testing import CliRunner

from rpaug.cli import app, checks
from rpaug.core import devices, registry
from rpaug.core.devices import DevicePart


@pytest.fixture
def bare(monkeypatch):
    """A machine without a GPU, whatever this one has."""
    lacking = DevicePart("GPU driver", "", "no NVIDIA driver", "one for this GPU")
    monkeypatch.setattr(devices, "_driver", lambda: lacking)


@pytest.mark.parametrize("command", ["fit", "augment"])
def test_cuda_where_it_cannot_be_is_one_line(bare, tmp_path, command):
    recipe = ["--recipe", "light_color"] if command == "augment" else []
    out = tmp_path / "out"
    arguments = [command, str(registry.SAMPLE), *recipe, "--out", str(out), "--device", "cuda"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert "--device cuda: no NVIDIA driver; mend it: one for this GPU" in " ".join(
        result.stderr.split()
    )
    assert not out.exists()


def test_a_fit_says_what_fitted_and_why(bare, tmp_path):
    arguments = ["fit", str(registry.SAMPLE), "--out", str(tmp_path / "s"), "--steps", "1"]
    result = CliRunner().invoke(app, [*arguments, "--json"])
    assert result.exit_code == 0, result.stderr
    told = json.loads(result.stdout)["device"]
    assert told == {"fits": "cpu", "why": "no NVIDIA driver; mend it: one for this GPU"}


def test_doctor_has_a_line_for_each_part_with_what_mends_it(bare):
    found = {check.topic: check for check in checks._gpu()}
    assert list(found) == ["GPU driver", "torch with CUDA", "gsplat", "gsplat's kernels", "GPU"]
    assert found["GPU driver"].level == "note"
    assert "mend it: one for this GPU" in found["GPU driver"].message
    assert "none is needed" in found["GPU"].message
