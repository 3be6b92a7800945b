"""`--arm`: links of an arm that rpaug does not know, by a file of the user's."""

import json
from pathlib import Path
from typing import Any

import pytest
from arm_files import panda_mjcf, panda_urdf
from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.core.registry import SAMPLE
from rpaug.scene.tracking import arms

EDIT = "{version: 1, edits: [{op: recolor, target: {role: robot}, color: blue}]}"


def given(*asked: Any) -> tuple[int, dict[str, Any]]:
    done = CliRunner().invoke(app, [*map(str, asked), "--json"])
    return done.exit_code, json.loads(done.stdout)


@pytest.fixture
def unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if the sample's arm were one whose measures are not built in."""
    monkeypatch.setattr(arms, "KNOWN", ())


@pytest.mark.parametrize("name", ["panda.urdf", "panda.xml"])
@pytest.mark.usefixtures("unknown")
def test_inspect_finds_the_links_of_a_file(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(panda_urdf() if name.endswith("urdf") else panda_mjcf())

    def links(*more: Any) -> int:
        code, found = given("inspect", SAMPLE, *more)
        assert code == 0
        assert found["arms"] == []
        return sum(one["motion"] == "link" for one in found["instances"])

    assert links() == 0
    assert links("--arm", path) >= 3


@pytest.mark.usefixtures("unknown")
def test_a_recipe_keeps_the_arm_for_whoever_replays_it(tmp_path: Path) -> None:
    path, recipe = tmp_path / "panda.urdf", tmp_path / "recipe.yaml"
    path.write_text(panda_urdf())
    recipe.write_text(EDIT)
    code, found = given(
        "augment", SAMPLE, "--recipe", recipe, "--out", tmp_path / "o", "--arm", path
    )
    assert code == 0, found
    (report,) = (tmp_path / "o").rglob("rpaug.json")
    assert json.loads(report.read_bytes())["recipe"]["arms"] == [str(path)]


def test_files_that_do_not_fit_are_told(tmp_path: Path) -> None:
    recipe, path = tmp_path / "recipe.yaml", tmp_path / "arm.urdf"
    recipe.write_text(EDIT)
    asked = ("augment", SAMPLE, "--recipe", recipe, "--out", tmp_path / "o", "--arm", path)
    code, found = given(*asked)
    assert code == 2
    assert "arm.urdf" in found["error"]
    path.write_text(panda_urdf().replace('<axis xyz="0 0 2"/>', '<axis xyz="0 2 0"/>'))
    code, found = given("inspect", SAMPLE, "--arm", path)
    assert code == 0
    assert "arm.urdf: this arm is not used: its gripper is" in found["arms"][0]
