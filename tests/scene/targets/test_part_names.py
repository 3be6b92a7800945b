"""The parts of furniture by name: which drawer is the top one, what the cabinet is, and what the masks cannot tell."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from analysed import analysed
from boxes import CABINET, DRAWERS, HAND, LEGS, TABLE, Box, World, chest

from rpaug.core.errors import TargetError
from rpaug.core.types import Scene
from rpaug.scene.sampled_frames import look
from rpaug.scene.targets import parts, places
from rpaug.scene.targets.targets import Target, find

KNOB = 22


@cache
def scene(columns: int = 1, rows: int = 3, moved: int = 1, shuts: bool = False) -> Scene:
    return analysed(chest(columns, rows, moved, shuts).episode())


def named(text: str, words: str, **world: int | bool) -> list[int]:
    told = replace(scene(**world), descriptions=(text,))
    return sorted(h - DRAWERS for h in find(told, Target(text=words)))


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("the drawer", 1),
        ("the middle drawer", 1),
        ("the top drawer", 2),
        ("the highest drawer", 2),
        ("bottom drawer", 0),
        ("the second drawer from the top", 1),
        ("the third drawer from the bottom", 2),
        ("the bottom drawer of the cabinet", 0),
        ("the drawer at the top", 2),
        ("the drawer above the middle drawer", 2),
    ],
)
def test_drawers_by_their_place(words: str, expected: int) -> None:
    assert named("open the middle drawer", words) == [expected]


def test_a_drawer_that_is_pushed_in_has_its_place_among_the_shut_ones() -> None:
    for words, expected in (("the top drawer", 2), ("the bottom drawer", 0), ("the drawer", 0)):
        assert named("close the bottom drawer", words, moved=0, shuts=True) == [expected]


def test_drawers_side_by_side_and_in_a_grid() -> None:
    for words, expected in (("the left drawer", 0), ("the right drawer", 3)):
        assert named("open the left drawer", words, columns=2, rows=1, moved=0) == [expected]
    text = "open the top right drawer"
    for words, expected in (("the top right drawer", 4), ("the lower left drawer", 0)):
        assert named(text, words, columns=2, rows=2, moved=4) == [expected]
    with pytest.raises(TargetError, match="2 things fit"):
        named(text, "the top drawer", columns=2, rows=2, moved=4)


def test_the_cabinet_is_the_whole_piece() -> None:
    whole = {CABINET, LEGS, DRAWERS, DRAWERS + 1, DRAWERS + 2}
    for text in ("open the middle drawer of the cabinet", "open the middle drawer"):
        told = replace(scene(), descriptions=(text,))
        assert find(told, Target(text="the cabinet")) == whole
    opened = replace(scene(), descriptions=("open the dresser",))
    assert find(opened, Target(text="the dresser")) == whole


def test_drawers_together() -> None:
    told = replace(scene(), descriptions=("open the middle drawer",))
    three = {DRAWERS, DRAWERS + 1, DRAWERS + 2}
    for words in ("drawers", "the drawer", "the cabinet drawers"):
        assert find(told, Target(text=words, all=True)) == three
    with pytest.raises(TargetError, match="3 things fit"):
        find(told, Target(text="the drawers"))


@pytest.mark.parametrize(
    ("text", "words", "message"),
    [
        ("open the top drawer", "the drawer", "names the highest drawer, which is 32 by its place"),
        ("open the top drawer", "the bottom drawer", "and the robot moved 31"),
        ("open the middle drawer", "the left drawer", "level in that direction"),
        ("open the middle drawer", "the upper drawer", "several are upper"),
        ("open the middle drawer", "the largest drawer", "alike in size"),
        ("open the middle drawer", "the fourth drawer from the top", "nothing fits"),
        (
            "grip the middle handle and pull the middle drawer open",
            "the handle",
            "masks do not show",
        ),
        ("open the middle drawer", "the door", "'door' is no role, no shape and not in the instr"),
        ("put the widget in the top drawer and close it", "the widget", "nothing that may be it"),
        ("hit the nail with the hammer", "the nail", "handles the nail and the hammer"),
        ("turn the knob next to the dish rack", "the rack", "the rack is neither what moves nor"),
    ],
)
def test_what_cannot_be_told_is_refused(text: str, words: str, message: str) -> None:
    with pytest.raises(TargetError, match=message):
        named(text, words)


def test_a_part_that_is_missing_in_the_row_is_noticed() -> None:
    """Masks that show two of four drawers, the outer ones, and a third: which is second is not known."""
    row = [
        places.LocatedInstance(
            frozenset([k]), np.random.default_rng(0).random((50, 3)) * 0.08 + [0, 0, z]
        )
        for k, z in enumerate((0.0, 0.1, 0.3))
    ]
    assert not places.even(row)
    assert places.even(row[:2])


def test_what_is_carried_off_hangs_on_nothing(placed: tuple[World, Scene]) -> None:
    _, recorded = placed
    piece = parts.furniture(recorded, look(recorded.episode))
    assert piece is not None
    assert (piece.moved, piece.row) == (frozenset(), ())
    with pytest.raises(TargetError, match="does not hang on anything that stays"):
        find(replace(recorded, descriptions=("open the safe",)), Target(text="the safe"))


def test_a_handle_with_a_mask_of_its_own_is_part_of_its_drawer() -> None:
    world = chest(1, 3, 1, reach=-0.02)
    drawer = world.boxes[DRAWERS + 1].poses
    knob = drawer.copy()
    knob[:, :3, 3] += (-0.13, 0, 0)
    with_knob = replace(world, boxes={**world.boxes, KNOB: Box((0.07, 0.1, 0.05), knob, (0, 0, 0))})
    known = {
        "manipulated": frozenset([KNOB, DRAWERS + 1]),
        "receiver": frozenset([CABINET, LEGS]),
        "robot": frozenset([HAND]),
        "table": frozenset([TABLE]),
    }
    told = replace(
        analysed(with_knob.episode()),
        roles=known,
        descriptions=("grip the handle and open the drawer",),
    )
    assert find(told, Target(text="the handle")) == {KNOB}
    assert find(told, Target(text="the middle drawer")) == {KNOB, DRAWERS + 1}
    assert find(told, Target(text="the top drawer")) == {DRAWERS + 2}
