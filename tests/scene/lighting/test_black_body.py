"""Colors of black bodies: known chromaticities, no jumps, warmer to cooler."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpaug.core import color_space
from rpaug.scene.lighting import black_body

KELVIN = st.floats(1900, black_body.HOTTEST)


def chromaticity(kelvin: float) -> np.ndarray:
    """CIE xy of what `hue` gives, undone step by step."""
    shown = black_body.hue(kelvin)
    xyz = np.linalg.inv(black_body.TO_RGB) @ color_space.to_linear(shown / shown.max())
    return xyz[:2] / xyz.sum()


@pytest.mark.parametrize(
    ("kelvin", "xy"),
    [
        (2856, (0.4476, 0.4074)),  # CIE standard illuminant A
        (4000, (0.3805, 0.3768)),
        (6504, (0.3135, 0.3237)),
        (10_000, (0.2807, 0.2884)),
    ],
)
def test_known_temperatures_have_their_chromaticity(kelvin: float, xy: tuple[float, float]) -> None:
    assert chromaticity(kelvin) == pytest.approx(xy, abs=2e-3)


@given(KELVIN)
def test_hues_are_of_mean_one_without_jumps(kelvin: float) -> None:
    here, beside = black_body.hue(kelvin), black_body.hue(min(kelvin * 1.001, black_body.HOTTEST))
    assert here.mean() == pytest.approx(1)
    assert np.abs(here - beside).max() < 5e-3


@given(KELVIN, KELVIN)
def test_a_hotter_body_is_bluer(one: float, other: float) -> None:
    (cold, hot) = sorted((one, other))
    ratio = [black_body.hue(kelvin)[2] / black_body.hue(kelvin)[0] for kelvin in (cold, hot)]
    assert ratio[0] <= ratio[1] + 1e-9
