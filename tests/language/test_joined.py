"""Two commands in one wish come to both edits, or are refused: joining them makes no third thing of them."""

from dataclasses import replace

import known
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_grammar import OURS, rounded, understood

ALONE = [
    one
    for one in OURS
    if one.answer
    and set(one.answer) == {"edits"}
    and len(one.answer["edits"]) == 1
    and not (one.after or one.missed or one.needs)
    and one.cameras == tuple(known.CAMERAS)
]

HEAD = (
    "half of the ",
    "a quarter of ",
    "with a ",
    "with probability ",
    "in half of ",
)  # a share comes first


def op(one: known.Known) -> str:
    edit = (one.answer or {})["edits"][0]
    return str(edit.get("op", "one_of"))


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(ALONE),
    st.sampled_from(ALONE),
    st.sampled_from([", ", " and ", ". ", ", then ", "; "]),
)
def test_two_commands_come_to_both_or_nothing(
    first: known.Known, second: known.Known, joined: str
) -> None:
    if op(first) == op(second) or op(first)[:6] == op(second)[:6] == "table_":
        return  # they may be said of one thing, or go on with each other
    came = understood(replace(first, say=first.say.rstrip(".?!") + joined + second.say))
    edits = [one for part in (first, second) for one in (part.answer or {})["edits"]]
    readings = [edits]
    if first.say.startswith(HEAD) and joined not in (
        ". ",
        "; ",
    ):  # a share that heads a sentence is said of all of it
        share = {"probability": edits[0]["probability"]}
        readings.append([edits[0], *(share | one for one in edits[1:])])
    assert came is None or came["edits"] in [rounded(one) for one in readings]


@pytest.mark.parametrize(
    ("say", "ops"),
    [
        ("bring the ball next to the box and the mug must vanish", ["move", "remove"]),
        ("retexture the can, the receiver should be purple", ["retexture", "recolor"]),
        (
            "make the drawer blue and the mug and the can should be rearranged",
            ["recolor", "spread"],
        ),
        ("stylize the box and the bottle is to be painted violet", ["stylize", "recolor"]),
        (
            "swap the texture of the walls and colour the box black",
            ["background_texture", "recolor"],
        ),
        ("I need three more of the green block and there should be a mug", ["duplicate", "insert"]),
        ("scatter the block and the cup and the bottle should be olive", None),
        ("remove the can but leave the mug alone, the robot arm in gold", ["remove", "recolor"]),
    ],
)
def test_a_subject_with_a_verb_of_its_own_begins_anew(say: str, ops: list[str] | None) -> None:
    came = understood(replace(ALONE[0], say=say))
    assert (came and [one["op"] for one in came["edits"]]) == ops
