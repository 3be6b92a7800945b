"""Fits of one moment: they converge, stop as told, repeat exactly, and do not depend on the unit of length."""

import dataclasses

import numpy as np
import pytest
from analytic import scene

from rpaug.core.errors import Unsupported
from rpaug.gaussians.densify import Densify
from rpaug.gaussians.frame_fit import FrameFitSettings, fit_views
from rpaug.gaussians.shots import TargetImage, shots_at
from rpaug.render.splat import Loss, Settings, Splats

EYES = {"front": (1.6, 0.3, 1.0), "overhead": (0.1, -0.9, 1.5), "side": (0.4, 1.4, 0.9)}
SHORT = FrameFitSettings(iterations=30, check_every=10, stop="iterations", threads=1)


@pytest.fixture(scope="module")
def frame() -> tuple[Splats, tuple[TargetImage, ...]]:
    return shots_at(scene(EYES, length=1).episode, 0, stride=3)


def test_pixels_kept_back_seed_nothing_and_teach_nothing(frame):
    splats, shots = frame
    lattice = np.zeros(shots[0].held.shape, bool)
    lattice[::3, ::3] = True
    every = shots_at(scene(EYES, length=1).episode, 0, stride=3, hold_out=0)[0]
    assert 0.85 * len(every) < len(splats) < 0.95 * len(every)
    assert all((shot.held | ~shot.judged).all() for shot in shots)
    spoilt = [
        dataclasses.replace(shot, color=np.where(shot.held[..., None], np.float32(0.5), shot.color))
        for shot in shots
    ]
    loss = dataclasses.replace(SHORT, loss=Loss(l1=0.3, ssim=0.1))
    found, expected = fit_views(splats, spoilt, loss), fit_views(splats, shots, loss)
    np.testing.assert_array_equal(found.splats.means, expected.splats.means)


def test_judged_pixels_are_seen_by_another_camera():
    alone = {"front": EYES["front"]}
    assert not any(shot.judged.any() for shot in shots_at(scene(alone, length=1).episode, 0)[1])
    share = [s.judged.sum() / s.held.sum() for s in shots_at(scene(EYES, length=1).episode, 0)[1]]
    assert all(0.3 < s < 1 for s in share)


def test_the_trace_rises_and_its_numbers_are_those_of_the_result(frame):
    splats, shots = frame
    given: list[int] = []
    fit = fit_views(splats, shots, SHORT, lambda point: given.append(point.iteration))
    assert given == [point.iteration for point in fit.trace] == [0, 10, 20, 30]
    decibels = [point.recorded_db for point in fit.trace]
    assert decibels == sorted(decibels)
    assert decibels[-1] > decibels[0] + 5
    assert fit.trace[-1].held_out_db > fit.trace[0].held_out_db + 2
    again = fit_views(fit.splats, shots, dataclasses.replace(SHORT, iterations=0))
    assert again.trace[0].recorded_db == pytest.approx(decibels[-1], abs=1e-6)


def test_fidelity_stops_where_the_decibels_are_reached(frame):
    splats, shots = frame
    wanted = dataclasses.replace(SHORT, stop="fidelity", target_db=25.0, check_every=2)
    fit = fit_views(splats, shots, wanted)
    assert fit.stopped == "fidelity"
    assert fit.trace[-1].recorded_db >= 25 > fit.trace[-2].recorded_db


def test_heldout_stops_when_unseen_pixels_stop_improving_and_returns_the_best(frame):
    splats, shots = frame
    patient = FrameFitSettings(iterations=400, check_every=10, patience=2, threads=1, rate=4.0)
    fit = fit_views(splats, shots, patient)
    assert fit.stopped == "heldout"
    assert fit.best < len(fit.trace) - 1
    best = fit.trace[fit.best].held_out_db
    assert best == max(point.held_out_db for point in fit.trace)
    again = fit_views(fit.splats, shots, dataclasses.replace(SHORT, iterations=0))
    assert again.trace[0].held_out_db == pytest.approx(best, abs=1e-6)


def test_heldout_needs_something_to_judge_by(frame):
    splats, shots = frame
    none = [
        dataclasses.replace(s, held=np.zeros_like(s.held), judged=np.zeros_like(s.held))
        for s in shots
    ]
    with pytest.raises(Unsupported, match="kept back"):
        fit_views(splats, none)


def test_splitting_where_the_residual_asks_helps(frame):
    splats, shots = frame
    few = dataclasses.replace(SHORT, iterations=60)
    wanted = dataclasses.replace(few, densify=Densify(every=10, grow=0.1))
    fixed = fit_views(splats, shots, dataclasses.replace(few, densify=None))
    grown = fit_views(splats, shots, wanted)
    assert fixed.trace[-1].gaussians == len(splats)
    assert grown.trace[-1].gaussians > 1.2 * len(splats)
    assert grown.trace[-1].recorded_db > fixed.trace[-1].recorded_db


def test_threads_do_not_change_a_bit(frame):
    splats, shots = frame
    fits = [
        fit_views(
            splats, shots, dataclasses.replace(SHORT, threads=threads, densify=Densify(every=10))
        )
        for threads in (1, 2, 4)
    ]
    for fit in fits[1:]:
        np.testing.assert_array_equal(fit.splats.means, fits[0].splats.means)
        np.testing.assert_array_equal(fit.splats.sh, fits[0].splats.sh)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_a_scene_in_another_unit_converges_alike(frame, unit):
    splats, shots = frame
    scaled = dataclasses.replace(
        splats, means=splats.means * np.float32(unit), scales=splats.scales * np.float32(unit)
    )
    moved = []
    for shot in shots:
        pose = shot.view.world_to_camera.copy()
        pose[:3, 3] *= unit
        view = dataclasses.replace(shot.view, world_to_camera=pose)
        moved.append(dataclasses.replace(shot, view=view, depth=shot.depth * np.float32(unit)))
    with_depth = dataclasses.replace(SHORT, loss=Loss(depth=1.0))
    near = Settings(near=0.01 * unit)
    plain = fit_views(splats, shots, with_depth)
    other = fit_views(scaled, moved, dataclasses.replace(with_depth, model=near))
    for a, b in zip(plain.trace, other.trace, strict=True):
        assert b.recorded_db == pytest.approx(a.recorded_db, abs=0.1)
        assert b.held_out_db == pytest.approx(a.held_out_db, abs=0.1)


def test_backends_agree():
    """Two steps by the kernels, and by the reference in both precisions.

    Adam moves a parameter whose gradient is nothing but rounding as far as any other: 0.1 dB.
    """
    splats, shots = shots_at(scene(dict(list(EYES.items())[:2]), length=1).episode, 0, stride=16)
    few = dataclasses.replace(
        SHORT, iterations=2, check_every=2, loss=Loss(l1=0.2, ssim=0.1, depth=0.5)
    )
    few, shots = dataclasses.replace(few, batch=1), shots[:1]
    plain = fit_views(splats, shots, few)
    for dtype in ("float32", "float64"):
        slow = dataclasses.replace(few, backend="reference", dtype=dtype)
        for a, b in zip(plain.trace, fit_views(splats, shots, slow).trace, strict=True):
            assert b.recorded_db == pytest.approx(a.recorded_db, abs=0.1)


def test_what_cannot_be_is_refused(frame):
    splats, shots = frame
    with pytest.raises(Unsupported, match="reference"):
        fit_views(splats, shots, dataclasses.replace(SHORT, dtype="float64"))
    with pytest.raises(ValueError, match="heldout, fidelity"):
        FrameFitSettings(stop="never")
