"""Ids of a small image at full size: along the edges that the full image shows, also where the small ids miss them."""

import cv2
import numpy as np
import pytest

from rpaug.scene.video.upsampled import upsampled

SIZE, TIMES = 120, 4


def pictured(colors: dict[int, tuple[int, int, int]]) -> tuple[np.ndarray, np.ndarray]:
    """Full-size ids of a disc and a bar on a plain ground, and a noisy, blurred image of them."""
    rows, columns = np.mgrid[: SIZE * TIMES, : SIZE * TIMES]
    ids = np.full(rows.shape, 1, np.uint16)
    ids[(rows - 200) ** 2 + (columns - 180) ** 2 < 110**2] = 2
    ids[(columns > 330) & (columns < 342)] = 3
    image = np.array([colors.get(one, (0, 0, 0)) for one in range(4)], float)[ids]
    noisy = cv2.GaussianBlur(image, (0, 0), 1.0) + np.random.default_rng(0).normal(
        0, 4, image.shape
    )
    return ids, np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def small(ids: np.ndarray, grown: int) -> np.ndarray:
    """What a small image would be told to show, its things too large by some pixels."""
    told = cv2.resize(ids, (SIZE, SIZE), interpolation=cv2.INTER_NEAREST)
    return cv2.dilate(told, np.ones((2 * grown + 1, 2 * grown + 1)))


@pytest.mark.parametrize("grown", [0, 1, 2])
def test_outlines_lie_where_the_image_has_them(grown: int) -> None:
    ids, image = pictured({1: (150, 120, 90), 2: (200, 60, 50), 3: (60, 90, 180)})
    told = small(ids, grown)
    size = image.shape[1], image.shape[0]
    stepped = (cv2.resize(told, size, interpolation=cv2.INTER_NEAREST) != ids).mean()
    found = upsampled(told, image)
    assert found.dtype == np.int32
    assert (found != ids).mean() < stepped / 2
    assert (found[ids == 3] == 3).mean() > 0.9  # thin as it is


def test_where_colors_do_not_tell_things_apart_outlines_stay_near_the_small_ones() -> None:
    ids, image = pictured({1: (150, 120, 90), 2: (150, 120, 90), 3: (150, 120, 90)})
    assert (upsampled(small(ids, 0), image) != ids)[:, :300].mean() < 0.01


def test_what_is_of_full_size_already_stays() -> None:
    ids, image = pictured({1: (150, 120, 90), 2: (200, 60, 50)})
    assert np.array_equal(upsampled(ids, image), ids)
