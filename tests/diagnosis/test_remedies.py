"""A remedy in words comes to edits; one that does not costs that remedy alone."""

import pytest

from rpaug.core.errors import BadInput, MissingExtra, RpaugError
from rpaug.diagnosis import remedies
from rpaug.diagnosis.messages import Cause
from rpaug.language import asking


def cause(remedy: str, rate: float = 0.5) -> Cause:
    return Cause(factor="lighting", confidence=0.9, rate=rate, detail="It is dark.", remedy=remedy)


@pytest.mark.parametrize("words", remedies.WORDS.values())
def test_the_rules_own_are_edits(words: str) -> None:
    assert remedies.mended(cause(words), None).edits


def test_cameras_that_the_robot_carries_are_left() -> None:
    (edit,) = remedies.mended(cause(remedies.WORDS["camera"]), None).edits
    assert edit["camera"] == "static"


@pytest.mark.parametrize("words", ["frobnicate it", "?", "x " * 900, "\x00", "undo", "4 copies"])
def test_what_is_no_edit_costs_itself_alone(words: str) -> None:
    every = [
        remedies.mended(one, None) for one in (cause(words), cause("vary the color of the lights"))
    ]
    assert not every[0].edits
    assert every[0].note
    made = remedies.recipe(every)
    assert made is not None
    assert [one["op"] for one in made["edits"]] == ["light_color"]


@pytest.mark.parametrize(
    "error", [MissingExtra("words", "synonyms"), BadInput("a", "b", found="c", expected="d")]
)
def test_whatever_is_amiss_costs_the_remedy_alone(
    error: RpaugError, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        raise error

    monkeypatch.setattr(asking, "ask", fails)
    found = remedies.mended(cause("vary the color of the lights"), None)
    assert found.edits == ()
    assert found.note.startswith("the remedy is no edit: ")
