"""Fitting with the CPU kernels: it converges, in any unit of length, and to the same bits every time."""

import dataclasses

import numpy as np
import pytest
from splat_cases import splats, view

from rpaug.render.splat import Adam, Gradients, Rasteriser, Rates, Settings, Splats, View


def fit(given: Splats, target: np.ndarray, at: View, settings: Settings, steps: int) -> list[float]:
    """Mean squared errors along a fit to one image."""
    engine, optimiser, errors = Rasteriser(settings), Adam(given), []
    for _ in range(steps):
        engine.forward(optimiser.splats, at, surface=False)
        error, _, slopes = engine.backward_squared_error(target)
        optimiser.step(slopes)
        errors.append(error)
    return errors


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_a_scene_in_another_unit_converges_alike(unit):
    at, steps = view(), 40
    target = Rasteriser().forward(splats(150, 1), at).color
    start = splats(150, 2)
    plain = fit(start, target, at, Settings(), steps)
    scaled = dataclasses.replace(
        start, means=start.means * np.float32(unit), scales=start.scales * np.float32(unit)
    )
    other = fit(scaled, target, at, Settings(near=0.01 * unit), steps)
    assert plain[-1] < 0.3 * plain[0]
    assert other[-1] == pytest.approx(plain[-1], rel=0.05)


def test_given_splats_are_left_as_they_were_and_steps_repeat_exactly():
    given, at = splats(60, 3, harmonics=4), view()
    kept = {name: array.copy() for name, array in vars(given).items() if array is not None}
    target = np.full((at.height, at.width, 3), 0.5, np.float32)
    assert fit(given, target, at, Settings(), 5) == fit(given, target, at, Settings(), 5)
    for name, array in kept.items():
        np.testing.assert_array_equal(getattr(given, name), array)


def test_first_step_moves_each_value_by_its_rate():
    """Adam's first step is rate * sign(gradient), in each parameter's own space."""
    given = splats(4)
    ones = {
        name: None if a is None else np.ones(a.shape, np.float32) for name, a in vars(given).items()
    }
    rates = Rates(means=0.5, scales=0.1, opacities=0.2, sh=0.3, quats=0.0)
    optimiser = Adam(given, rates, size=2.0)
    optimiser.step(Gradients(**ones, image_motion=np.zeros(4, np.float32)))
    after = optimiser.splats
    np.testing.assert_allclose(after.means, given.means - 1.0, atol=1e-5)
    np.testing.assert_allclose(np.log(after.scales), np.log(given.scales) - 0.1, atol=1e-5)
    np.testing.assert_allclose(after.sh, given.sh - 0.3, atol=1e-5)
    np.testing.assert_array_equal(after.quats, given.quats)
    logit = [np.log(o / (1 - o)) for o in (given.opacities, after.opacities)]
    np.testing.assert_allclose(logit[1], logit[0] - 0.2, atol=1e-4)


@pytest.mark.parametrize("threads", [2, 3, 5])
def test_threads_do_not_change_a_step(threads):
    """Wherever a thread begins, each number moves by its own rate."""
    given, rng = splats(500, harmonics=4), np.random.default_rng(0)
    slopes = {
        name: None if a is None else rng.normal(size=a.shape).astype(np.float32)
        for name, a in vars(given).items()
    }
    alone, several = Adam(given), Adam(given, threads=threads)
    for one in (alone, several):
        one.step(Gradients(**slopes, image_motion=np.zeros(500, np.float32)))
    for name, array in vars(alone.splats).items():
        if array is not None:
            np.testing.assert_array_equal(getattr(several.splats, name), array)


def test_a_gradient_that_is_not_finite_moves_nothing():
    given = splats(3)
    slopes = {
        name: None if a is None else np.full(a.shape, np.nan, np.float32)
        for name, a in vars(given).items()
    }
    optimiser = Adam(given)
    optimiser.step(Gradients(**slopes, image_motion=np.zeros(3, np.float32)))
    np.testing.assert_array_equal(optimiser.splats.means, given.means)
