"""Albedo read off very many pixels: some of them, evenly spread, tell what all do."""

import numpy as np
import pytest

from rpaug.scene.lighting import albedo


def test_some_of_many_pixels_tell_what_all_do(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    color, count = np.array([0.6, 0.3, 0.2]), 3 * 4096 + 5
    seen = color * rng.uniform(0.4, 1.0, (count, 1)) + rng.normal(0, 0.004, (count, 3))
    whole = albedo.estimate(seen)
    monkeypatch.setattr(albedo, "MOST_PIXELS", 4096)
    some = albedo.estimate(seen)
    assert some.plain
    assert np.abs(np.array(some.rgb) - whole.rgb).max() < 2 / 255
    assert some.rgb == albedo.estimate(seen[::4]).rgb


def test_a_pixel_near_a_grayish_hue_is_no_darker_hue_under_much_white() -> None:
    """A beige pad in a brown rim came out with specks that kept their color."""
    hues = [(0.56, 0.48, 0.38), (0.32, 0.13, 0.07)]
    beige = np.array([hues[0], (0.60, 0.53, 0.46)], np.float32)
    lit = np.array([hues[1]], np.float32) + np.float32(0.3)
    assert not albedo.highlights(beige, hues).any()
    assert albedo.highlights(lit, hues) == pytest.approx(0.3, abs=0.01)
    assert albedo.highlights(beige, hues[1:])[1] > albedo.HIGHLIGHT
    assert albedo.owners(np.concatenate([beige, lit]), hues).tolist() == [0, 0, 1]
