"""Where a copy's time goes: every part once, in order, and what an episode lacks is named."""

import json
from pathlib import Path

from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.pipeline import inputs, spent
from rpaug.pipeline.run import Run

EDITS = [
    {"op": "light_color"},
    {
        "one_of": [
            {"op": "recolor", "target": {"handle": 999}, "color": "red"},
            {"op": "table_color"},
        ]
    },
]


def test_every_part_is_timed_once_and_what_cannot_be_made_is_named(template: Path) -> None:
    run = Run(template, inputs.recipe({"version": 1, "edits": EDITS}), Path())
    parts = list(spent.measure(run, run.keys[0], 1))
    fixed = [spent.START, spent.READ, spent.FIND, spent.TRY, spent.FILES]
    edits = ["light_color", "recolor", "table_color"]
    assert [part.part for part in parts] == [*fixed, *edits, spent.WHOLE]
    assert len(parts) == spent.FIXED + len(edits)
    assert [part.once for part in parts] == [True] * 4 + [False] * 5
    by_name = {part.part: part for part in parts}
    assert "999" in by_name["recolor"].left_out
    assert by_name["recolor"].seconds == 0
    assert all(part.seconds > 0 for part in parts if part.part not in edits)
    once, copy = spent.sums(parts)
    assert once == sum(by_name[name].seconds for name in fixed[1:4])
    assert copy == by_name[spent.WHOLE].seconds


def test_the_command_prints_a_table_or_json(template: Path, tmp_path: Path) -> None:
    recipe = tmp_path / "recipe.yaml"
    recipe.write_text(json.dumps({"version": 1, "edits": EDITS}))
    asked = ["bench", "speed", str(template), "--recipe", str(recipe), "--copies", "1"]
    done = CliRunner().invoke(app, [*asked, "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["parts"][-1]["part"] == spent.WHOLE
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 0, done.output
    assert "s a copy" in done.output
    assert "not timed" in done.output
