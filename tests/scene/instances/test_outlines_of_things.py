"""Outlines of things, cut anew by their colors."""

import cv2
import numpy as np

from rpaug.scene.instances import outlines
from rpaug.scene.instances.grouping import MOVING, SUPPORT

THING = 7


def scene() -> tuple[np.ndarray, np.ndarray]:
    """A red disc with a shaded half on a blue table, and where it is."""
    down, right = np.mgrid[0:64, 0:64]
    true = (down - 30) ** 2 + (right - 34) ** 2 < 11**2
    image = np.empty((64, 64, 3), float)
    image[:] = (90, 140, 190)
    image[true] = (200, 30, 30)
    image[true & (right > 38)] = (130, 18, 18)
    image += np.random.default_rng(0).normal(0, 3, image.shape)
    return np.clip(image, 0, 255).astype(np.uint8), true


def iou(one: np.ndarray, other: np.ndarray) -> float:
    return (one & other).sum() / (one | other).sum()


def test_a_thing_is_ended_where_its_colors_do() -> None:
    image, true = scene()
    small = cv2.erode(true.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    ids = np.where(small, THING, SUPPORT).astype(np.int32)
    cut = outlines.cut(image, ids)
    assert iou(ids == THING, true) < 0.75
    assert iou(cut == THING, true) > 0.85
    assert set(np.unique(cut)) == {SUPPORT, THING}
    assert np.array_equal(cut, outlines.cut(image, ids))


def test_what_was_too_much_is_given_back_and_what_moves_is_never_taken() -> None:
    image, true = scene()
    large = cv2.dilate(true.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    ids = np.where(large, THING, SUPPORT).astype(np.int32)
    ids[:, :30] = MOVING
    cut = outlines.cut(image, ids)
    assert iou(cut == THING, true & (ids != MOVING)) > 0.9
    assert np.array_equal(cut == MOVING, ids == MOVING)


def test_a_thing_of_its_surroundings_color_is_left_as_it_was() -> None:
    image = np.full((40, 40, 3), 120, np.uint8)
    ids = np.full((40, 40), SUPPORT, np.int32)
    ids[10:20, 10:20] = THING
    assert (outlines.cut(image, ids) == THING).sum() >= 60
