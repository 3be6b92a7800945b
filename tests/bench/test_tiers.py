"""Tiers on the twin: moved cameras keep their own recording, which is shown unchanged beside the others."""

import json

import pytest
from typer.testing import CliRunner

from tools.bench.tiers import app

pytestmark = pytest.mark.gl


def test_the_command_takes_recordings_together(tmp_path) -> None:
    asked = ["--twin", "push_button", "--seeds", "2", "--frames", "13", "--every", "9", "--json"]
    methods = ["--method", "recorded image unchanged", "--method", "surfels"]
    done = CliRunner().invoke(app, [*asked, *methods, "--out", str(tmp_path / "o")])
    assert done.exit_code == 0, done.output
    unchanged, surfels = json.loads(done.stdout)["rows"]
    assert (unchanged["method"], unchanged["recordings"]) == ("recorded image unchanged", 2)
    assert surfels["covisible_db"] > unchanged["covisible_db"] + 5
    assert surfels["views"] == unchanged["views"]
