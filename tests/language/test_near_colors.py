"""A near color stands in only where nothing is of the one that was said, and for as many things as were meant."""

from dataclasses import replace
from typing import Any

import boxes
import pytest
from analysed import analysed
from boxes import HAND, OTHER, Box, at

from rpaug.core.errors import TargetError
from rpaug.language import reader
from rpaug.language.gathering import WishState
from rpaug.language.messages import Wish, WishContext
from rpaug.language.recording import Recording
from rpaug.language.things import Named, Namer
from rpaug.language.tokens import Token

GRAY, BLUE = (128, 128, 128), (0, 0, 200)


def recording(*colors: tuple[int, int, int]) -> Recording:
    """Blocks on the table, side by side."""
    world = boxes.still(3)
    there = {one: box for one, box in world.boxes.items() if one not in (OTHER, HAND)}
    for k, color in enumerate(colors):
        there[50 + k] = Box((0.1, 0.1, 0.1), at(0.1, 0.28 * k - 0.35, 0.05), color)
    scene = analysed(replace(world, boxes=there, size=96).episode())
    return Recording(lambda: scene)


@pytest.fixture(scope="module")
def two() -> Recording:
    return recording(GRAY, GRAY, BLUE)


@pytest.mark.parametrize(
    ("words", "found"), [("black blocks", "gray block"), ("gray blocks", "gray block")]
)
def test_all_stay_all(two: Recording, words: str, found: str) -> None:
    """Whether by the color that was said or by one that is near it."""
    namer = Namer(two, None)
    target = namer.target(Named(words, several=True))
    assert target == {"text": found, "all": True}
    assert namer.ids(target) == {50, 51}
    assert len(namer.notes) == (words != "gray blocks")


def test_of_several_none_is_picked_by_another_color(two: Recording) -> None:
    """Two gray blocks and "the gray block": it cannot be told which, though something silver is there."""
    namer = Namer(two, None)
    with pytest.raises(TargetError, match="2 things fit"):
        namer.target(Named("gray block"))
    assert namer.notes == []


def test_a_color_within_a_word_stays() -> None:
    namer = Namer(recording(GRAY, BLUE), None)
    assert namer.target(Named("black block")) == "gray block"
    assert namer.target(Named("black blackboard block")) == "gray blackboard block"


def test_two_names_for_one_patterned_thing_are_refused(two: Recording) -> None:
    """Which pattern a thing has is not measured, only that it shows several colors."""
    namer = Namer(two, None)
    for row in namer.rows:
        row.pop("shows", None)
        if row["id"] == 50:
            row["shows"] = ["gray", "blue"]
    assert namer.target(Named("striped block")) == {"handle": [50]}
    assert namer.target(Named("striped block")) == {"handle": [50]}
    with pytest.raises(TargetError, match="'striped block' and 'patterned block'"):
        namer.target(Named("patterned block"))


def look(words: str, *there: tuple[int, int, int], verb: str = "") -> list[Any] | None:
    namer = Namer(recording(*there), None)
    wish = Wish(stated=words, setting=WishContext(cameras=("front",)))
    state = WishState(wish, namer, [], None, False, verb=[Token(verb, verb)] if verb else [])
    found = reader._look([Token("thing", words, Named(words))], state)
    assert namer.notes == []
    return None if found is None else list(found.edits)


def test_a_color_and_a_thing_alone_are_what_it_shall_be() -> None:
    """Where that is one thing, which has another color now, and no verb goes on."""
    painted = [{"op": "recolor", "target": "block", "color": "purple"}]
    assert look("purple block", BLUE) == painted
    assert look("blue block", BLUE) is None
    assert look("purple block", BLUE, GRAY) is None
    assert look("red kettle", BLUE) is None
    assert look("purple block", BLUE, verb="remove") is None
