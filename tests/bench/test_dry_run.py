"""What a dry run says is the run's own cost, however small the episodes are."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.operators.light_color import LightColor
from rpaug.pipeline import plan, recipe
from tools.bench import dry_run
from tools.bench.harness import pages

RECORDED = pages.load("scale").tables
WITHIN = 2.0  # times the seconds that a run took


def rows(of: str) -> list[list[str | float]]:
    """The recorded rows of a dataset: name, said, processor s."""
    (table,) = (table for table in RECORDED if table.id == "dry_run")
    return [row for row in table.rows if str(row[0]).startswith(of)]


def said(edit: str, copies: int, episodes: int) -> float:
    """Seconds of a run over tiny episodes, without reading so many."""
    made = dry_run.tiny()
    wanted = recipe.build(dry_run.recipe("tiny", edit, copies))
    operators = [option.operator for step in wanted.steps for option in step.options]
    cost = plan.make(operators, made).cost(made, copies)
    return plan.SECONDS_START + episodes * cost["seconds"]


@pytest.mark.parametrize("row", rows("tiny"), ids=lambda row: row[0])
def test_tiny_episodes_take_what_is_said(row: list) -> None:
    """Against the seconds that the bench measured: the model still says them, and they were right."""
    _, edit, copies = str(row[0]).split(", ")
    now = said(edit, int(copies), 200)
    assert now == pytest.approx(row[1], abs=0.1)  # else measure anew
    assert row[2] / WITHIN <= now <= row[2] * WITHIN


@pytest.mark.parametrize("row", [*rows("sample"), *rows("real")], ids=lambda row: row[0])
def test_larger_ones_do_as_well(row: list) -> None:
    assert row[2] / WITHIN <= row[1] <= row[2] * WITHIN


def test_every_floor_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """With seconds put in that tell a start, an episode, its bodies and a copy apart."""
    for name in ("SECONDS_READ", "SECONDS_BODIES"):
        monkeypatch.setattr(plan, name, 0.0)
    monkeypatch.setattr(plan, "SECONDS", dict.fromkeys(plan.SECONDS, 0.0))
    monkeypatch.setattr(plan, "SECONDS_START", 1e6)
    monkeypatch.setattr(plan, "SECONDS_EPISODE", 1e3)
    monkeypatch.setattr(plan, "SECONDS_TRACKED", 1e2)
    monkeypatch.setattr(plan, "SECONDS_COPY", 1.0)
    assert said("light_color", 4, 200) == pytest.approx(1e6 + 200 * (1e3 + 4))
    assert said("recolor", 4, 200) == pytest.approx(1e6 + 200 * (1e3 + 1e2 + 4))


def test_pixels_count_beside_the_floors(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("SECONDS_START", "SECONDS_EPISODE", "SECONDS_COPY", "SECONDS_BODIES"):
        monkeypatch.setattr(plan, name, 0.0)
    monkeypatch.setattr(plan, "SECONDS_READ", 10.0)
    monkeypatch.setattr(plan, "SECONDS", {0: 1.0, 1: 2.0, 3: 3.0, 4: 4.0})
    megapixels = dry_run.SIDE**2 * dry_run.FRAMES / 1e6
    made = dry_run.tiny()
    cost = plan.make([LightColor()], made).cost(made, 4)
    assert cost["seconds"] == pytest.approx(megapixels * (10 + 4 * 1))
    copied = megapixels * plan.BYTES_A_PIXEL + plan.BYTES_A_COPY / 1e6
    assert cost["megabytes"] == pytest.approx(4 * copied)


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
    assert floors < episodes < 2 * floors
    assert described["estimate"]["seconds"] == pytest.approx(plan.SECONDS_START + episodes, abs=0.1)
