"""Roles in worlds of boxes and in two real recordings, whose handles were read off mask overlays by eye."""

import boxes
import numpy as np
import pytest
from boxes import BLOCK, FLOOR, HAND, OTHER, PAD, TABLE, WALL, World

from rpaug import twin
from rpaug.core.types import Scene
from rpaug.scene.build import build
from rpaug.scene.targets import roles
from rpaug.scene.tracking import bodies

SEEN_BY_EYE = {
    "open the top drawer": {
        "manipulated": {108},
        "receiver": {96, 98, 103, 105},  # frame, lower drawers, legs
        "robot": {31, 34, 35, 39, 40, 41, 42, 43, 44},
        "table": {48, 52},
        "background": {10, 53, 55, 56},  # floor and walls
    },
    "open the bottom drawer": {
        "manipulated": {173},
        "receiver": {171, 178, 180, 183},
        "robot": {31, 34, 35, 39, 40, 41, 42, 43, 44, 45, 46},
        "table": {48, 52},
        "background": {10, 53, 55},
    },
}


def test_roles_of_a_real_recording(real: Scene) -> None:
    assert {name: set(instance_ids) for name, instance_ids in real.roles.items()} == SEEN_BY_EYE[
        real.episode.instruction
    ]


def test_pick_and_place(placed: tuple[World, Scene]) -> None:
    _, scene = placed
    assert scene.roles == {
        "manipulated": {BLOCK},
        "receiver": {PAD},
        "robot": {HAND},
        "table": {TABLE},
        "background": {FLOOR, WALL},
    }


def test_a_pushed_block_ends_on_the_table_for_want_of_anything_else(
    pushed: tuple[World, Scene],
) -> None:
    _, scene = pushed
    assert scene.roles["manipulated"] == {BLOCK}
    assert scene.roles["receiver"] == scene.roles["table"] == {TABLE}
    assert OTHER not in frozenset().union(*scene.roles.values())


@pytest.mark.parametrize("length", [1, 4])
def test_where_nothing_moves_only_places_are_known(length: int) -> None:
    episode = boxes.still(length).episode()
    known = roles.infer(episode, bodies.track(episode))
    assert known == {"table": {TABLE}, "background": {FLOOR, WALL}}


def test_numbers_of_handles_do_not_matter(placed: tuple[World, Scene]) -> None:
    world, scene = placed
    rng = np.random.default_rng(3)
    new = dict(zip(world.boxes, rng.choice(5000, len(world.boxes), replace=False) + 1, strict=True))
    other = World(
        {int(new[h]): box for h, box in world.boxes.items()}, world.gripper, world.gripper_open
    ).episode()
    known = roles.infer(other, bodies.track(other))
    assert known == {
        name: {int(new[h]) for h in instance_ids} for name, instance_ids in scene.roles.items()
    }


@pytest.mark.gl
def test_what_is_pressed_is_manipulated_though_nothing_is_seen_to_move() -> None:
    """Thirty frames show the button's centimetre too seldom for a track."""
    take = twin.perform("push_button", 1000, episode=0, frames=30)
    names = {instance_id: name for name, instance_id in take.truth.handles.items()}
    found = build(take.episode, with_bodies=True).roles
    assert {names[h] for h in found["manipulated"]} == {"button"}
    assert {names[h] for h in found["receiver"]} == {"button_base"}
