"""`rpaug diagnose` writes a recipe that runs, a report that opens, or nothing."""

import json
from pathlib import Path

import numpy as np
import pytest
from endpoints import KEY, completion, served
from rollouts import SAMPLE, evaluation, painted
from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.core.registry import adapter_for
from rpaug.diagnosis import reference
from rpaug.pipeline import recipe
from rpaug.scene.build import build

RUNNER = CliRunner()


def diagnose(*arguments: object, code: int = 0) -> str:
    done = RUNNER.invoke(app, ["diagnose", *map(str, arguments)])
    assert done.exit_code == code, done.output
    return done.output


@pytest.fixture(scope="module")
def masks() -> dict[str, np.ndarray]:
    """Where the sample's front camera first sees each role."""
    source = adapter_for(SAMPLE)
    scene = build(source.read(SAMPLE, source.episodes(SAMPLE)[0]), with_bodies=True)
    ids = scene.episode.views["front"].ids
    assert ids is not None
    return {role: np.isin(ids(0), list(instance_ids)) for role, instance_ids in scene.roles.items()}


@pytest.fixture(scope="module")
def usual() -> reference.Reference:
    return reference.learn(SAMPLE)


@pytest.fixture(autouse=True)
def learnt(monkeypatch: pytest.MonkeyPatch, usual: reference.Reference) -> None:
    """The sample is learnt once for all tests."""
    monkeypatch.setattr(reference, "learn", lambda *ignored: usual)


def test_a_painted_table_becomes_a_recipe_that_runs(tmp_path: Path, masks: dict) -> None:
    path = evaluation(
        tmp_path / "eval", painted(masks["table"], (0.5, 1.0, 0.6)), factor="<b>secret\x1b[31m</b>"
    )
    out, report = tmp_path / "next.yaml", tmp_path / "why.html"
    stated = diagnose(path, "--dataset", SAMPLE, "--out", out, "--report", report)
    assert "table" in stated
    assert "rule-based" in stated
    made = recipe.load(out)
    assert [option.name for option in made.steps[0].options] == ["table_color", "table_texture"]
    assert made.steps[0].probability == 1.0
    found = json.loads((tmp_path / "diagnosis.json").read_text())
    assert found["causes"][0]["factor"] == "table"
    page = report.read_text()
    assert page.count("data:image/png;base64,") == 13  # 12 failures, and the recordings
    assert "http" not in page.replace("http-equiv", "")
    assert "secret" in page
    assert not any(mark in page for mark in ("<b>secret", "\x1b"))
    run = RUNNER.invoke(
        app,
        ["augment", str(SAMPLE), "--recipe", str(out), "--out", str(tmp_path / "o"), "--dry-run"],
    )
    assert run.exit_code == 0, run.output


def test_dim_light_is_told_from_paint(tmp_path: Path) -> None:
    path = evaluation(tmp_path / "eval", lambda image: (image * [0.4, 0.5, 0.7]).astype(np.uint8))
    found = json.loads(diagnose(path, "--dataset", SAMPLE, "--json"))
    assert found["causes"][0]["factor"] == "lighting"
    assert [edit["op"] for edit in found["recipe"]["edits"]] == ["light_color", "light_direction"]


def test_a_moved_camera_is_told(tmp_path: Path) -> None:
    path = evaluation(tmp_path / "eval", lambda image: np.roll(image, 9, 1))
    found = json.loads(diagnose(path, "--dataset", SAMPLE, "--json"))
    assert found["causes"][0]["factor"] == "camera"
    assert found["recipe"]["edits"][0]["op"] == "camera_pose"


def test_nothing_to_fix_writes_no_recipe(tmp_path: Path) -> None:
    path = evaluation(tmp_path / "eval", lambda image: image, failures=0)
    out = tmp_path / "next.yaml"
    assert "nothing to fix" in diagnose(
        path, "--dataset", SAMPLE, "--out", out, "--report", tmp_path / "r.html"
    )
    assert not out.exists()
    assert json.loads((tmp_path / "diagnosis.json").read_text())["verdict"] == "nothing to fix"


def test_failures_that_nothing_explains_are_said(tmp_path: Path) -> None:
    path = evaluation(tmp_path / "eval", lambda image: image)
    out = tmp_path / "next.yaml"
    assert "no cause found" in diagnose(path, "--dataset", SAMPLE, "--out", out, code=1)
    assert not out.exists()
    assert "give --dataset" in diagnose(path, code=1)


def test_what_is_there_is_not_overwritten(tmp_path: Path) -> None:
    path = evaluation(tmp_path / "eval", lambda image: image)
    (tmp_path / "next.yaml").write_text("mine")
    diagnose(path, "--dataset", SAMPLE, "--out", tmp_path / "next.yaml", code=2)
    assert (tmp_path / "next.yaml").read_text() == "mine"
    assert not (tmp_path / "diagnosis.json").exists()
    diagnose(path, "--llm", "http://localhost:1", code=2)
    diagnose(tmp_path / "none", code=2)


def test_an_endpoint_of_no_use_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RPAUG_LLM_KEY", KEY)
    path = evaluation(tmp_path / "eval", lambda image: image, failures=1, successes=1)
    flags = ["--model", "m", "--out", tmp_path / "out/r.yaml", "--report", tmp_path / "out/r.html"]
    causes = completion(json.dumps({"causes": [{"factor": "table", "confidence": 1.0}]}))
    # It names a cause three times, and then talks nonsense: nothing of it may be left behind.
    with served(lambda h, n: h.answer(causes if n <= 3 else completion("oh"))) as (endpoint, _):
        stated = diagnose(path, "--llm", endpoint.url, *flags, code=2)
    assert "cannot be used" in stated
    assert KEY not in stated
    assert not (tmp_path / "out").exists()


def test_help_shows_an_example() -> None:
    assert "rpaug diagnose eval.jsonl" in " ".join(diagnose("--help").split())
