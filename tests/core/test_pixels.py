"""Widened masks, and the nearest known pixel against a search over all of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpaug.core import pixels


def test_grown_takes_corners():
    mask = np.zeros((7, 7), bool)
    mask[3, 3] = True
    assert pixels.grown(mask, 2).sum() == 25
    assert pixels.grown(mask, 0) is mask


@pytest.mark.parametrize(("window", "slack"), [(3, 0.05), (5, 0.03)])
def test_the_nearest_known_pixel_is_known_and_about_as_near_as_any(window, slack):
    known = np.random.default_rng(0).uniform(size=(40, 50)) < 0.02
    place, away = pixels.nearest(known, window)
    assert known.flat[place].all()
    here = np.stack(np.indices(known.shape), -1).astype(float)
    found = np.stack(np.unravel_index(place, known.shape), -1)
    all_of_them = np.argwhere(known)
    least = np.linalg.norm(here[:, :, None] - all_of_them, axis=-1).min(-1)
    assert (np.linalg.norm(here - found, axis=-1) <= (1 + 2 * slack) * least + 1e-9).all()
    np.testing.assert_allclose(away, least, rtol=2 * slack)


def test_filled_keeps_what_is_known_in_any_shape_and_type():
    known = np.zeros((4, 6), bool)
    known[1, 1] = known[2, 4] = True
    colors = np.arange(72, dtype=np.uint8).reshape(4, 6, 3)
    out = pixels.filled(colors, known)
    assert out.dtype == np.uint8
    np.testing.assert_array_equal(out[known], colors[known])
    np.testing.assert_array_equal(out[0, 0], colors[1, 1])
    np.testing.assert_array_equal(pixels.filled(colors[..., 0], known, 3)[3, 5], colors[2, 4, 0])


def test_differing_and_brightest_are_numpy_s_own():
    rng = np.random.default_rng(0)
    one, other = rng.integers(0, 3, (2, 9, 11, 3), np.uint8)
    assert np.array_equal(pixels.differing(one, other), (one != other).any(-1))
    assert np.array_equal(pixels.brightest(one), one.max(-1))


@settings(max_examples=60, deadline=None)
@given(
    shape=st.tuples(st.integers(1, 33), st.integers(1, 33)),
    share=st.floats(0, 1),
    seed=st.integers(0, 2**16),
)
def test_smoothed_keeps_what_is_known_and_leaves_its_range_nowhere(shape, share, seed):
    rng = np.random.default_rng(seed)
    known = rng.uniform(size=shape) < share
    known[rng.integers(shape[0]), rng.integers(shape[1])] = True
    values = rng.uniform(size=(*shape, 3)).astype(np.float32)
    out = pixels.smoothed(values, known)
    np.testing.assert_array_equal(out[known], values[known])
    low, high = values[known].min(0), values[known].max(0)
    assert (out >= low - 1e-4).all()
    assert (out <= high + 1e-4).all()


def test_of_nothing_nothing_is_continued():
    with pytest.raises(ValueError, match="no pixel is known"):
        pixels.smoothed(np.zeros((3, 4, 3), np.float32), np.zeros((3, 4), bool))
