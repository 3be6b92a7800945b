"""Numbers of an image that say something of a surface say the same of it under another lamp."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpaug.diagnosis import sight


def drawn(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A rough surface in CIELAB, and a ragged region of it."""
    rng = np.random.default_rng(seed)
    lab = rng.normal([60, 8, -5], [6, 3, 3], (24, 30, 3)).astype(np.float32)
    return lab, rng.random((24, 30)) < 0.7


@given(st.integers(0, 50), st.floats(0.6, 1.5))
def test_a_pattern_is_relative_to_its_own_lightness(seed: int, gain: float) -> None:
    """CIELAB grows evenly with the cube root of the light: a surface twice as light varies twice as much."""
    lab, region = drawn(seed)
    there = sight._pattern(np.float32(gain) * lab, region)
    np.testing.assert_allclose(there, sight._pattern(lab, region), rtol=1e-4)


@pytest.mark.parametrize("axis", [0, 1])
def test_the_pattern_of_stripes(axis: int) -> None:
    """Stripes of 40 and 60: a deviation of 10 from 50, and steps of 20 across, none along."""
    lab = np.zeros((20, 20, 3), np.float32)
    lab[..., 0] = np.where(np.indices((20, 20))[axis] % 2, 60, 40)
    spread, steps = sight._pattern(lab, np.ones((20, 20), bool))
    assert spread == pytest.approx(10 / 50)
    assert steps == pytest.approx(20 / 50 / 2)


def test_nothing_of_the_rest_of_the_image_tells() -> None:
    lab, region = drawn(0)
    other = np.where(region[..., None], lab, np.float32(1000))
    np.testing.assert_array_equal(sight._pattern(other, region), sight._pattern(lab, region))
    alone = np.zeros((24, 30), bool)
    alone[::2, ::2] = True  # no two side by side: no step is known
    assert sight._pattern(lab, alone)[1] == 0
