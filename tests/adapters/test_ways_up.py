"""Datasets and outputs are found by paths that go up, whatever the layout."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rpaug.cli import app

LIGHT = {"version": 1, "edits": [{"op": "light_color"}]}


@pytest.mark.parametrize("layout", ["rlds", "rdt", "lerobot", "hdf5_sim"])
def test_a_path_may_go_up(
    layout: str, template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    Path("r.yaml").write_text(json.dumps(LIGHT))
    for line in (
        f"convert {template} --to {layout} --out ../data --fps 10",
        "inspect ../data",
        "augment ../data --recipe r.yaml --out ../out",
        "verify ../out --against ../data",
    ):
        done = CliRunner().invoke(app, line.split())
        assert done.exit_code == 0, (line, done.output)
