"""What a dry run says is the run's own cost, however small the episodes are."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.core import registry
from rpaug.operators.camera_pose import CameraPose
from rpaug.operators.light_color import LightColor
from rpaug.pipeline import plan, recipe
from tools.bench import dry_run
from tools.bench.harness import pages

RECORDED = pages.load("scale").tables
SECONDS_WITHIN, MEGABYTES_WITHIN = 1.4, 1.25  # times: 30 % too much or too little, and 20 %


def rows(*of: str) -> list[list[str | float]]:
    """The recorded rows of these data: name, its use, said and processor s, how far off, said and taken MB."""
    (table,) = (table for table in RECORDED if table.id == "dry_run")
    return [row for row in table.rows if str(row[0]).startswith(of)]


def said(edit: str, copies: int, episodes: int) -> float:
    """Seconds of a run over tiny episodes, without reading so many."""
    made = dry_run.tiny()
    wanted = recipe.build(dry_run.recipe("tiny", edit, copies))
    operators = [option.operator for step in wanted.steps for option in step.options]
    planned = plan.make(operators, made)
    return planned.start + episodes * planned.cost(made, copies)["seconds"]


@pytest.mark.parametrize("row", rows("tiny"), ids=lambda row: row[0])
def test_the_model_still_says_what_was_recorded(row: list) -> None:
    _, edit, copies = str(row[0]).split("/")
    assert said(edit, int(copies), dry_run.EPISODES) == pytest.approx(row[2], abs=0.1)


def near(row: list[str | float], of: int, within: float) -> bool:
    """Whether what is said, in that column, is what was taken, in the next one."""
    stated, taken = float(row[of]), float(row[of + 1])
    return taken / within <= stated <= taken * within


@pytest.mark.parametrize("row", rows(*dry_run.DATA), ids=lambda row: row[0])
def test_seconds_that_are_said_are_those_that_a_run_takes(row: list) -> None:
    """Of rows that the model was not set on too."""
    assert near(row, 2, SECONDS_WITHIN)


def test_nine_of_ten_sizes_are_those_of_a_run() -> None:
    """How well new pixels compress is not known beforehand."""
    every = rows(*dry_run.DATA)
    assert sum(near(row, 5, MEGABYTES_WITHIN) for row in every) >= 0.9 * len(every)


def test_half_of_the_rows_judge_the_model() -> None:
    uses = [row[1] for row in rows(*dry_run.DATA)]
    assert abs(uses.count("set") - uses.count("judged")) <= 2


def test_each_edit_and_each_moved_camera_counts() -> None:
    """A camera that moves costs more than one that stays, several more than one; a second edit more than one."""
    episode = registry.read(dry_run.SAMPLE, None)
    poses = [CameraPose(camera=names) for names in ("front", ("front", "wrist"), "static")]
    costs = [plan.make([one], episode).cost(episode, 1)["seconds"] for one in poses]
    light = plan.make([LightColor()], episode)
    assert light.cost(episode, 1)["seconds"] < costs[0] < costs[1] < costs[2]
    two = plan.make([LightColor(), LightColor()], episode)
    assert two.start > light.start
    assert two.cost(episode, 1)["seconds"] > light.cost(episode, 1)["seconds"]


def test_every_floor_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """With seconds put in that tell a start, an episode, its bodies and a copy apart."""
    for name in ("SECONDS_READ", "SECONDS_BODIES", "SECONDS_WRITTEN"):
        monkeypatch.setattr(plan, name, 0.0)
    monkeypatch.setattr(plan, "SECONDS_START", 1e6)
    monkeypatch.setattr(plan, "SECONDS_START_BODIES", 1e5)
    monkeypatch.setattr(plan, "SECONDS_EPISODE", 1e3)
    monkeypatch.setattr(plan, "SECONDS_TRACKED", 1e2)
    monkeypatch.setattr(plan, "SECONDS_COPY", 1.0)
    assert said("light_color", 4, 200) == pytest.approx(1e6 + 200 * (1e3 + 4))
    assert said("recolor", 4, 200) == pytest.approx(1e6 + 1e5 + 200 * (1e3 + 1e2 + 4))


def test_pixels_count_beside_the_floors(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("SECONDS_START", "SECONDS_EPISODE", "SECONDS_COPY", "SECONDS_BODIES"):
        monkeypatch.setattr(plan, name, 0.0)
    monkeypatch.setattr(plan, "SECONDS_READ", 10.0)
    monkeypatch.setattr(plan, "SECONDS_WRITTEN", 1.0)
    megapixels = dry_run.SIDE**2 * dry_run.FRAMES / 1e6
    made = dry_run.tiny()
    cost = plan.make([LightColor()], made).cost(made, 4, 7.0)
    assert cost["seconds"] == pytest.approx(megapixels * (10 + 4 * 1))
    assert cost["megabytes"] == pytest.approx(4 * (7 + plan.BYTES_A_COPY / 1e6))


def test_the_command_adds_a_start_to_its_episodes(tmp_path: Path) -> None:
    _, source = next(dry_run.datasets(tmp_path, 3, None))
    given = tmp_path / "recipe.json"
    given.write_text(json.dumps(dry_run.recipe("tiny", "light_color", 4)))
    asked = ["augment", str(source), "--recipe", str(given), "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, [*asked, "--dry-run", "--json"])
    assert done.exit_code == 0, done.output
    described = json.loads(done.stdout)
    assert len(described["plans"]) == 3
    episodes = sum(one["estimate"]["seconds"] for one in described["plans"])
    floors = 3 * (plan.SECONDS_EPISODE + 4 * plan.SECONDS_COPY)
    assert 0.99 * floors < episodes < 2 * floors
    assert described["estimate"]["seconds"] == pytest.approx(plan.SECONDS_START + episodes, abs=0.1)
    stored = sum(path.stat().st_size for path in source.rglob("*") if path.is_file()) / 1e6
    copied = sum(one["estimate"]["megabytes"] for one in described["plans"])
    assert copied == pytest.approx(4 * stored, rel=0.3)
