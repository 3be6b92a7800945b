"""Moved cameras over a whole episode, against a scene known in closed form and against real recordings."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from analytic import BALL, BOX, TABLE, ball_at, scene, shoot

from rpaug import Camera, TargetError, Unsupported
from rpaug.core import geometry, registry
from rpaug.core.types import Body, Episode, Scene
from rpaug.scene.recorded import surfels

EYES = {"front": (0.0, -0.8, 0.7), "side": (0.8, -0.2, 0.8), "wrist": (-0.3, -0.5, 0.8)}


@pytest.fixture(scope="module")
def recorded():
    return scene(EYES, length=8, moving="wrist")


@pytest.fixture(scope="module")
def kept(recorded):
    return surfels.build(recorded)


def moved(recorded, name, turn=(0.02, -0.03, 0.04), shift=(0.08, -0.05, 0.06)):
    camera = recorded.cameras[name]
    bump = geometry.rigid(np.array(turn), np.array(shift))
    bumped = replace(camera, cam_to_world=camera.cam_to_world @ bump)
    return replace(recorded, cameras={**recorded.cameras, name: bumped})


def truth(scene_, name, t):
    camera = scene_.cameras[name]
    return shoot(
        camera.K,
        camera.cam_to_world[t],
        camera.width,
        camera.height,
        ball_at(t, scene_.episode.length),
    )


@pytest.mark.parametrize("name", EYES)
def test_an_unmoved_camera_gives_its_recording_bit_for_bit(recorded, kept, name):
    for t in (0, 4, 7):
        drawn, view = surfels.view(kept, recorded, name, t), recorded.episode.views[name]
        np.testing.assert_array_equal(drawn.image, view.rgb(t))
        np.testing.assert_array_equal(drawn.depth, view.depth(t))
        np.testing.assert_array_equal(drawn.ids, view.ids(t))
        assert not drawn.hole.any()


@pytest.mark.parametrize("name", ["front", "wrist"])
def test_a_moved_camera_against_the_truth(recorded, kept, name):
    bumped = moved(recorded, name)
    for t in (0, 4):
        drawn, (rgb, depth, _) = surfels.view(kept, bumped, name, t), truth(bumped, name, t)
        known = ~drawn.hole & (depth > 0)
        error = np.abs(drawn.depth - depth)[known]
        assert np.median(error) <= 1e-4  # metres: what a user is promised
        assert np.mean(error > 0.02) < 0.02
        difference = np.abs(drawn.image.astype(int) - rgb)[known]
        assert np.median(difference) <= 1
        assert drawn.hole.mean() < 0.15


def test_other_cameras_and_other_times_close_holes(recorded, kept):
    """What the front camera never saw behind the ball comes from the side; the table under it from other times."""
    bumped, t = moved(recorded, "front", shift=(0.2, 0.0, 0.0)), 3
    alone = replace(
        bumped, episode=replace(bumped.episode, views={"front": recorded.episode.views["front"]})
    )
    single = surfels.Surfels(static=frozenset(), plates={}, history={})
    own = surfels.view(single, alone, "front", t).hole
    plates = surfels.view(surfels.build(alone), alone, "front", t).hole
    everything = surfels.view(kept, bumped, "front", t).hole
    assert own.sum() > plates.sum() > everything.sum()


def test_plates_hold_static_surfaces_only(recorded, kept):
    assert set(kept.plates) == {"front", "side"}
    assert set(kept.history) == {"wrist"}
    for name, plate in kept.plates.items():
        camera = recorded.cameras[name]
        _, depth, ids = shoot(camera.K, camera.cam_to_world[0], camera.width, camera.height)
        assert set(np.unique(plate.ids)) <= {0, TABLE, BOX}
        np.testing.assert_array_equal(plate.ids[plate.known], ids[plate.known])
        np.testing.assert_allclose(plate.depth[plate.known], depth[plate.known], atol=1e-6)
        assert (plate.known | (ids == 0)).all()  # the ball never rests, so all it hides was seen
    for past in kept.history["wrist"]:
        assert not (past.ids[past.use] == BALL).any()


def test_a_ball_at_another_time_leaves_no_ghost(recorded, kept):
    for t in range(8):
        bumped = moved(recorded, "front")
        drawn, (_, _, ids) = surfels.view(kept, bumped, "front", t), truth(bumped, "front", t)
        ghost = (drawn.ids == BALL) & (ids != BALL) & ~drawn.hole
        assert ghost.sum() <= 0.15 * (ids == BALL).sum()  # its outline, to half a pixel


def test_what_moves_goes_on_beyond_the_border_that_cut_it(recorded):
    """The ball half out of the frame: a camera alone repeats its border, others see through what is not there."""
    wrong = {}
    for names in (["front"], ["front", "side"]):
        few = scene({name: EYES[name] for name in names}, length=8)
        bumped, t = moved(few, "front", turn=(0, 0, 0), shift=(-0.12, 0, 0)), 0
        own = few.episode.views["front"].ids(t)
        assert (own[:, 0] == BALL).any()
        kept = surfels.build(few)
        drawn, (_, _, ids) = surfels.view(kept, bumped, "front", t), truth(bumped, "front", t)
        ball, balls = drawn.ids == BALL, ids == BALL
        still = replace(bumped, bodies=few.bodies[:1])  # no body moves, so nothing is continued
        short = surfels.view(kept, still, "front", t).ids == BALL
        assert (balls & ~ball).sum() < 0.5 * (balls & ~short).sum()
        assert drawn.hole[ball & ~short].all()
        wrong[len(names)] = (ball & ~balls).sum()
    assert wrong[2] < wrong[1]


def test_a_still_of_one_camera():
    lone = scene({"front": EYES["front"]}, length=1)
    drawn = surfels.view(surfels.build(lone), moved(lone, "front"), "front", 0)
    assert np.isfinite(drawn.depth).all()
    assert drawn.hole.mean() < 0.2


def test_masks_are_not_needed(recorded):
    blind = {n: replace(v, ids=None) for n, v in recorded.episode.views.items()}
    bare = replace(recorded, episode=replace(recorded.episode, views=blind), bodies=())
    bumped = moved(bare, "front")
    drawn, (_, depth, _) = (
        surfels.view(surfels.build(bare), bumped, "front", 2),
        truth(bumped, "front", 2),
    )
    known = ~drawn.hole & (depth > 0)
    assert np.median(np.abs(drawn.depth - depth)[known]) <= 1e-4
    assert (drawn.ids == 0).all()


def test_depth_is_needed(recorded):
    flat = {n: replace(v, depth=None) for n, v in recorded.episode.views.items()}
    with pytest.raises(Unsupported, match=r"front.*depth"):
        surfels.build(replace(recorded, episode=replace(recorded.episode, views=flat)))


def test_an_unknown_camera_lists_the_known(recorded, kept):
    with pytest.raises(TargetError, match=r"'rear'.*front, side, wrist"):
        surfels.view(kept, recorded, "rear", 0)


def test_images_are_read_lazily(recorded):
    """A view reads only its own moment."""
    asked = []

    def noted(view):
        return replace(view, rgb=lambda t: (asked.append(t), view.rgb(t))[1])

    views = {name: noted(view) for name, view in recorded.episode.views.items()}
    watched = replace(recorded, episode=replace(recorded.episode, views=views))
    kept = surfels.build(watched)
    asked.clear()
    surfels.view(kept, moved(watched, "front"), "front", 5)
    assert asked == [5, 5, 5]


def test_images_kept_for_all_cameras_of_a_moment_draw_the_same(recorded):
    kept, fresh = surfels.build(recorded), surfels.recorded(recorded)
    for name in ("front", "side"):
        one, other = (surfels.view(each, moved(recorded, name), name, 5) for each in (kept, fresh))
        np.testing.assert_array_equal(one.rgb, other.rgb)
        np.testing.assert_array_equal(one.depth, other.depth)
        np.testing.assert_array_equal(one.ids, other.ids)


@pytest.fixture
def real(samples: Path) -> Scene:
    """The first real recording, with a stand-in for tracked bodies."""
    root, adapter = samples / "rlbench_open_drawer", registry.adapter("rlbench")
    return real_scene(adapter.read(root, adapter.episodes(root)[0]))


def real_scene(episode: Episode) -> Scene:
    """Static is what keeps its depth in the fixed cameras from first to last."""
    still, last = {}, episode.length - 1
    for view in (v for v in episode.views.values() if v.camera.fixed):
        ids = view.ids(0)
        same = (ids == view.ids(last)) & (np.abs(view.depth(0) - view.depth(last)) < 1e-3)
        for instance_id in np.unique(ids):
            still.setdefault(int(instance_id), []).append(same[ids == instance_id])
    static = {h for h, same in still.items() if np.concatenate(same).mean() > 0.7}
    track = np.tile(np.eye(4), (episode.length, 1, 1))
    return Scene(
        episode=episode, cameras={n: v.camera for n, v in episode.views.items()},
        bodies=(Body(frozenset(static), track, "static"),), roles={}, antialiased=False,
        descriptions=episode.descriptions,
    )  # fmt: skip


def test_real_cameras_confirm_each_other(real):
    """The front view drawn from the other cameras alone: its depth is the recorded one."""
    others = {n: v for n, v in real.episode.views.items() if n not in ("front", "wrist")}
    elsewhere: Camera = real.cameras["front"]
    for t in (0, real.episode.length // 2):
        sources = [surfels.source_at(view, t) for view in others.values()]
        drawn = surfels.zbuffer.render(elsewhere.K, elsewhere.cam_to_world[t], (128, 128), sources)
        depth, ids = (
            real.episode.views["front"].depth(t),
            real.episode.views["front"].ids(t),
        )
        seen = ~drawn.hole & (drawn.ids == ids)
        assert seen.mean() > 0.2
        assert np.median(np.abs(drawn.depth - depth)[seen]) < 2e-4


def test_real_unmoved_cameras_give_their_recordings(real):
    kept = surfels.build(real)
    for name, view in real.episode.views.items():
        drawn = surfels.view(kept, real, name, 60)
        np.testing.assert_array_equal(drawn.image, view.rgb(60))
        np.testing.assert_array_equal(drawn.depth, view.depth(60))
        np.testing.assert_array_equal(drawn.ids, view.ids(60))
