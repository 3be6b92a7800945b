"""Twists: their derivative against finite differences, and that a wrong track is put right by a fit."""

from dataclasses import replace

import boxes
import numpy as np
from analysed import analysed
from boxes import BLOCK

from rpaug.core import geometry
from rpaug.gaussians import refine
from rpaug.gaussians.fit import FitSettings, fitted
from rpaug.gaussians.gaussians import quaternions, turned
from rpaug.render.splat import Gradients, Rates, Splats


def test_the_twist_is_the_derivative() -> None:
    rng = np.random.default_rng(0)
    means, quats, g_means, g_quats = (rng.normal(size=(9, k)) for k in (3, 4, 3, 4))
    middle, one = rng.normal(size=3), np.ones((9, 3), np.float32)

    def loss(twist: np.ndarray) -> float:
        motion = refine.about(twist, middle)
        after = turned(quaternions(motion[None, :3, :3])[0], quats)
        return float((geometry.transform(motion, means) * g_means).sum() + (after * g_quats).sum())

    splats = Splats(means, one[:, 0], one[:, None], quats, one)
    gradients = Gradients(g_means, one[:, 0], one[:, None], g_quats, one, None, None, one[:, 0])
    found = refine.twist_of(splats, gradients, slice(None), middle)
    nudges = 1e-6 * np.eye(6)
    slopes = [(loss(nudge) - loss(-nudge)) / 2e-6 for nudge in nudges]
    np.testing.assert_allclose(found, slopes, atol=1e-7)


def test_what_no_image_asks_for_stays_zero() -> None:
    twists = refine.Twists.of([0, 4, 8], 0.1)
    twists.step(4, np.zeros(6), 1.0)
    np.testing.assert_array_equal(twists.at(4), np.zeros(6))


def test_corrections_are_interpolated_between_fitted_frames() -> None:
    twists = refine.Twists.of([0, 4, 8], 0.1)
    twists.step(4, np.array([0, 0, 0, -1.0, 0, 0]), 1.0)
    np.testing.assert_allclose(twists.at(2), twists.at(4) / 2)
    assert twists.at(4)[3] > 0
    np.testing.assert_array_equal(twists.at(0), np.zeros(6))


def test_a_correction_goes_no_further_than_what_is_known_to_be_off() -> None:
    twists = refine.Twists.of([0, 4], 0.1, most=0.002)
    for _ in range(100):
        twists.step(4, np.array([0, -1.0, 0, -1.0, 0.5, 0]), 1.0)
    turn, shift = np.linalg.norm(twists.at(4).reshape(2, 3), axis=1)
    np.testing.assert_allclose([0.1 * turn, shift], 0.002)
    exact = refine.Twists.of([0, 4], 0.1, most=0.0)
    exact.step(4, np.ones(6), 1.0)
    np.testing.assert_array_equal(exact.at(4), np.zeros(6))


def test_a_wrong_track_is_put_right() -> None:
    """The carried block's track is made 8 mm wrong while it is held; a fit finds most of that back."""
    world = boxes.pick_and_place()
    scene = analysed(world.episode())
    true = next(body for body in scene.bodies if BLOCK in body.instance_ids)
    wrong = true.to_world.copy()
    wrong[12:, 0, 3] += 0.008
    moved = replace(true, to_world=wrong, residual=0.008)
    bodies = tuple(moved if b is true else b for b in scene.bodies)
    settings = FitSettings(
        steps=200, train_frames=4, threads=1, checked_frames=1, rates=Rates(means=0.0, quats=0.0)
    )
    found, _ = fitted(replace(scene, bodies=bodies), settings=settings)
    track = next(body for body in found.bodies if BLOCK in body.instance_ids).to_world
    np.testing.assert_allclose(track[0], np.eye(4), atol=1e-12)
    middle = np.array([0.1, -0.12, 0.035])

    def off(poses: np.ndarray) -> float:
        there, truly = (
            np.stack([geometry.transform(p, middle) for p in poses[25:]]),
            np.stack([geometry.transform(p, middle) for p in true.to_world[25:]]),
        )
        return float(np.linalg.norm(there - truly, axis=-1).mean())

    assert off(track) < 0.7 * off(wrong)
