"""Tracks against motions that are known, and against what is plain to see in real recordings."""

from dataclasses import replace

import boxes
import numpy as np
import pytest
from analysed import analysed
from boxes import BLOCK, DRAWERS, FLOOR, HAND, PAD, TABLE, World

from rpaug.core import geometry
from rpaug.core.types import Body, Scene
from rpaug.scene.sampled_frames import look
from rpaug.scene.tracking import bodies


def body(scene: Scene, instance_id: int) -> Body:
    return next(b for b in scene.bodies if instance_id in b.instance_ids)


def worst(world: World, found: Body, instance_id: int) -> float:
    """The most, in metres, that a corner of the box is off at any frame."""
    box = world.boxes[instance_id]
    signs = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    corners = geometry.transform(world.pose(instance_id, 0), signs * box.size)
    off = []
    for t in range(len(world.gripper)):
        truly = world.pose(instance_id, t) @ geometry.inverse(world.pose(instance_id, 0))
        gap = geometry.transform(truly, corners) - geometry.transform(found.to_world[t], corners)
        off.append(np.linalg.norm(gap, axis=-1).max())
    return max(off)


def test_a_carried_block_rests_is_held_and_rests_again(placed: tuple[World, Scene]) -> None:
    world, scene = placed
    found = body(scene, BLOCK)
    assert found.motion == "gripper"
    assert not found.ambiguous
    # The ray-caster is exact: what remains is rounding.
    assert worst(world, found, BLOCK) < 1e-6
    np.testing.assert_array_equal(found.to_world[:8], np.tile(np.eye(4), (8, 1, 1)))
    np.testing.assert_array_equal(found.to_world[-5:], np.tile(found.to_world[-1], (5, 1, 1)))


@pytest.mark.parametrize("instance_id", [FLOOR, TABLE, PAD])
def test_what_stands_is_static(placed: tuple[World, Scene], instance_id: int) -> None:
    _, scene = placed
    found = body(scene, instance_id)
    assert (found.motion, found.ambiguous) == ("static", False)
    assert found.residual < 1e-6


def test_the_hand_hangs_on_the_gripper_from_the_first_frame(placed: tuple[World, Scene]) -> None:
    world, scene = placed
    found = body(scene, HAND)
    assert found.motion == "gripper"
    assert worst(world, found, HAND) < 1e-6


def test_a_pushed_block_is_followed(pushed: tuple[World, Scene]) -> None:
    world, scene = pushed
    found = body(scene, BLOCK)
    travelled = np.linalg.norm(world.pose(BLOCK, -1)[:3, 3] - world.pose(BLOCK, 0)[:3, 3])
    # Pixels are 1.5 cm here; one of them is what planes let slide unnoticed.
    assert worst(world, found, BLOCK) < 0.015 < travelled / 10
    assert found.motion in ("gripper", "aligned")


def test_one_frame_tells_nothing() -> None:
    episode = boxes.still(1).episode()
    for found in bodies.track(episode):
        assert (found.motion, found.ambiguous) == ("static", True)
        assert found.to_world.shape == (1, 4, 4)


def test_without_masks_there_are_no_bodies() -> None:
    assert bodies.track(boxes.still(3).episode(masks=False)) == ()


def test_a_drawer_rests_exactly_where_what_pulled_it_rests() -> None:
    def waiting(track: np.ndarray) -> np.ndarray:
        return np.concatenate([track, np.tile(track[-1:], (6,) + (1,) * (track.ndim - 1))])

    world = boxes.chest(1, 3, 1)
    things = {
        k: replace(one, poses=waiting(one.poses)) if one.poses.ndim == 3 else one
        for k, one in world.boxes.items()
    }
    world = replace(
        world,
        boxes=things,
        gripper=waiting(world.gripper),
        gripper_open=waiting(world.gripper_open),
    )
    found = body(analysed(world.episode()), DRAWERS + 1).to_world
    assert np.linalg.norm(found[-1, :3, 3]) > 0.1
    np.testing.assert_array_equal(found[-6:], np.tile(found[-1], (6, 1, 1)))


def test_every_handle_is_in_one_body_and_starts_at_the_identity(
    placed: tuple[World, Scene],
) -> None:
    world, scene = placed
    instance_ids = [instance_id for b in scene.bodies for instance_id in b.instance_ids]
    assert sorted(instance_ids) == sorted(world.boxes)
    for b in scene.bodies:
        np.testing.assert_array_equal(b.to_world[b.reference], np.eye(4))


def test_the_real_drawer_slides_straight(real: Scene) -> None:
    drawer = body(real, next(iter(real.roles["manipulated"])))
    way = drawer.to_world[:, :3, 3]
    out = way[-1] / np.linalg.norm(way[-1])
    # The rail allows one direction only: 4 mm beside it, half a degree of turn.
    assert np.linalg.norm(way - np.outer(way @ out, out), axis=-1).max() < 0.004
    assert np.arccos((np.trace(drawer.to_world[-1, :3, :3]) - 1) / 2) < np.deg2rad(0.5)
    assert 0.2 < np.linalg.norm(way[-1]) < 0.26
    assert drawer.motion == "gripper"
    assert drawer.residual < 0.002
    closes = int(np.argmax(real.episode.robot.gripper_open < 0.5))
    np.testing.assert_array_equal(
        drawer.to_world[: closes - 1], np.eye(4) + 0 * drawer.to_world[: closes - 1]
    )


def test_real_furniture_is_static_to_a_tenth_of_a_millimetre(real: Scene) -> None:
    for instance_id in real.roles["table"] | {
        max(real.roles["receiver"], key=lambda h: pixels(real, h))
    }:
        found = body(real, instance_id)
        assert found.motion == "static"
        assert found.residual < 1e-4


def pixels(scene: Scene, instance_id: int) -> int:
    return int((look(scene.episode, [0]).ids == instance_id).sum())


def test_real_fingers_close_by_the_same_way(real: Scene) -> None:
    """Both jaws slide along the hand, one against the other."""
    gripper = real.episode.robot.gripper_to_world
    shifts = []
    for instance_id in (31, 34):  # the Panda's fingers in both recordings
        track = body(real, instance_id).to_world
        own = geometry.inverse(gripper) @ track @ gripper[0]
        shifts.append(own[-1, :3, 3] - own[0, :3, 3])
    assert np.linalg.norm(shifts[0] + shifts[1]) < 0.035 < np.linalg.norm(shifts[0] - shifts[1])
