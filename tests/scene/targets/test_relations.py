"""The grammar of targets, and what its relations mean for boxes in the robot's frame."""

import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpaug.scene.targets.places import LocatedInstance, gap, ranked, related
from rpaug.scene.targets.relations import RANKS, RELATIONS, Phrase, parse


def thing(
    x: float, y: float, z: float = 0.0, size: float = 0.04, instance_id: int = 1
) -> LocatedInstance:
    """Points of a cube whose lower face is at z."""
    half = np.array([size / 2, size / 2, 0])
    grid = np.stack(np.meshgrid(*[np.linspace(0, size, 5)] * 3), -1).reshape(-1, 3)
    return LocatedInstance(frozenset([instance_id]), grid + np.array([x, y, z]) - half)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("the red receiver", Phrase("red", "receiver")),
        ("the small coffee cup", Phrase(nouns=("coffee", "cup"), ranks=("smallest",))),
        ("second largest block", Phrase(nouns=("block",), ranks=("largest",), ordinal=1)),
        (
            "the second block from the left",
            Phrase(nouns=("block",), ranks=("leftmost",), ordinal=1),
        ),
        ("the top left drawer", Phrase(nouns=("drawer",), ranks=("highest", "leftmost"))),
        ("the closest block", Phrase(nouns=("block",), ranks=("frontmost",))),
        ("the block that is farthest", Phrase(nouns=("block",), ranks=("rearmost",))),
    ],
)
def test_attributes(text: str, expected: Phrase) -> None:
    assert parse(text) == expected


@pytest.mark.parametrize(
    "text",
    [
        "the cup closest to the red block",
        "the cup nearest to the red block",
        "the nearest cup to the red block",
        "cup next to the red block",
    ],
)
def test_ways_to_say_closest(text: str) -> None:
    phrase = parse(text)
    assert phrase.nouns == ("cup",)
    assert phrase.relations[0].name == "closest to"
    assert phrase.relations[0].anchors == (Phrase("red", nouns=("block",)),)


def test_relations_nest_to_the_right_and_between_takes_two() -> None:
    phrase = parse("the thing between the bowl and the can on top of the pad")
    (between,) = phrase.relations
    bowl, can = between.anchors
    assert (between.name, bowl.nouns, can.nouns) == ("between", ("bowl",), ("can",))
    assert (can.relations[0].name, can.relations[0].anchors[0].nouns) == ("on", ("pad",))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("the cup left of", "'left of' of what?"),
        ("left of the cup", "names no thing"),
        ("the thing between the cup", "between what and what"),
        ("the red blue cup", "several colors"),
        ("the robot table", "several roles"),
        ("the largest leftmost cup", "largest and leftmost at once"),
        ("the second cup", "in which order"),
        ("the cup and the bowl", "'and the bowl' is left over"),
        ("the", "names no thing"),
        ("the middle one", "the middle one of which things"),
        ("the top of the cabinet", "name the part"),
    ],
)
def test_what_cannot_be_parsed(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse(text)


@given(st.text(alphabet="abcdefgh ofnt", max_size=40))
def test_parsing_ends_in_a_phrase_or_a_reason(text: str) -> None:
    found: Phrase | None = None
    with contextlib.suppress(ValueError):
        found = parse(text)
    assert found is None or found.nouns or found.ranks or found.color or found.role or text


@pytest.mark.parametrize("spelling", [s for spellings in RELATIONS.values() for s in spellings])
def test_every_spelling_is_understood(spelling: str) -> None:
    anchors = "the bowl and the can" if "between" in spelling else "the bowl"
    (relation,) = parse(f"the lid {spelling} {anchors}").relations
    assert spelling in RELATIONS[relation.name]


SPOT = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))


@given(SPOT, SPOT)
def test_opposites_never_hold_together(one: tuple[float, float], two: tuple[float, float]) -> None:
    a, b = thing(*one), thing(*two)
    for name, opposite in (("left of", "right of"), ("in front of", "behind")):
        assert not (related(name, [a], [b]) and related(opposite, [a], [b]))
        assert bool(related(name, [a], [b])) == bool(related(opposite, [b], [a]))


def test_directions_are_the_robots() -> None:
    """x points ahead of the robot, y to its left."""
    cup = thing(0.4, 0.0)
    assert related("left of", [thing(0.4, 0.2)], [cup])
    assert related("right of", [thing(0.3, -0.2)], [cup])
    assert related("in front of", [thing(0.2, 0.0)], [cup])
    assert related("behind", [thing(0.6, 0.1)], [cup])


def test_above_on_in_and_between() -> None:
    low, pad = thing(0.3, 0.0, size=0.06), thing(0.3, 0.0, -0.02, size=0.02)
    on, over = thing(0.31, 0.0, 0.061), thing(0.3, 0.01, 0.3)
    assert related("on", [on, over], [low]) == [on]
    assert related("above", [on, over], [low]) == [on, over]
    assert related("below", [low, pad], [on]) == [low, pad]
    assert related("in", [thing(0.3, 0.0, 0.005, size=0.03)], [low])
    left, right, middle = thing(0.3, 0.2), thing(0.3, -0.2), thing(0.32, 0.03)
    assert related("between", [middle, thing(0.5, 0.0), thing(0.3, 0.4)], [left, right]) == [middle]


def test_closest_keeps_ties() -> None:
    anchor, near, far = thing(0, 0), thing(0.2, 0), thing(0.5, 0)
    assert related("closest to", [far, near], [anchor]) == [near]
    assert related("farthest from", [far, near], [anchor]) == [far]
    other = thing(-0.2, 0)
    assert related("closest to", [near, other], [anchor]) == [near, other]
    assert gap(anchor, near) == pytest.approx(0.16, abs=1e-6)
    assert related("closest to", [], [anchor]) == []


@pytest.mark.parametrize("rank", sorted(set(RANKS.values()) - {"middle", "upper", "lower"}))
def test_every_rank_sorts(rank: str) -> None:
    things = [thing(0.1 * k, 0.1 * k, 0.1 * k, 0.02 + 0.01 * k, instance_id=k) for k in range(3)]
    order = [next(iter(one.instance_ids)) for one in ranked(rank, things)]
    rising = {"smallest", "shortest", "rightmost", "frontmost", "lowest"}
    assert order == ([0, 1, 2] if rank in rising else [2, 1, 0])
