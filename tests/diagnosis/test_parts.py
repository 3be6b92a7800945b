"""Two things that touch are parted; one thing is not, whatever its shading or pattern."""

import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rpaug.diagnosis import parts

RED, BLUE, GREEN = (0.8, 0.1, 0.1), (0.1, 0.2, 0.8), (0.1, 0.6, 0.2)


def lab(image: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(image.astype(np.float32), cv2.COLOR_RGB2Lab)


def canvas(*squares: tuple[int, int, tuple[float, float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """A picture with squares of 16 pixels, and where they are."""
    image, mask = np.zeros((64, 64, 3)), np.zeros((64, 64), bool)
    for y, x, color in squares:
        image[y : y + 16, x : x + 16] = color
        mask[y : y + 16, x : x + 16] = True
    return image, mask


def test_things_that_touch_are_parted() -> None:
    image, mask = canvas((8, 20, RED), (24, 20, BLUE), (40, 20, GREEN))
    found = parts.parted(mask, lab(image))
    assert sorted(int(one.sum()) for one in found) == [256, 256, 256]
    assert not (found[0] & found[1]).any()


def test_a_shaded_thing_is_one() -> None:
    image, mask = canvas((8, 20, RED), (24, 20, tuple(0.45 * np.array(RED))))
    assert len(parts.parted(mask, lab(image))) == 1


def test_a_pattern_is_one_thing() -> None:
    image, mask = canvas((8, 20, RED))
    rows, columns = np.mgrid[:64, :64]
    image[mask & ((rows // 2 + columns // 2) % 2 == 0)] = BLUE
    assert len(parts.parted(mask, lab(image))) == 1


@settings(max_examples=30, deadline=None)
@given(
    st.tuples(*[st.floats(0.2, 1.0)] * 3),
    st.floats(0.4, 1.0),
)
def test_shading_leaves_the_hue(color: tuple[float, float, float], light: float) -> None:
    linear = np.array(color)
    both = np.stack([linear, light * linear])
    shown = np.where(both <= 0.0031308, 12.92 * both, 1.055 * both ** (1 / 2.4) - 0.055)
    first, second = parts.hue(lab(shown[None]))[0]
    assert (
        np.abs(first - second).max() < 1.5
    )  # OpenCV's table of cube roots; two colors are 22 apart


def test_opening_leaves_a_thing_where_it_is() -> None:
    _, mask = canvas((8, 20, RED))
    speckled = mask.copy()
    speckled[2, 2] = speckled[40, 5:30] = True
    assert (parts.opened(speckled) == mask).all()


def test_an_outline_is_thin() -> None:
    _, mask = canvas((8, 20, RED))
    inner = cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    assert not parts.thin(mask)
    assert parts.thin(mask & ~inner)
