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
