"""Moved cameras where something is missing, noisy, or seldom seen."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import (
    BALL,
    BOX,
    EYES,
    LENGTH,
    TABLE,
    ball_at,
    pinhole,
    scene,
    seen_by,
    shoot,
    tracked,
)

from rpaug.core import geometry
from rpaug.core.types import Body
from rpaug.render.zbuffer import Source
from rpaug.scene.recorded import parts, surfels


@pytest.fixture(scope="module")
def recorded():
    return tracked(scene(EYES, length=LENGTH, moving="wrist"))


def moved(scene_, name, turn=(0.02, -0.03, 0.04), shift=(0.08, -0.05, 0.06)):
    camera = scene_.cameras[name]
    bump = geometry.rigid(np.array(turn), np.array(shift))
    bumped = replace(camera, cam_to_world=camera.cam_to_world @ bump)
    return replace(scene_, cameras={**scene_.cameras, name: bumped})


def truth(scene_, name, t):
    camera = scene_.cameras[name]
    ball = ball_at(t, LENGTH)
    return shoot(camera.K, camera.cam_to_world[t], camera.width, camera.height, ball)


def test_a_part_outside_the_frame_now_is_drawn_from_another_time(recorded):
    """No camera sees the ball at this moment; its track says where it is."""

    def hidden(name, t, rgb, depth, ids):
        if t == 3:
            gone = ids == BALL
            rgb[gone], depth[gone], ids[gone] = 0, 0, 0
        return rgb, depth, ids

    blind = seen_by(recorded, hidden)
    # A pixel without depth shows that nothing is there, so that camera must not be the one that looks.
    only_side = {name: blind.episode.views[name] for name in ("front", "side")}
    blind = replace(blind, episode=replace(blind.episode, views=only_side))
    bumped = moved(blind, "front")
    kept = surfels.build(blind)
    assert kept.parts
    found = list(surfels.sources(kept, bumped, "front", 3))
    camera = bumped.cameras["front"]
    drawn = surfels.zbuffer.render(
        camera.K, camera.cam_to_world[3], (camera.width, camera.height), found[2:]
    )
    _, depth, ids = truth(bumped, "front", 3)
    both = (drawn.ids == BALL) & (ids == BALL)
    assert both.sum() > 0.7 * (ids == BALL).sum()
    assert np.median(np.abs(drawn.depth - depth)[both]) < 2e-3


def test_a_close_look_at_a_part_is_kept_though_it_shows_no_new_place():
    """Cameras before a wall that moves, one of them half as far: it sees a quarter of what the others see."""
    K, size = pinhole(), (80, 96)
    wall = Body(frozenset({BALL}), np.eye(4)[None], "gripper")

    def before(distance):
        pose = np.eye(4)
        pose[2, 3] = -distance
        flat = np.full(size, distance, np.float32)
        seen = Source(K, pose, np.zeros((*size, 3), np.uint8), flat, np.full(size, BALL, np.int32))
        return parts._seen(seen, wall, 0)

    kept = list(parts._most_telling([before(0.4), before(0.2), before(0.41)]))
    assert -0.2 in [part.source.cam_to_world[2, 3] for part in kept]


@pytest.mark.parametrize("change", [{"ambiguous": True}, {"motion": "unknown"}, {"residual": 0.02}])
def test_a_track_that_may_be_wrong_carries_nothing(recorded, change):
    still, ball = recorded.bodies
    doubtful = replace(recorded, bodies=(still, replace(ball, **change)))
    assert surfels.build(doubtful).parts == ()


def test_a_thing_that_one_camera_alone_sees(recorded):
    def alone(name, t, rgb, depth, ids):
        if name != "side":
            depth[ids == BOX] = 0  # its sensor fails there
        return rgb, depth, ids

    once = seen_by(recorded, alone)
    drawn = surfels.view(surfels.build(once), moved(once, "side"), "side", 2)
    _, _, ids = truth(moved(once, "side"), "side", 2)
    assert ((drawn.ids == BOX) & (ids == BOX)).sum() > 0.9 * (ids == BOX).sum()


def test_a_handle_that_appears_halfway(recorded):
    def late(name, t, rgb, depth, ids):
        if t >= 4:
            ids[ids == BOX] = 77
        return rgb, depth, ids

    appears = seen_by(recorded, late)
    still, ball = recorded.bodies
    bodies = (replace(still, instance_ids=frozenset({TABLE, BOX, 77})), ball)
    appears = replace(appears, bodies=bodies)
    kept = surfels.build(appears)
    for t, instance_id in ((2, BOX), (6, 77)):
        drawn = surfels.view(kept, moved(appears, "front"), "front", t)
        _, depth, ids = truth(moved(appears, "front"), "front", t)
        box = (ids == BOX) & ~drawn.hole
        assert np.mean(drawn.ids[box] == instance_id) > 0.9
        assert np.median(np.abs(drawn.depth - depth)[box]) < 1e-4


def test_depth_that_fails_on_a_mirror(recorded):
    """The box mirrors: its depth is random in every image. The rest must not suffer."""

    def mirror(name, t, rgb, depth, ids):
        rng = np.random.default_rng([t, len(name)])
        depth[ids == BOX] = rng.uniform(0.3, 3.0, (ids == BOX).sum()).astype(np.float32)
        return rgb, depth, ids

    shiny = seen_by(recorded, mirror)
    kept = surfels.build(shiny)
    drawn = surfels.view(kept, moved(shiny, "front"), "front", 2)
    _, depth, ids = truth(moved(shiny, "front"), "front", 2)
    table = (ids == TABLE) & (drawn.ids == TABLE) & ~drawn.hole
    assert table.sum() > 0.8 * (ids == TABLE).sum()
    assert np.median(np.abs(drawn.depth - depth)[table]) < 1e-4
    assert np.isfinite(drawn.depth).all()


def test_depth_with_holes(recorded):
    def holes(name, t, rgb, depth, ids):
        depth[::5, ::3] = 0
        depth[10:14] = np.nan
        return rgb, depth, ids

    poor = seen_by(recorded, holes)
    drawn = surfels.view(surfels.build(poor), moved(poor, "front"), "front", 2)
    _, depth, _ = truth(moved(poor, "front"), "front", 2)
    known = ~drawn.hole & (depth > 0) & (drawn.depth > 0)
    assert np.median(np.abs(drawn.depth - depth)[known]) < 1e-4


def test_noisy_depth_is_smoothed_by_what_is_measured(recorded):
    def shaken(name, t, rgb, depth, ids):
        rng = np.random.default_rng([t, len(name)])
        noise = 1 + 0.005 * rng.standard_normal(depth.shape)
        return rgb, (depth * noise).astype(np.float32), ids

    noisy = seen_by(recorded, shaken)
    kept, clean = surfels.build(noisy), surfels.build(recorded)
    assert clean.noise < surfels.denoise.NOISY
    assert 0.004 < kept.noise < 0.006
    drawn = surfels.view(kept, moved(noisy, "front"), "front", 2)
    _, depth, ids = truth(moved(noisy, "front"), "front", 2)
    table = (ids == TABLE) & (drawn.ids == TABLE) & ~drawn.hole
    off = np.abs(drawn.depth - depth)[table] / depth[table]
    assert np.median(off) < 0.003  # of depth; 0.67 * 0.005 as recorded
    np.testing.assert_array_equal(
        surfels.view(kept, noisy, "front", 2).depth, noisy.episode.views["front"].depth(2)
    )


def test_a_camera_inside_a_thing(recorded):
    camera = recorded.cameras["front"]
    inside = camera.cam_to_world.copy()
    inside[:, :3, 3] = 0.0, 0.0, 0.12
    within = replace(
        recorded, cameras={**recorded.cameras, "front": replace(camera, cam_to_world=inside)}
    )
    drawn = surfels.view(surfels.build(recorded), within, "front", 2)
    assert np.isfinite(drawn.depth).all()
    assert (drawn.rgb >= 0).all()


@pytest.mark.parametrize("factor", [1.0, 1e-3])
@pytest.mark.parametrize("away", [0.0, 1e4])
def test_neither_place_nor_unit_matters(recorded, factor, away):
    """A scene 1e4 from the origin, in metres or in kilometres, and what its trusted parts are."""

    def placed(pose):
        out = pose.copy()
        out[..., :3, 3] = factor * (pose[..., :3, 3] + away)
        return out

    def body(track):
        out = track.copy()
        shift = np.full(3, away)
        out[:, :3, 3] = factor * (track[:, :3, 3] + shift - track[:, :3, :3] @ shift)
        return out

    views = {}
    for name, view in recorded.episode.views.items():
        camera = replace(view.camera, cam_to_world=placed(view.camera.cam_to_world))
        views[name] = replace(
            view, camera=camera, depth=lambda t, v=view: (factor * v.depth(t)).astype(np.float32)
        )
    there = replace(
        recorded,
        episode=replace(recorded.episode, views=views),
        cameras={name: view.camera for name, view in views.items()},
        bodies=tuple(replace(b, to_world=body(b.to_world)) for b in recorded.bodies),
    )
    here_drawn = surfels.view(surfels.build(recorded), moved(recorded, "front"), "front", 2)
    shift = tuple(factor * s for s in (0.08, -0.05, 0.06))
    drawn = surfels.view(surfels.build(there), moved(there, "front", shift=shift), "front", 2)
    both = ~drawn.hole & ~here_drawn.hole
    assert (drawn.hole == here_drawn.hole).mean() > 0.999
    assert (drawn.ids == here_drawn.ids)[both].mean() > 0.998
    off = np.abs(drawn.depth / factor - here_drawn.depth)[both & (here_drawn.depth > 0)]
    assert np.median(off) < 1e-6
