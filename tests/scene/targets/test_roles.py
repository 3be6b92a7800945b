"""Roles in worlds of boxes and in two real recordings, whose handles were read off mask overlays by eye."""

from collections.abc import Mapping
from dataclasses import replace

import boxes
import numpy as np
import pytest
from boxes import BLOCK, FLOOR, HAND, OTHER, PAD, TABLE, WALL, Box, World

from rpaug import twin
from rpaug.core.errors import TargetError
from rpaug.core.types import Belief, Scene
from rpaug.scene.build import build
from rpaug.scene.targets import roles
from rpaug.scene.targets.targets import Target, find
from rpaug.scene.tracking import bodies

VOID = 16777215

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
    known = roles.held(roles.believe(episode, bodies.track(episode)))
    assert known == {"table": {TABLE}, "background": {FLOOR, WALL}}


def test_numbers_of_handles_do_not_matter(placed: tuple[World, Scene]) -> None:
    world, scene = placed
    rng = np.random.default_rng(3)
    new = dict(zip(world.boxes, rng.choice(5000, len(world.boxes), replace=False) + 1, strict=True))
    other = World(
        {int(new[h]): box for h, box in world.boxes.items()}, world.gripper, world.gripper_open
    ).episode()
    known = roles.held(roles.believe(other, bodies.track(other)))
    assert known == {
        name: {int(new[h]) for h in instance_ids} for name, instance_ids in scene.roles.items()
    }


def _believed(world: World) -> Mapping[str, Belief]:
    episode = world.episode()
    return roles.believe(episode, bodies.track(episode))


def test_beliefs_have_reasons_and_bounded_confidence(placed: tuple[World, Scene]) -> None:
    _, scene = placed
    assert scene.roles.keys() == scene.beliefs.keys()
    for belief in scene.beliefs.values():
        assert roles.BOUND <= belief.confidence <= 1
        assert all(belief.reasons)


def test_a_belief_below_the_bound_is_no_role_and_is_cited(placed: tuple[World, Scene]) -> None:
    _, scene = placed
    weak = replace(scene.beliefs["receiver"], confidence=roles.BOUND - 0.01, reasons=("a guess",))
    beliefs = {**scene.beliefs, "receiver": weak}
    doubting = replace(scene, beliefs=beliefs, roles=roles.held(beliefs))
    assert "receiver" not in doubting.roles
    with pytest.raises(TargetError, match=r"a guess: confidence 0\.39, below 0\.4"):
        find(doubting, Target(role="receiver"))


def test_a_small_table_is_one_and_the_floor_far_below_is_not() -> None:
    world = boxes.pick_and_place()
    small = {**world.boxes, TABLE: Box((0.28, 0.6, 0.04), boxes.at(0.12, 0.05, -0.02))}
    found = _believed(replace(world, boxes=small))
    assert found["table"].instance_ids == {TABLE}
    assert found["background"].instance_ids >= {FLOOR, WALL}


def test_where_there_is_no_table_things_stand_on_the_floor() -> None:
    world = boxes.pick_and_place()
    left = {h: box for h, box in world.boxes.items() if h != TABLE}
    left[FLOOR] = Box((5, 5, 0.02), boxes.at(0, 0, -0.01))
    assert _believed(replace(world, boxes=left))["table"].instance_ids == {FLOOR}


def test_what_fills_no_surface_has_no_role(placed: tuple[World, Scene]) -> None:
    world, scene = placed
    episode = world.episode()
    name, view = next(iter(episode.views.items()))
    assert view.ids is not None

    def speckled(t: int) -> np.ndarray:
        ids = view.ids(t).copy()  # type: ignore[misc]
        ids[1, [3, 9]] = VOID
        return ids

    views = {**episode.views, name: replace(view, ids=speckled)}
    void = replace(episode, views=views)
    assert roles.held(roles.believe(void, bodies.track(void))) == scene.roles


@pytest.mark.gl
def test_what_is_pressed_is_manipulated_though_nothing_is_seen_to_move() -> None:
    """Thirty frames show the button's centimetre too seldom for a track."""
    take = twin.perform("push_button", 1000, episode=0, frames=30)
    names = {instance_id: name for name, instance_id in take.truth.handles.items()}
    found = build(take.episode, with_bodies=True).roles
    assert {names[h] for h in found["manipulated"]} == {"button"}
    assert {names[h] for h in found["receiver"]} == {"button_base"}
