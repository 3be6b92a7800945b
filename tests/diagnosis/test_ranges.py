"""A remedy's edit draws from what the failures were measured at, and never from less than it usually does."""

from typing import Any

import numpy as np
import pytest

from rpaug.diagnosis import ranges, remedies
from rpaug.diagnosis.messages import Cause, Factor
from rpaug.pipeline import recipe as recipes

FOCAL = 1.4  # image widths


def seen(angle: float) -> float:
    """By how much of its width a picture moves where the camera turns so far."""
    return FOCAL * float(np.tan(angle))


@pytest.mark.parametrize("degrees", [6, 9])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_yaw_beyond_the_usual_turn_is_drawn_too(degrees: float, sign: int) -> None:
    angle = np.deg2rad(degrees)
    moved = (0.0, sign * seen(angle))
    right = (min(moved), max(moved))
    edit = {"op": "camera_pose", "camera": "static", "turn": 0.05}
    still = (0.0, 0.0)
    wide = ranges.widened("camera", edit, [right, still, still, still], FOCAL)
    assert angle < wide["turn"] < 1.2 * angle
    assert ranges.widened("camera", edit, [right, still, still, still], None) == edit
    assert ranges.widened("camera", edit, [still] * 4, FOCAL) == edit


@pytest.mark.parametrize(("factor", "edit", "span", "key", "low", "high"), [
    ("object size", {"op": "object_size"}, [(np.log(0.5), np.log(0.9))], "range", 0.5, 1.25),
    ("object size", {"op": "object_size"}, [(np.log(1.1), np.log(1.6))], "range", 0.75, 1.6),
])  # fmt: skip
def test_a_size_keeps_its_usual_range(
    factor: Factor, edit: Any, span: Any, key: str, low: float, high: float
) -> None:
    wide = ranges.widened(factor, edit, span, None)[key]
    assert wide[0] == pytest.approx(low, rel=0.1)
    assert wide[1] == pytest.approx(high, rel=0.1)


def test_light_is_drawn_as_bright_as_it_was() -> None:
    span = [(0.2, np.log(1.5)), (0.2, np.log(1.4)), (0.2, 0.3), (0.0, 0.1)]
    low, high = ranges.widened("lighting", {"op": "light_color"}, span, None)["range"]
    assert low == [0, 0, 0]
    assert 0.75 <= high[0] <= 0.8
    dark = ranges.widened("lighting", {"op": "light_color"}, [(-2.0, -1.0)] * 4, None)
    assert dark["range"][1] == [0.5, 0.5, 0.5]


def test_look_alikes_are_added_where_every_failure_met_one() -> None:
    edit = {"op": "distractors", "count": 2}
    assert ranges.widened("distractor", edit, [(0.1, 0.2), (0.5, 0.9)], None)["like"] == "color"
    assert ranges.widened("distractor", edit, [(0.1, 0.2), (0.0, 0.9)], None) == edit


@pytest.mark.parametrize("span", [(), [(np.nan, np.nan)] * 4])
def test_what_was_not_measured_changes_nothing(span: Any) -> None:
    edit = {"op": "camera_pose", "camera": "static"}
    assert ranges.widened("camera", edit, span, FOCAL) == edit


@pytest.mark.parametrize(("factor", "span"), [
    ("object size", [(-0.7, 0.6)]), ("lighting", [(0.1, 0.9)] * 4), ("distractor", [(0.1, 0.2), (0.8, 0.9)]),
])  # fmt: skip
def test_the_recipe_carries_them(factor: Factor, span: Any) -> None:
    words = remedies.WORDS[factor]
    cause = Cause(factor=factor, confidence=0.9, rate=0.5, detail="", remedy=words, spans=span)
    plain = remedies.mended(cause.model_copy(update={"spans": ()}), None).edits
    wide = remedies.mended(cause, None).edits
    assert wide != plain
    recipes.build({"version": 1, "edits": list(wide)}, name="a diagnosed recipe")
