"""Outlines that models gave, on the image's edges: where its colors tell, and as they were where they do not."""

import cv2
import numpy as np
import pytest

from rpaug.providers.finder import overlap
from rpaug.scene.instances import image_edges, rgb_things
from rpaug.scene.instances.grouping import AROUND, SUPPORT
from tools.bench import scripted

SIDE = 96


def disc(radius: int, across: int | None = None) -> np.ndarray:
    out = np.zeros((SIDE, SIDE), np.uint8)
    cv2.ellipse(out, (40, 50), (radius, across or radius), 20, 0, 360, 1, -1)
    return out > 0


def photograph(thing: np.ndarray, color: tuple[int, int, int], behind: np.ndarray) -> np.ndarray:
    """A thing before what is behind it, blurred and noisy."""
    drawn = np.where(thing[..., None], np.array(color, np.float32), behind.astype(np.float32))
    noise = np.random.default_rng(3).normal(0, 2.5, drawn.shape)
    return np.clip(cv2.GaussianBlur(drawn, (0, 0), 0.6) + noise, 0, 255).astype(np.uint8)


def table() -> np.ndarray:
    """Two shades that change across the image."""
    return np.full((SIDE, SIDE, 3), (150, 120, 80)) + np.linspace(0, 40, SIDE)[:, None]


@pytest.mark.parametrize("quality", [0.95, 0.9])
def test_an_outline_that_is_off_comes_onto_the_edge(quality: float) -> None:
    true = disc(18, 13)
    image = photograph(true, (180, 40, 40), table())
    rng = np.random.default_rng(1)
    spoilt = [scripted.spoilt(true, quality, rng) for _ in range(5)]
    mended = [image_edges.onto_edges(image, one) for one in spoilt]
    assert np.mean([overlap(one, true) for one in mended]) > 0.97
    assert all(overlap(b, true) >= overlap(a, true) for a, b in zip(spoilt, mended, strict=True))


def test_nothing_is_moved_where_both_sides_look_alike() -> None:
    true = disc(18, 13)
    image = photograph(true, (170, 140, 100), np.full((SIDE, SIDE, 3), (170, 140, 100)))
    spoilt = scripted.spoilt(true, 0.95, np.random.default_rng(1))
    assert overlap(image_edges.onto_edges(image, spoilt), spoilt) > 0.96


def test_a_thing_of_few_pixels_is_left_as_it_was() -> None:
    small = disc(3)
    image = photograph(disc(5), (180, 40, 40), table())
    assert (image_edges.onto_edges(image, small) == small).all()
    nothing = np.zeros_like(small)
    assert (image_edges.onto_edges(image, nothing) == nothing).all()


def test_what_an_outline_leaves_of_the_patch_under_it_goes_with_the_surroundings() -> None:
    resting = np.full((SIDE, SIDE), SUPPORT, np.int32)
    resting[:20] = AROUND
    resting[disc(14)] = 11
    resting[70:90, 70:90] = 12
    there = np.where(disc(12), 200_000, 0).astype(np.int32)
    there[70:75, 70:75] = 200_001
    ids = rgb_things._under(resting, there)
    assert set(np.unique(ids[disc(14)])) == {SUPPORT, 200_000}
    assert (ids[:20] == AROUND).all()
    assert (ids[76:90, 76:90] == 12).all()
