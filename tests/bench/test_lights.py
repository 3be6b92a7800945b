"""The table of edits by the light that they were recorded in."""

import pytest

from rpaug import twin
from tools.bench.harness import edits, lights
from tools.bench.harness.cases import ESTIMATED, TOLD
from tools.bench.harness.scores import Scores

SCORES = dict.fromkeys(Scores.__dataclass_fields__, 0.0)


def row(factor: str, method: str, psnr: float, seed: int = 0) -> edits.EditRow:
    scores = Scores(**SCORES | {"psnr": psnr, "seconds": 2.0})
    return edits.EditRow(factor, method, seed, "open_drawer", "all", scores)


def test_a_row_holds_means_over_seeds_and_the_best_that_knows_no_more() -> None:
    rows = [row("object_color", TOLD, 50.0), row("object_color", TOLD, 40.0, 1)]
    rows += [row("object_color", ESTIMATED, 35.0), row("object_color", edits.LAB, 30.0)]
    rows += [row("object_color", edits.NONE, 20.0), row("camera_pose", TOLD, 27.0)]
    made = lights.table(edits.EditSetting(light="shadows", seeds=3), rows, "python -m tools")
    aimed = {"value": 35.0, "target": ">= 33"}
    leads = [{"value": lead, "target": ">= 0"} for lead in (20.0, 15.0)]
    assert made.rows == [
        ["object_color", 45.0, 40.0, 30.0, leads[0], aimed, 35.0, 20.0, leads[1], 2.0, 1],
        ["camera_pose", 27.0, 27.0, "-", "-", "-", "-", "-", "-", 2.0, 2],
    ]
    found = dict(zip(made.columns, made.rows[0], strict=True))
    assert found["least lead, estimated"] == leads[1]
    assert made.id == "shadows"
    assert made.seeds.startswith("seeds 0 (open_drawer), 1 (open_drawer), 17 frames")


def test_a_seed_below_its_own_baseline_is_a_miss_whatever_the_means_are() -> None:
    rows = [row("table_color", ESTIMATED, 50.0), row("table_color", edits.NONE, 20.0)]
    rows += [row("table_color", ESTIMATED, 33.0, 1), row("table_color", edits.NONE, 35.0, 1)]
    made = lights.table(edits.EditSetting(light="shadows"), rows, "")
    assert list(made.misses()) == ["table_color, least lead, estimated: -2.0 (≥0)"]


@pytest.mark.gl
def test_what_an_operator_refuses_costs_the_others_nothing(capsys) -> None:
    setting = edits.EditSetting(
        light="shadows",
        factors=("lamp_color",),
        tasks=("push_button",),
        seeds=1,
        frames=13,
        size=16,
    )
    rows = edits.run(setting)
    assert {row.method for row in rows} >= {edits.NONE, edits.JITTER}
    assert ESTIMATED not in {row.method for row in rows}
    assert "which light is a lamp's is not told" in capsys.readouterr().err
    ((*_, refused),) = lights.table(setting, rows, "").rows
    assert refused == 1


@pytest.mark.parametrize("light", lights.TITLES)
def test_lamps_are_colored_one_by_one_where_shadows_tell_them(light: edits.Light) -> None:
    setting = edits.EditSetting(light=light, factors=("lamp_color", "light_color"))
    assert ("lamp_color" in edits.missing(setting)) == (light in ("plain", "highlights"))


@pytest.mark.gl
def test_what_the_task_moves_has_the_finish_that_is_asked_for() -> None:
    setting = edits.EditSetting(light="highlights", finish="metallic", frames=13, size=16)
    look = edits.recording(setting, twin.RIG, "push_button", 1).truth.new
    assert look.finishes == {"button": "metallic"}
    made = lights.table(setting, [row("object_color", TOLD, 50.0)], "")
    assert (made.id, made.title[-17:]) == ("metallic", ", metallic things")


@pytest.mark.gl
def test_what_is_recorded_lies_in_that_light() -> None:
    setting = edits.EditSetting(light="both", lamps=2, frames=13, size=16)
    look = edits.recording(setting, twin.RIG, "push_button", 1).truth.new
    assert (look.shadows, look.specular, look.lamps) == (True, True, twin.RIG[:2])
