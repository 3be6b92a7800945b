"""The thing to act on is found by elimination, and strange things are those that no recording has a like of."""

import numpy as np
import pytest

from rpaug.diagnosis.things import Roster, TableInstance, recognised

RED, BLUE, GREEN, WHITE = (40, 60, 45), (30, 20, -60), (50, -45, 35), (90, 0, 0)


def thing(color: tuple[float, ...], x: float, y: float, size: float = 2.5) -> TableInstance:
    mask = np.zeros((64, 64), bool)
    mask[int(64 * y) :, int(64 * x) :][:6, :6] = True
    return TableInstance(mask, np.array(color, np.float32), size, np.array([x, y], np.float32))


USUAL = [
    Roster([thing(RED, 0.4, 0.5), thing(BLUE, *away), thing(GREEN, *other)], 0)
    for away, other in (
        ((0.1, 0.2), (0.8, 0.8)),
        ((0.8, 0.2), (0.1, 0.8)),
        ((0.1, 0.8), (0.8, 0.2)),
    )
]
OTHERS = [thing(BLUE, 0.15, 0.75), thing(GREEN, 0.7, 0.2)]


@pytest.mark.parametrize(
    "mine",
    [
        thing(RED, 0.4, 0.5),
        thing(RED, 0.75, 0.6),  # moved
        thing(WHITE, 0.41, 0.52),  # painted
        thing(GREEN, 0.4, 0.5),  # painted like another
        thing(RED, 0.4, 0.5, size=3.2),
        thing(WHITE, 0.55, 0.6),  # painted and moved
    ],
)
def test_it_is_found_whatever_changed(mine: TableInstance) -> None:
    target, strange = recognised([*OTHERS, mine], [], USUAL)
    assert target is mine
    assert not strange


def test_a_strange_thing_is_told() -> None:
    mine, new = thing(RED, 0.4, 0.5), thing(WHITE, 0.8, 0.5, size=2.0)
    target, strange = recognised([new, *OTHERS, mine], [], USUAL)
    assert target is mine
    assert list(strange) == [new]


def test_one_more_of_a_kind_is_strange() -> None:
    mine, more = thing(RED, 0.4, 0.5), thing(BLUE, 0.85, 0.5)
    _, strange = recognised([*OTHERS, more, mine], [], USUAL)
    assert len(strange) == 1


def test_a_whole_that_was_parted_may_be_it() -> None:
    whole = thing(WHITE, 0.4, 0.5)
    piece = TableInstance(
        whole.mask & (np.arange(64) < 28), np.array(GREEN, np.float32), 1.6, whole.place
    )
    target, strange = recognised([*OTHERS, piece], [whole], USUAL)
    assert target is whole
    assert not strange


def test_without_anything_there_is_nothing() -> None:
    assert recognised([], [], USUAL) == (None, [])
