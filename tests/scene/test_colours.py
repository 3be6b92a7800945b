"""Colour conversions against published values and as inverses of one another; names of shades."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpaug.scene import colours

channel = st.floats(0.0, 1.0)


@given(st.tuples(channel, channel, channel))
def test_lab_and_back(srgb: tuple[float, float, float]) -> None:
    np.testing.assert_allclose(colours.from_lab(colours.to_lab(np.array(srgb))), srgb, atol=1e-6)


def test_lab_is_opencvs() -> None:
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 6)] * 3), -1).reshape(1, -1, 3)
    theirs = cv2.cvtColor(grid.astype(np.float32), cv2.COLOR_RGB2LAB)
    # OpenCV interpolates the transfer curves from tables.
    np.testing.assert_allclose(colours.to_lab(grid), theirs, atol=0.3)


def test_white_is_white() -> None:
    np.testing.assert_allclose(colours.to_lab(np.ones(3)), [100.0, 0.0, 0.0], atol=0.02)


@pytest.mark.parametrize("name", sorted(colours.NAMES))
def test_a_name_is_its_own_nearest(name: str) -> None:
    assert colours.nearest(np.array(colours.rgb(name))) == name
    assert colours.means(name, name)


def test_rlbench_has_twenty_colours() -> None:
    assert len(colours.RLBENCH) == 20
    assert colours.RLBENCH["azure"] == (0.0, 0.5, 1.0)


def test_plain_words_cover_their_shades() -> None:
    assert colours.means("red", "maroon")
    assert not colours.means("maroon", "red")
    assert colours.canonical("Grey") == "gray"
    assert colours.canonical("cup") is None


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(KeyError, match="there are: azure"):
        colours.rgb("mauve-ish")


def test_typical_leaves_out_highlights_and_shadows() -> None:
    pixels = np.full((100, 3), (200, 10, 10), np.uint8)
    pixels[:20], pixels[80:] = 255, 0
    np.testing.assert_allclose(colours.typical(pixels), np.array([200, 10, 10]) / 255)
