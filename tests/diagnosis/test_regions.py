"""Things are told from a table of nearly their color, and from other things that they touch."""

import numpy as np

from rpaug.diagnosis import things

WOOD, BLOCK = (55, 15, 35), (42, 19, 17)  # 22 Lab units apart
LOUD = ((40, 60, 45), (30, 20, -60), (50, -45, 35), (90, 0, 0), (80, 5, 80))
BLUE, GREY = (45, 5, -45), (75, -2, -4)
NOTHING = np.empty((0, 3), np.float32)


def picture(rng: np.random.Generator) -> np.ndarray:
    """A wooden table with loud things at its far side, in Lab."""
    lab = np.array(WOOD, np.float32) + rng.normal(0, 3, (64, 64, 3)).astype(np.float32)
    for k, color in enumerate(LOUD):
        lab[4:14, 2 + 12 * k : 12 + 12 * k] = color
    return lab


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    return float((one & other).sum() / (one | other).sum())


def square(y: int, x: int) -> np.ndarray:
    mask = np.zeros((64, 64), bool)
    mask[y : y + 14, x : x + 14] = True
    return mask


def test_a_thing_of_nearly_the_tables_color_is_told() -> None:
    lab, mine = picture(np.random.default_rng(0)), square(34, 26)
    lab[mine] = BLOCK
    found, _ = things.by_color(lab, np.ones((64, 64), bool), NOTHING)
    assert max(overlap(one.mask, mine) for one in found) > 0.9


def test_a_thing_that_touches_a_patterned_one_is_told_by_what_the_other_explains() -> None:
    rng = np.random.default_rng(1)
    lab, mine, other = picture(rng), square(30, 26), square(44, 30)
    lab[mine] = (60, 30, -10)
    lab[other] = np.where(rng.random((64, 64, 1)) < 0.5, BLUE, GREY)[other]
    within = np.ones((64, 64), bool)
    known = things.palette(np.array([BLUE, GREY], np.float32))
    without, _ = things.by_color(lab, within, NOTHING)
    assert max(overlap(one.mask, mine) for one in without) < 0.6
    found, left = things.by_color(lab, within, known)
    assert max(overlap(one.mask, mine) for one in left) > 0.9
    assert len(found) == len(without)  # what usually stands there is told as before


def test_a_thing_by_itself_is_not_cut() -> None:
    lab, mine = picture(np.random.default_rng(2)), square(34, 26)
    lab[mine] = BLUE
    known = things.palette(np.array([BLUE, GREY], np.float32))
    _, left = things.by_color(lab, np.ones((64, 64), bool), known)
    assert not any((one.mask & mine).any() for one in left)
