"""examples/glow, an operator as a package of its own, installed by pip: planned, asked for and followed like ours."""

import json
import os
import pickle
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples/glow"
SAMPLE = ROOT / "rpaug/sample"
WISH = "make the azure thing glow violet by at least 80%"
USE = """
import json, sys
from typer.testing import CliRunner
from rpaug.cli import app
for words in json.loads(sys.argv[1]):
    done = CliRunner().invoke(app, words)
    print(json.dumps([done.exit_code, done.output]))
"""
HOLD = "import os, sys, pytest; sys.exit(pytest.main(['-q', '-c', os.devnull, '--rootdir', sys.argv[1], sys.argv[1]]))"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder into which pip put the package."""
    folder = tmp_path_factory.mktemp("glow") / "glow"
    shutil.copytree(EXAMPLE, folder)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    offline = ["--no-deps", "--no-build-isolation", "--no-index"]
    target = folder / "installed"
    subprocess.run([*pip, *offline, "--target", target, folder], check=True)
    return target


def run(installed: Path, code: str, argument: str) -> str:
    path = os.pathsep.join(map(str, (installed, ROOT, ROOT / "tests/helpers")))
    done = subprocess.run(
        [sys.executable, "-c", code, argument],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


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
    commands = {
        "validate": ["validate-recipe", recipe, "--json"],
        "schema": ["validate-recipe", "--schema"],
        "plan": ["augment", data, "--recipe", recipe, "--out", out, "--dry-run", "--json"],
        "ask": ["ask", data, WISH, "--json"],
        "augment": ["augment", data, "--recipe", recipe, "--out", out, "--json"],
    }
    lines = run(installed, USE, json.dumps(list(commands.values()))).splitlines()
    found = dict(zip(commands, map(json.loads, lines), strict=True))
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
    shutil.copy(EXAMPLE / "test_glow.py", tmp_path)
    assert re.search(r"\b1\d passed", run(installed, HOLD, str(tmp_path)))
