"""examples/glow, an operator as a package of its own, installed by pip: planned, asked for and followed like ours."""

import json
import pickle
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from third_party import ROOT, commands, install, own_tests

SAMPLE = ROOT / "rpaug/sample"
WISH = "make the azure thing glow violet by at least 80%"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder into which pip put the package."""
    return install("glow", tmp_path_factory.mktemp("glow"))


@pytest.fixture(scope="module")
def done(installed: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What came of each command over the sample, whose instruction calls a thing by its color."""
    folder = tmp_path_factory.mktemp("used")
    shutil.copytree(SAMPLE, folder / "data")
    (told,) = (folder / "data").rglob("variation_descriptions.pkl")
    told.write_bytes(pickle.dumps(["touch the azure thing"]))
    edit = {"op": "glow", "target": "azure thing", "color": "violet", "least": 0.8}
    (folder / "glow.yaml").write_text(json.dumps({"version": 1, "edits": [edit]}))
    recipe, data, out = (str(folder / name) for name in ("glow.yaml", "data", "out"))
    given = {
        "validate": ["validate-recipe", recipe, "--json"],
        "schema": ["validate-recipe", "--schema"],
        "plan": ["augment", data, "--recipe", recipe, "--out", out, "--dry-run", "--json"],
        "ask": ["ask", data, WISH, "--json"],
        "augment": ["augment", data, "--recipe", recipe, "--out", out, "--json"],
    }
    found = dict(zip(given, commands(installed, list(given.values())), strict=True))
    assert all(code == 0 for code, _ in found.values()), found
    return {"folder": folder, **{name: json.loads(text) for name, (_, text) in found.items()}}


def test_recipes_know_it(done: dict[str, Any]) -> None:
    assert done["validate"]["valid"]
    assert "least" in done["schema"]["$defs"]["op_glow"]["properties"]


def test_it_is_planned_by_what_it_declares(done: dict[str, Any]) -> None:
    (plan,) = done["plan"]["plans"]
    assert plan["bodies"]
    assert set(plan["carriers"].values()) == {"tier 0, recorded pixels"}


def test_it_is_asked_for_by_its_phrase(done: dict[str, Any]) -> None:
    edit = {"op": "glow", "target": "azure thing", "color": "violet", "least": 0.8}
    assert done["ask"]["recipe"]["edits"] == [edit]


def test_the_instruction_follows_its_words(done: dict[str, Any]) -> None:
    assert done["augment"]["copies"] == 1
    (path,) = (done["folder"] / "out").rglob("rpaug.json")
    report = json.loads(path.read_text())
    assert report["words"]["written"] == ["touch the violet thing"]
    assert sum(report["changed_pixels"].values()) > 0


def test_it_meets_the_contract(installed: Path, tmp_path: Path) -> None:
    assert re.search(r"\b1\d passed", own_tests(installed, "glow", tmp_path))
