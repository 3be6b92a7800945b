"""Color conversions against published values and as inverses of one another; names of shades."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpaug.core import color_space

channel = st.floats(0.0, 1.0)


@given(st.tuples(channel, channel, channel))
def test_lab_and_back(srgb: tuple[float, float, float]) -> None:
    np.testing.assert_allclose(
        color_space.from_lab(color_space.to_lab(np.array(srgb))), srgb, atol=1e-6
    )


def test_lab_is_opencvs() -> None:
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 6)] * 3), -1).reshape(1, -1, 3)
    theirs = cv2.cvtColor(grid.astype(np.float32), cv2.COLOR_RGB2LAB)
    # OpenCV interpolates the transfer curves from tables.
    np.testing.assert_allclose(color_space.to_lab(grid), theirs, atol=0.3)


def test_white_is_white() -> None:
    np.testing.assert_allclose(color_space.to_lab(np.ones(3)), [100.0, 0.0, 0.0], atol=0.02)


@pytest.mark.parametrize("name", sorted(color_space.NAMES))
def test_a_name_is_its_own_nearest(name: str) -> None:
    assert color_space.nearest(np.array(color_space.rgb(name))) == name
    assert color_space.means(name, name)


@pytest.mark.parametrize(
    ("rgb", "name"),
    [
        ((192, 78, 1), "orange"),  # burnt orange, a carrot's shade
        ((217, 84, 77), "red"),
        ((101, 139, 175), "blue"),  # a dull one, no gray
        ((112, 59, 20), "brown"),
    ],
)
def test_what_people_call_a_color(rgb: tuple[int, int, int], name: str) -> None:
    assert color_space.nearest(np.array(rgb) / 255) == name


def test_rlbench_has_twenty_colors() -> None:
    assert len(color_space.RLBENCH) == 20
    assert color_space.RLBENCH["azure"] == (0.0, 0.5, 1.0)


def test_plain_words_cover_their_shades() -> None:
    assert color_space.means("red", "maroon")
    assert not color_space.means("maroon", "red")
    assert color_space.canonical("Grey") == "gray"
    assert color_space.canonical("cup") is None


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(KeyError, match="there are: azure"):
        color_space.rgb("glaucous")


def test_typical_leaves_out_highlights_and_shadows() -> None:
    pixels = np.full((100, 3), (200, 10, 10), np.uint8)
    pixels[:20], pixels[80:] = 255, 0
    np.testing.assert_allclose(color_space.typical(pixels), np.array([200, 10, 10]) / 255)


def test_typical_of_two_pixels_is_their_mean() -> None:
    pixels = np.array([[40, 40, 40], [60, 60, 60]], np.uint8)
    np.testing.assert_allclose(color_space.typical(pixels), np.full(3, 50) / 255)


# Sharma, Wu, Dalal: The CIEDE2000 Color-Difference Formula (2005), table 1.
SHARMA = """
50.0000 2.6772 -79.7751 50.0000 0.0000 -82.7485 2.0425
50.0000 3.1571 -77.2803 50.0000 0.0000 -82.7485 2.8615
50.0000 2.8361 -74.0200 50.0000 0.0000 -82.7485 3.4412
50.0000 -1.3802 -84.2814 50.0000 0.0000 -82.7485 1.0000
50.0000 -1.1848 -84.8006 50.0000 0.0000 -82.7485 1.0000
50.0000 -0.9009 -85.5211 50.0000 0.0000 -82.7485 1.0000
50.0000 0.0000 0.0000 50.0000 -1.0000 2.0000 2.3669
50.0000 -1.0000 2.0000 50.0000 0.0000 0.0000 2.3669
50.0000 2.4900 -0.0010 50.0000 -2.4900 0.0009 7.1792
50.0000 2.4900 -0.0010 50.0000 -2.4900 0.0010 7.1792
50.0000 2.4900 -0.0010 50.0000 -2.4900 0.0011 7.2195
50.0000 2.4900 -0.0010 50.0000 -2.4900 0.0012 7.2195
50.0000 -0.0010 2.4900 50.0000 0.0009 -2.4900 4.8045
50.0000 -0.0010 2.4900 50.0000 0.0010 -2.4900 4.8045
50.0000 -0.0010 2.4900 50.0000 0.0011 -2.4900 4.7461
50.0000 2.5000 0.0000 50.0000 0.0000 -2.5000 4.3065
50.0000 2.5000 0.0000 73.0000 25.0000 -18.0000 27.1492
50.0000 2.5000 0.0000 61.0000 -5.0000 29.0000 22.8977
50.0000 2.5000 0.0000 56.0000 -27.0000 -3.0000 31.9030
50.0000 2.5000 0.0000 58.0000 24.0000 15.0000 19.4535
50.0000 2.5000 0.0000 50.0000 3.1736 0.5854 1.0000
50.0000 2.5000 0.0000 50.0000 3.2972 0.0000 1.0000
50.0000 2.5000 0.0000 50.0000 1.8634 0.5757 1.0000
50.0000 2.5000 0.0000 50.0000 3.2592 0.3350 1.0000
60.2574 -34.0099 36.2677 60.4626 -34.1751 39.4387 1.2644
63.0109 -31.0961 -5.8663 62.8187 -29.7946 -4.0864 1.2630
61.2901 3.7196 -5.3901 61.4292 2.2480 -4.9620 1.8731
35.0831 -44.1164 3.7933 35.0232 -40.0716 1.5901 1.8645
22.7233 20.0904 -46.6940 23.0331 14.9730 -42.5619 2.0373
36.4612 47.8580 18.3852 36.2715 50.5065 21.2231 1.4146
90.8027 -2.0831 1.4410 91.1528 -1.6435 0.0447 1.4441
90.9257 -0.5406 -0.9208 88.6381 -0.8985 -0.7239 1.5381
6.7747 -0.2908 -2.4247 5.8714 -0.0985 -2.2286 0.6377
2.0776 0.0795 -1.1350 0.9033 -0.0636 -0.5514 0.9082
"""


def test_ciede2000_of_the_published_pairs():
    rows = np.array(SHARMA.split(), float).reshape(34, 7)
    np.testing.assert_allclose(
        color_space.ciede2000(rows[:, :3], rows[:, 3:6]), rows[:, 6], atol=5e-5
    )
    np.testing.assert_allclose(
        color_space.ciede2000(rows[:, 3:6], rows[:, :3]), rows[:, 6], atol=5e-5
    )


@pytest.mark.parametrize(
    ("seen", "word"),
    [((95, 114, 127), "blue"), ((105, 83, 107), "purple"), ((142, 104, 130), "purple")],
)
def test_a_washed_out_color_goes_by_its_hue(seen: tuple[int, int, int], word: str) -> None:
    color = np.array(seen) / 255
    fits = [
        name
        for name in ("red", "orange", "yellow", "green", "blue", "purple")
        if color_space.hued(name, color)
    ]
    assert fits == [word]
    assert not color_space.hued(word, np.full(3, color.mean()))


def test_colors_in_hexadecimal() -> None:
    assert color_space.from_hex("#ff8000") == pytest.approx((1.0, 128 / 255, 0.0))
    assert color_space.from_hex("#F80") == pytest.approx((1.0, 136 / 255, 0.0))
    assert color_space.to_hex((1.0, 0.5, -0.1)) == "#ff8000"
    assert color_space.from_hex("red") is color_space.from_hex("#ff80") is None
    assert color_space.rgb("#000080") == pytest.approx((0, 0, 128 / 255))
    assert color_space.canonical("#fe0000") == "red"


@pytest.mark.parametrize(
    ("word", "name"),
    [("reddish", "red"), ("bluish", "blue"), ("whitish", "white"), ("greenish", "green")],
)
def test_a_shade_is_near_the_color_that_it_is_spelled_by(word: str, name: str) -> None:
    assert color_space.canonical(word) == name
