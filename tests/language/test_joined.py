"""Two commands in one wish come to both edits, or are refused: joining them makes no third thing of them."""

from dataclasses import replace

import known
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
    if op(first) == op(second):  # they may be said of one thing, or go on with each other
        return
    came = understood(replace(first, say=first.say.rstrip(".?!") + joined + second.say))
    edits = [one for part in (first, second) for one in (part.answer or {})["edits"]]
    assert came is None or came["edits"] == rounded(edits)
