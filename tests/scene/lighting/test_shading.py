"""Shading is told from an old pattern: light and shadow stay, the pattern goes, and a plain surface needs no fit."""

import json
from dataclasses import replace

import numpy as np
import pytest

from rpaug.scene.lighting import shading
from rpaug.scene.lighting.shading import ShadedPixels, Smooth

RNG = np.random.default_rng(0)
ALBEDO = (0.8, 0.6, 0.4)


def board(
    pattern: float, fall: float = 0.0, count: int = 4000
) -> tuple[ShadedPixels, np.ndarray, np.ndarray]:
    """A level board whose light changes by `fall` a metre, a tenth of it in shadow: samples, light, shadow mask."""
    points = RNG.uniform([-0.5, -0.4, 0.7], [0.5, 0.4, 0.7], (count, 3)).astype(np.float32)
    normals = np.tile(np.float32([0, 0, 1]), (count, 1))
    light = 0.6 + fall * (points[:, 0] - points[:, 1] ** 2)
    shadow = (np.abs(points[:, 0] - 0.2) < 0.1) & (points[:, 1] > 0)
    light = np.where(shadow, 0.3 * light, light)
    grain = np.exp(pattern * RNG.standard_normal(count))
    color = np.clip((light * grain)[:, None] * np.array(ALBEDO), 0, 1).astype(np.float32)
    return ShadedPixels(color, points, normals, normals), light, shadow


def test_a_plain_surface_keeps_its_measured_shading() -> None:
    assert shading.fit(board(0.0)[0], ALBEDO) is None


@pytest.mark.parametrize(("pattern", "fall"), [(0.08, 0.7), (0.08, 0.0), (0.2, 0.0)])
def test_a_pattern_goes_and_light_and_shadow_stay(pattern: float, fall: float) -> None:
    samples, light, shadow = board(pattern, fall)
    smooth = shading.fit(samples, ALBEDO)
    assert smooth is not None
    assert smooth.spread == pytest.approx(pattern, rel=0.25)
    old = np.array(ALBEDO)
    measured = samples.color @ old / (old @ old)
    out = smooth.of(measured, smooth.fitted(samples.points, samples.facing))
    assert np.median(np.abs(out / light - 1)[~shadow]) < 0.06
    assert np.std(np.log(out / light)[~shadow]) < 0.4 * pattern + 0.02
    assert out[shadow].mean() < 0.75 * light[~shadow].mean()
    known = replace(smooth, casts=False).of(measured, smooth.fitted(samples.points, samples.facing))
    assert known[shadow].mean() > 0.85 * light[shadow].mean()  # what is darker is pattern then


@pytest.mark.parametrize("bend", [-1.0, 1.0])
def test_only_what_falls_off_all_around_is_taken_for_light(bend: float) -> None:
    """A lamp's pool is brightest in one spot; broad grain may as well be darkest there."""
    samples, *_ = board(0.05)
    curve = 1 + bend * (samples.points[:, :1] ** 2 + samples.points[:, 1:2] ** 2)
    smooth = shading.fit(replace(samples, color=samples.color * curve), ALBEDO)
    assert smooth is not None
    assert any(smooth.weights[shading.BY_NORMAL :]) == (bend < 0)


def test_it_can_be_stored_as_plain_values() -> None:
    smooth = shading.fit(board(0.2)[0], ALBEDO)
    assert smooth is not None
    assert Smooth(**json.loads(json.dumps(smooth.describe()))).spread == smooth.spread


@pytest.mark.parametrize("bearing", [0.0, 0.3, -0.6])
def test_the_frame_turns_to_the_side_faces(bearing: float) -> None:
    angle = bearing + np.pi / 2 * RNG.integers(0, 4, 400)
    normals = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1).astype(np.float32)
    points = (normals * 0.2 + [1, 2, 0.5]).astype(np.float32)
    back = shading.frame({1: ShadedPixels(normals, points, normals, normals)})
    turned = normals @ back[:3, :3].T
    assert np.abs(np.abs(turned).max(1) - 1).max() < 1e-5
    assert np.allclose(back @ [*np.percentile(points, [1, 99], axis=0).mean(0), 1], [0, 0, 0, 1])


def test_broad_grain_is_no_light() -> None:
    samples, light, shadow = board(0.05)
    grain = 1 + 0.2 * np.sin(9 * samples.points[:, :1])
    smooth = shading.fit(
        ShadedPixels(samples.color * grain, samples.points, samples.normals, samples.facing),
        ALBEDO,
    )
    assert smooth is not None
    fitted = smooth.fitted(samples.points, samples.facing)
    out = smooth.of(light.astype(np.float32), fitted)
    assert np.std(np.log(out)[~shadow]) < 0.03


def test_the_best_lit_part_is_fully_lit_where_the_albedo_is_a_guess() -> None:
    samples, _light, shadow = board(0.2)
    guess = (0.4, 0.3, 0.2)  # half as bright as it is
    smooth = shading.fit(samples, guess, known=False)
    assert smooth is not None
    measured = samples.color @ np.array(guess) / np.dot(guess, guess)
    out = smooth.of(measured, smooth.fitted(samples.points, samples.facing))
    assert np.median(out[~shadow]) == pytest.approx(1, abs=0.03)
    assert out[shadow].mean() < 0.75


def test_a_black_metal_stays_black() -> None:
    found = shading._as_metal({"albedo": [0.0, 0.0, 0.0]}, None)
    assert found["albedo"] == [0.0, 0.0, 0.0]
    assert found["of_metal"]
