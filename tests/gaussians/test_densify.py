"""Splitting and pruning: the image hardly changes, and the unit of length does not matter."""

import dataclasses

import numpy as np
import pytest
from analytic import scene

from rpaug.gaussians.densify import Densify, densified
from rpaug.gaussians.shots import TargetImage, shots_at
from rpaug.render.splat import Adam, Loss, Rasteriser, Splats, engine


@pytest.fixture(scope="module")
def frame() -> tuple[Splats, TargetImage]:
    eyes = {"front": (1.6, 0.3, 1.0)}
    splats, shots = shots_at(scene(eyes, length=1).episode, 0, stride=4)
    return splats, shots[0]


def test_halves_stand_for_the_whole(frame):
    splats, shot = frame
    rng = np.random.default_rng(0)
    splats = dataclasses.replace(splats, opacities=rng.uniform(0.2, 0.9, len(splats)).astype("f4"))
    motion = rng.uniform(0.1, 1, len(splats)).astype(np.float32)
    made, parents = densified(splats, motion, Densify(grow=0.25))
    count = len(splats) // 4
    assert len(made) == len(parents) == len(splats) + count
    split = np.flatnonzero(np.bincount(parents) == 2)
    np.testing.assert_array_equal(split, np.sort(np.argsort(-motion)[:count]))
    middles = [made.means[parents == row].mean(0) for row in split]
    np.testing.assert_allclose(middles, splats.means[split], atol=1e-6)
    before, after = (Rasteriser().forward(s, shot.view).color for s in (splats, made))
    assert np.abs(before - after).mean() < 0.01
    everything_else = np.delete(np.arange(len(splats)), split)
    np.testing.assert_array_equal(made.means[everything_else], splats.means[everything_else])


def test_faint_ones_go_and_what_no_one_pulls_at_is_left_whole(frame):
    splats, _ = frame
    opacities = splats.opacities.copy()
    opacities[::3] = 0.01
    made, parents = densified(
        dataclasses.replace(splats, opacities=opacities), np.zeros(len(splats)), Densify(grow=0.5)
    )
    np.testing.assert_array_equal(parents, np.flatnonzero(opacities > 0.02))
    assert len(made) == len(parents)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_another_unit_splits_the_same(frame, unit):
    splats, shot = frame
    pose = shot.view.world_to_camera.copy()
    pose[:3, 3] *= unit
    scaled = dataclasses.replace(
        splats, means=splats.means * np.float32(unit), scales=splats.scales * np.float32(unit)
    )
    settings = dataclasses.replace(Rasteriser().settings, near=0.01 * unit)
    chosen = []
    for given, view in (
        (splats, shot.view),
        (scaled, dataclasses.replace(shot.view, world_to_camera=pose)),
    ):
        hand = engine(settings=settings if given is scaled else None)
        hand.prepare(given, view)
        slopes = hand.backward_loss(Loss(), 1 - shot.color)[1]
        chosen.append(densified(given, slopes.image_motion, Densify())[1])
    same = len(np.intersect1d(chosen[0][len(splats) :], chosen[1][len(splats) :]))
    assert same > 0.95 * (len(chosen[0]) - len(splats))


def test_torch_tells_about_the_same_motion(frame):
    """From the gradients by the means, where the kernels have it from the image itself."""
    splats, shot = frame
    few, _ = densified(splats, np.zeros(len(splats)), Densify())
    motion = []
    for backend in ("reference", "numba"):
        hand = engine(backend)
        hand.prepare(few, shot.view)
        motion.append(hand.backward_loss(Loss(), 1 - shot.color)[1].image_motion)
    assert np.corrcoef(*motion)[0, 1] > 0.95


def test_moments_go_with_their_gaussians(frame):
    splats, shot = frame
    hand = engine()
    hand.prepare(splats, shot.view)
    slopes = hand.backward_loss(Loss(), 1 - shot.color)[1]
    plain, other = Adam(splats), Adam(splats)
    plain.step(slopes)
    other.step(slopes)
    rows = np.arange(len(splats))[::-1].copy()
    turned = {k: a[rows] for k, a in vars(other.splats).items() if a is not None}
    other.take(dataclasses.replace(other.splats, **turned), rows)
    mixed = {k: a[rows] for k, a in vars(slopes).items() if a is not None}
    plain.step(slopes)
    other.step(dataclasses.replace(slopes, **mixed))
    np.testing.assert_allclose(other.splats.means[rows], plain.splats.means, rtol=1e-6)
    np.testing.assert_allclose(other.splats.opacities[rows], plain.splats.opacities, rtol=1e-5)
