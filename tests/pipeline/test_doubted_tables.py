"""A copy of a video says where its table or background is doubted, if an edit is about that."""

from types import SimpleNamespace
from typing import Any

import pytest

from rpaug.pipeline import recipe
from rpaug.pipeline.copies import Draw, Made
from rpaug.scene.video.believed import BEHIND, apart

DOUBT = "frames 39 to 52 show no table that is known: edits of the table leave them out"

(APART,) = apart([(0, 38), (53, 120)])
EDITS = {"distractors": {"things": [{"handle": 9, "asset": "lemon"}]}}


@pytest.mark.parametrize(
    ("op", "fields", "missing", "told"),
    [
        ("table_texture", {}, [], (DOUBT,)),
        ("recolor", {"target": {"role": "table"}, "color": "red"}, [], (DOUBT,)),
        ("recolor", {"target": {"handle": 7}, "color": "red"}, [], ()),
        ("background_texture", {}, [], (BEHIND,)),
        ("distractors", {"count": 1}, [], (APART,)),
        ("table_texture", {}, [3, 4], ("2 of 10 frames (3 to 4) have no camera pose", DOUBT)),
    ],
)
def test_doubts_about_the_table_are_told_with_edits_of_it(
    op: str, fields: dict[str, Any], missing: list[int], told: tuple[str, ...]
) -> None:
    back = SimpleNamespace(
        missing=missing, doubts={"table": (DOUBT,), "background": (BEHIND,), "things": (APART,)}
    )
    draws = (Draw(0, recipe.option(op, fields), EDITS.get(op, {})),)
    made: Any = SimpleNamespace(
        scene=SimpleNamespace(back=back), draws=draws, episode=SimpleNamespace(length=8)
    )
    said = Made.lacking.fget(made)  # type: ignore[attr-defined]
    assert len(said) == len(told)
    assert all(one.startswith(start) for one, start in zip(said, told, strict=True)), said
