"""`rpaug scenes`: listing, removing and exporting stored scenes, from the outside."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from analytic import scene as analytic_scene
from typer.testing import CliRunner

from rpaug.cli import app, progress
from rpaug.core.types import Scene
from rpaug.gaussians import ply, store
from rpaug.gaussians.seeds import seeds


@pytest.fixture(scope="module")
def lifted() -> Scene:
    bare = analytic_scene({"front": (1.6, 0.3, 1.0), "overhead": (0.1, -0.9, 1.5)}, length=2)
    return replace(bare, gaussians=seeds(bare))


@pytest.fixture
def folder(tmp_path: Path, lifted: Scene) -> Path:
    for name in ("aaa1", "bbb2"):
        store.save(tmp_path / "scenes", name, lifted, settings={}, report={"train_db": 31.5})
    return tmp_path / "scenes"


def run(*arguments: object) -> tuple[int, str]:
    made = CliRunner().invoke(app, ["scenes", *map(str, arguments)])
    return made.exit_code, made.output


def test_ls(folder: Path, lifted: Scene) -> None:
    assert lifted.gaussians is not None
    code, text = run("ls", folder, "--json", "--check")
    rows = json.loads(text)
    assert code == 0
    assert [row["key"] for row in rows] == ["aaa1", "bbb2"]
    assert rows[0]["gaussians"] == len(lifted.gaussians)
    assert rows[0]["decibels"] == 31.5
    code, text = run("ls", folder)
    assert "31.50 dB" in text
    assert "2 scenes in" in text


def test_damage_is_listed_and_can_be_removed(folder: Path) -> None:
    facts = folder / "aaa1.zarr" / "zarr.json"
    facts.write_text(facts.read_text().replace('"motion": "static"', '"motion": "link"'))
    code, text = run("ls", folder, "--json")
    assert code == 1
    assert "wrong checksum" in json.loads(text)[0]["damaged"]
    assert run("rm", folder, "aaa") == (0, "removed aaa1\n")
    assert store.names(folder) == ["bbb2"]


def test_rm_of_a_wrong_key_removes_nothing(folder: Path) -> None:
    code, text = run("rm", folder, "aaa1", "zzz", "--json")
    assert code == 2
    assert "no such scene" in json.loads(text)["error"]
    assert store.names(folder) == ["aaa1", "bbb2"]


def test_export(folder: Path, lifted: Scene, tmp_path: Path) -> None:
    assert lifted.gaussians is not None
    out = tmp_path / "a.ply"
    code, text = run("export", folder, "aaa", out, "--json")
    assert code == 0
    assert json.loads(text)["gaussians"] == len(lifted.gaussians)
    made = ply.read(out)
    np.testing.assert_array_equal(made.ids, lifted.gaussians.ids)
    instance_id = int(made.ids[0])
    run("export", folder, "aaa", tmp_path / "b.ply", "--handle", instance_id, "--frame", 1)
    assert set(ply.read(tmp_path / "b.ply").ids.tolist()) == {instance_id}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--frame", "2"), "this scene has frames 0 to 1"),
        (("--handle", "4"), "no Gaussian has instance id"),
    ],
)
def test_export_says_what_is_wrong(
    folder: Path, tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    code, text = run("export", folder, "aaa", tmp_path / "a.ply", "--json", *arguments)
    assert code == 2
    assert message in json.loads(text)["error"]
    assert not (tmp_path / "a.ply").exists()


def test_an_export_in_the_way_is_kept(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text("mine")
    assert run("export", folder, "aaa", tmp_path / "a.ply")[0] == 2
    assert (tmp_path / "a.ply").read_text() == "mine"


def test_reading_and_exporting_are_counted(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "EVERY", 0.0)
    told = CliRunner().invoke(app, ["scenes", "ls", str(folder), "--check"]).stderr
    assert "reading: 1 of 2; about" in told
    given = ["scenes", "export", str(folder), "aaa", str(tmp_path / "a.ply")]
    assert "exporting: 1 of 2; about" in CliRunner().invoke(app, given).stderr
