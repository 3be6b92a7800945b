"""Edited bodies drawn where they are now, against a scene known in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import BALL, BOX, TABLE, ball_at, scene, shoot

from rpaug.core import geometry
from rpaug.core.types import Body
from rpaug.scene.recorded import carry, surfels
from rpaug.scene.recorded.carry import carried

EYES = {"front": (0.0, -0.8, 0.7), "side": (0.8, -0.2, 0.8), "wrist": (-0.3, -0.5, 0.8)}
STEP = np.array([0.05, -0.06, 0.0])  # metres
T = 3


@pytest.fixture(scope="module")
def recorded():
    """Table, box and ball each a body; the ball's track is known."""
    plain = scene(EYES, length=8, moving="wrist")
    still = np.tile(np.eye(4), (8, 1, 1))
    roll = still.copy()
    roll[:, :3, 3] = [ball_at(t, 8) - ball_at(0, 8) for t in range(8)]
    bodies = (
        Body(frozenset({TABLE}), still, "static"),
        Body(frozenset({BOX}), still, "static"),
        Body(frozenset({BALL}), roll, "gripper"),
    )
    return replace(plain, bodies=bodies)


@pytest.fixture(scope="module")
def kept(recorded):
    return surfels.build(recorded)


def edited(scene_, *bodies):
    return replace(scene_, bodies=bodies, recorded_bodies=scene_.tracked)


def shifted(body, step=STEP):
    track = body.to_world.copy()
    track[:, :3, 3] += step
    return replace(body, to_world=track)


def truth(scene_, name, ball):
    camera = scene_.cameras[name]
    return shoot(camera.K, camera.cam_to_world[T], camera.width, camera.height, ball)


@pytest.mark.parametrize("name", EYES)
def test_a_moved_body_against_the_truth(recorded, kept, name):
    table, box, ball = recorded.bodies
    drawn = surfels.view(kept, edited(recorded, table, box, shifted(ball)), name, T)
    rgb, depth, ids = truth(recorded, name, ball_at(T, 8) + STEP)
    before = recorded.episode.views[name]
    both = (drawn.ids == BALL) & (ids == BALL)
    assert both.sum() >= 0.9 * (ids == BALL).sum()
    assert np.median(np.abs(drawn.depth - depth)[both]) < 2e-3  # a ball drawn from planes
    untouched = (ids != BALL) & (before.ids(T) != BALL) & (drawn.ids != BALL)
    np.testing.assert_array_equal(drawn.image[untouched], before.rgb(T)[untouched])
    np.testing.assert_array_equal(drawn.depth[untouched], before.depth(T)[untouched])
    uncovered = (before.ids(T) == BALL) & (drawn.ids != BALL) & ~drawn.hole & (depth > 0)
    assert np.median(np.abs(drawn.depth - depth)[uncovered]) < 1e-4
    assert np.median(np.abs(drawn.image.astype(int) - rgb)[uncovered]) <= 2


def test_a_removed_body_leaves_what_was_seen_behind_it(recorded, kept):
    table, box, _ = recorded.bodies
    drawn = surfels.view(kept, edited(recorded, table, box), "front", T)
    _, depth, ids = truth(recorded, "front", None)
    assert not (drawn.ids == BALL).any()
    seen = ~drawn.hole & (depth > 0)
    assert np.mean(drawn.ids[seen] == ids[seen]) > 0.99
    assert np.median(np.abs(drawn.depth - depth)[seen]) < 1e-6
    assert drawn.hole.mean() < 0.01  # the ball rolls: its place was seen


def test_a_removed_static_body_uncovers_what_others_saw(recorded, kept):
    table, _, ball = recorded.bodies
    drawn = surfels.view(kept, edited(recorded, table, ball), "front", T)
    assert not (drawn.ids == BOX).any()
    before = recorded.episode.views["front"].ids(T) == BOX
    assert (before & drawn.hole).sum() < before.sum()


def test_a_copy_stands_beside_the_original(recorded, kept):
    table, box, ball = recorded.bodies
    twin = replace(
        shifted(ball, [0.3, 0.0, 0.0]), instance_ids=frozenset({999}), copy_of={BALL: 999}
    )
    drawn = surfels.view(kept, edited(recorded, table, box, ball, twin), "front", T)
    view = recorded.episode.views["front"]
    same = drawn.ids != 999
    np.testing.assert_array_equal(drawn.image[same], view.rgb(T)[same])
    assert 0.5 < (drawn.ids == 999).sum() / (view.ids(T) == BALL).sum() < 1.6


def test_what_stands_as_recorded_is_not_carried(recorded):
    table, box, ball = recorded.bodies
    assert carried(recorded, T) == ()
    assert carried(edited(recorded, table, box, ball), T) == ()
    one = carried(edited(recorded, table, shifted(box), ball), T)
    assert [edit.instance_ids for edit in one] == [frozenset({BOX})]
    np.testing.assert_allclose(one[0].motion[:3, 3], STEP)


def test_a_larger_body_is_seen_where_it_ends_now(recorded, kept):
    """The box 1.2 times as large about the middle of its foot, which is the world's origin."""
    table, box, ball = recorded.bodies
    large = replace(box, scale=1.2)
    drawn = surfels.view(kept, edited(recorded, table, large, ball), "side", T)
    points = geometry.world_points(drawn.depth.astype(float), recorded.cameras["side"], T)[
        drawn.ids == BOX
    ]
    low, high = np.quantile(points, [0.02, 0.98], axis=0)
    assert high[2] == pytest.approx(1.2 * 0.25, abs=0.01)
    assert high[0] == pytest.approx(1.2 * 0.15, abs=0.015)
    assert low[2] >= -2e-3


def test_scaling_about_a_moving_frame():
    track = np.tile(np.eye(4), (2, 1, 1))
    track[1, :3, 3] = 0.1, 0.2, 0.3
    body = Body(frozenset({BALL}), track, "gripper")
    motion = carry.motion(replace(body, scale=2.0), body, 1)
    point = np.array([0.3, -0.1, 0.2])
    shown = geometry.transform(motion, 2.0 * geometry.transform(track[1], point))
    np.testing.assert_allclose(shown, geometry.transform(track[1], 2.0 * point), atol=1e-12)
