"""Normals of what rests are the same in all frames, whatever passes beside it."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import BALL, BOX, TABLE, scene, seen_by

from rpaug import Scene
from rpaug.compose import views
from rpaug.operators.light_direction import Relight
from rpaug.scene.lighting.light import Lamp
from rpaug.scene.recorded import pooled, surface

EYES = {"front": (1.6, 0.3, 1.0), "side": (0.8, -0.9, 0.8)}
LENGTH = 9


def facing(recorded: Scene, name: str, t: int, pool: pooled.Pool | None) -> np.ndarray:
    """World normals of a whole image."""
    view = recorded.episode.views[name]
    given = None if pool is None else lambda: pool
    at = surface.of_view(view, t, recorded.bodies, view.ids(t), given)
    return at(np.arange(view.ids(t).size)).facing.reshape(*view.ids(t).shape, 3)


def flicker(recorded: Scene, name: str, pool: pooled.Pool | None) -> float:
    """The most that a component of a resting surface's normal changes from one frame to the next."""
    most, ids = 0.0, recorded.episode.views[name].ids
    for t in range(LENGTH - 1):
        same = (ids(t) == ids(t + 1)) & np.isin(ids(t), [TABLE, BOX])
        step = facing(recorded, name, t, pool) - facing(recorded, name, t + 1, pool)
        most = max(most, float(np.abs(step[same]).max()))
    return most


@pytest.mark.parametrize("name", list(EYES))
def test_normals_beside_what_passes_do_not_change(name: str) -> None:
    recorded = scene(EYES, length=LENGTH)
    assert flicker(recorded, name, None) > 0.1
    assert flicker(recorded, name, pooled.of_camera(recorded.episode, name)) == 0.0


def test_what_moves_keeps_the_normals_of_its_own_frame() -> None:
    recorded = scene(EYES, length=LENGTH)
    pool = pooled.of_camera(recorded.episode, "front")
    for t in (0, LENGTH // 2):
        ball = recorded.episode.views["front"].ids(t) == BALL
        alone, together = (facing(recorded, "front", t, one)[ball] for one in (None, pool))
        assert np.median(np.abs(alone - together)) == 0.0


def test_noise_is_averaged_where_nothing_moves() -> None:
    rng = np.random.default_rng(0)
    grains: dict[tuple[str, int], np.ndarray] = {}

    def noisy(name, t, rgb, depth, ids):  # type: ignore[no-untyped-def]
        grain = grains.setdefault((name, t), rng.normal(0, 0.002, depth.shape))
        return rgb, (depth * (1 + grain)).astype(np.float32), ids

    recorded = seen_by(scene(EYES, length=LENGTH), noisy)
    pool = pooled.of_camera(recorded.episode, "front")
    table = recorded.episode.views["front"].ids(0) == TABLE
    alone, together = (
        np.abs(facing(recorded, "front", 0, one)[table] - [0, 0, 1]).mean() for one in (None, pool)
    )
    assert together < 0.6 * alone


def test_a_place_that_is_shown_for_one_frame_is_kept_while_others_pass() -> None:
    """One frame of table, two frames each of what passes: four things, one after the other."""

    def passed(name, t, rgb, depth, ids):  # type: ignore[no-untyped-def]
        nearer = 0 if t == 0 else 1 + (t - 1) // 2
        return rgb, np.where(ids == TABLE, depth - 0.1 * nearer, depth), ids + 1000 * nearer

    recorded = seen_by(scene(EYES, length=LENGTH), passed)
    pool = pooled.of_camera(recorded.episode, "front")
    table = recorded.episode.views["front"].ids(0) == TABLE
    assert (pool.ids[table] == TABLE).any(-1).all()


def test_a_camera_that_moves_pools_nothing() -> None:
    recorded = scene(EYES, length=LENGTH, moving="side")
    assert not pooled.of_camera(recorded.episode, "side").ids.size
    assert pooled.of_camera(recorded.episode, "front").ids.size


def test_a_new_light_changes_no_pixel_that_the_recording_repeats() -> None:
    lamps = (Lamp((0.5, -0.4, 0.77), 0.3, 1.0), Lamp((-0.6, 0.3, 0.74), 0.3, 1.0))
    recorded = scene(EYES, length=LENGTH)
    relit = replace(recorded, appearance=(Relight(*lamps, ((TABLE, 1.0),)),))
    shown = views.edited(relit, dict.fromkeys(EYES, 0), lambda frame: None)
    for name, view in recorded.episode.views.items():
        for t in range(LENGTH - 1):
            still = (view.ids(t) == view.ids(t + 1)) & (view.ids(t) != BALL)
            after = shown.views[name].rgb
            assert np.array_equal(after(t)[still], after(t + 1)[still])


def test_pixels_left_out_since_nothing_changed_leave_the_same_pool(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A ball that passes, stops for two frames and passes on, over grain that comes and goes."""
    grain = np.random.default_rng(0).normal(
        0, 1e-5, (LENGTH, *np.shape(scene(EYES).episode.views["front"].ids(0)))
    )

    def held(name, t, rgb, depth, ids):  # type: ignore[no-untyped-def]
        return rgb, (depth * (1 + (t % 3 == 1) * grain[t])).astype(np.float32), ids

    recorded = seen_by(scene(EYES, length=LENGTH), held)
    fast = pooled.of_camera(recorded.episode, "front")
    monkeypatch.setattr(pooled, "_forget", lambda *frames: frames[-1].fill(0))
    whole = pooled.of_camera(replace(recorded.episode), "front")
    assert np.array_equal(fast.ids, whole.ids)
    assert np.array_equal(fast.depths, whole.depths)
