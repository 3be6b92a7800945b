"""How an operator's phrases are written, and what is said of those that are not well-formed."""

from dataclasses import dataclass

import pytest

from rpaug import Needs, Operator, RpaugError
from rpaug.core import phrases
from rpaug.core.phrases import Slot


@dataclass(frozen=True, kw_only=True)
class Shift(Operator):
    target: str
    near: str | None = None
    color: str = "red"
    far: float = 0.1
    range: tuple[float, float] = (0.5, 1.0)

    needs = Needs(targets=("target",), anchors=("near",))


def slots(text: str, whole: bool = True) -> list[Slot]:
    return list(phrases.slots(phrases.parse(text, Shift), whole))


def test_kinds_are_known_by_the_fields_name_and_by_what_it_needs() -> None:
    found = slots("push {target} to {near} in {color} by {far:length}")
    assert [slot.kind for slot in found] == ["target", "target", "color", "length"]


def test_what_may_be_left_out_is_left_out() -> None:
    text = "push {target} [by {far:length} [near {near}]]"
    assert [slot.field for slot in slots(text)] == ["target", "far", "near"]
    assert [slot.field for slot in slots(text, whole=False)] == ["target"]
    parsed = phrases.parse(text, Shift)
    assert phrases.example(parsed) == "push the red block by 5 cm near the red block"
    assert phrases.example(parsed, whole=False) == "push the red block"


def test_choices_and_pairs() -> None:
    found = slots("(give|lend) {target} {color:red|blue} from {range:number} to {range:number}")
    assert found[1].choices == ("red", "blue")
    given = phrases.fields([(slot.field, slot.example[1]) for slot in found])
    assert given == {"target": "red block", "color": "red", "range": [1.5, 1.5]}


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("push {thing}", "Shift has no field 'thing'"),
        ("push by {far}", r"\{far:KIND\} with KIND one of target"),
        ("push by {far:miles}", "KIND one of"),
        ("push [by {far:length}", r"'\]' is missing"),
        ("push (a|b", r"'\)' is missing"),
        ("push by] far", r"'\]' closes nothing"),
        ("push {target", "left open"),
        ("  ", "no words"),
    ],
)
def test_a_malformed_phrase_is_told(text: str, why: str) -> None:
    with pytest.raises(RpaugError, match=why):
        phrases.parse(text, Shift)
