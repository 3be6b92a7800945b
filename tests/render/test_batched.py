"""Many images at once by torch: as `rpaug.render` composites each of them alone."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import torch
from devices import DEVICES
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rpaug.render import composite as one_by_one
from rpaug.render.batched import composite, matting
from rpaug.render.batched.pixels import Pixels
from rpaug.render.matting import matte

IMAGES = arrays(np.uint8, (3, 9, 11, 3))
LABELS = arrays(np.int32, (3, 9, 11), elements=st.integers(0, 3))
SHARE_OFF = 1e-4  # by which shares may differ; ties between two explanations apart


@dataclass(frozen=True)
class Scaled:
    """Colors times a factor, given for one image and for many."""

    instance_ids: frozenset[int] | None
    factor: float = 0.5
    unlit: tuple[int, ...] = ()

    def __call__(self, color: np.ndarray, surface: object) -> np.ndarray:
        return color * np.float32(self.factor)

    @staticmethod
    def stacked(several: Sequence["Scaled"], device: torch.device) -> Any:
        factors = torch.tensor([edit.factor for edit in several], device=device)
        return lambda color, which, surface: color * factors[which, None]


def scenes(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Images of soft discs of a few colors over a ramp, and which pixels each covers."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[:40, :48].astype(np.float64)
    images, labels = [], []
    for _ in range(4):
        image = np.stack([rows / 80, columns / 90, (rows + columns) / 200], -1) + rng.uniform(
            0, 0.3, 3
        )
        ids = np.zeros(rows.shape, np.int32)
        for label in (1, 2, 3):
            y, x, radius = rng.uniform(8, 32), rng.uniform(8, 40), rng.uniform(3, 9)
            away = np.hypot(rows - y, columns - x) - radius
            share = np.clip(0.5 - away, 0, 1)[..., None]
            image = share * rng.uniform(0, 1, 3) + (1 - share) * image
            ids[away < 0] = label
        images.append(np.rint(255 * np.clip(image + rng.normal(0, 0.004, image.shape), 0, 1)))
        labels.append(ids)
    return np.stack(images).astype(np.uint8), np.stack(labels)


def both(
    rgb: np.ndarray, ids: np.ndarray, edits: list[list[Any]], mixes: bool, device: torch.device
) -> tuple[np.ndarray, np.ndarray]:
    found = composite.composite(
        torch.from_numpy(rgb).to(device),
        torch.from_numpy(ids).to(device),
        edits,
        [mixes] * len(rgb),
        lambda at: at,
    )
    expected = [
        one_by_one.composite(image, own, given_edits, mixes, lambda rows: rows)
        for image, own, given_edits in zip(rgb, ids, edits, strict=True)
    ]
    return found.cpu().numpy(), np.stack(expected)


@settings(deadline=None, max_examples=40)
@given(IMAGES, LABELS, st.booleans())
def test_pixels_outside_keep_their_bytes(rgb: np.ndarray, ids: np.ndarray, mixes: bool) -> None:
    found, expected = both(rgb, ids, [[Scaled(frozenset({1}))]] * 3, mixes, torch.device("cpu"))
    same = (expected == rgb).all(-1) & (ids != 1)
    assert np.array_equal(found[same], rgb[same])


@settings(deadline=None, max_examples=40)
@given(IMAGES, LABELS)
def test_sharp_outlines_are_those_of_each_image_alone(rgb: np.ndarray, ids: np.ndarray) -> None:
    edits = [
        [Scaled(frozenset({1, 2}))],
        [],
        [Scaled(None, 0.3, (3,)), Scaled(frozenset({0}), 0.7)],
    ]
    found, expected = both(rgb, ids, edits, False, torch.device("cpu"))
    assert np.array_equal(found, expected)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("seed", range(4))
def test_soft_outlines_are_those_of_each_image_alone(seed: int, device: torch.device) -> None:
    rgb, ids = scenes(seed)
    edits = [
        [Scaled(frozenset({1}))],
        [Scaled(frozenset({2}), 0.2), Scaled(frozenset({1, 3}), 0.6)],
        [Scaled(None, 0.5)],
        [Scaled(None, 0.4, (1,)), Scaled(frozenset({1}), 0.1)],
    ]
    found, expected = both(rgb, ids, edits, True, device)
    off = np.abs(found.astype(int) - expected).max(-1)
    assert (off > 1).mean() <= 1e-3
    assert (off > 0).mean() <= 0.01


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("seed", range(4))
def test_mattes_are_those_of_each_image_alone(seed: int, device: torch.device) -> None:
    rgb, ids = scenes(seed)
    color, inside = rgb.astype(np.float32) / 255, ids == 1
    found = matting.outline(torch.from_numpy(color).to(device), torch.from_numpy(inside).to(device))
    share, foreground = (part.cpu().numpy() for part in (found.share, found.foreground))
    expected = [matte(*one) for one in zip(color, inside, strict=True)]
    at = tuple(part.cpu().numpy() for part in (found.at.image, found.at.row, found.at.column))
    shares, fronts = (np.stack(part)[at] for part in zip(*expected, strict=True))
    assert len(share) > 100
    alike = np.abs(share - shares) < SHARE_OFF
    assert alike.mean() > 0.99
    assert np.abs(foreground - fronts)[alike].max() < 1e-3


def test_things_without_inner_pixels_and_images_without_outlines_are_mattes_too() -> None:
    rgb = np.random.default_rng(0).integers(0, 256, (3, 5, 6, 3), np.uint8)
    ids = np.zeros((3, 5, 6), np.int32)
    ids[0, 2, 3] = ids[1, :, :] = 1
    found, expected = both(rgb, ids, [[Scaled(frozenset({1}))]] * 3, True, torch.device("cpu"))
    assert np.abs(found.astype(int) - expected).max() <= 1


def test_the_nearest_pixel_inside_is_a_straight_neighbour_first() -> None:
    inside = torch.zeros(1, 3, 3, dtype=torch.bool)
    inside[0, 0, 0] = inside[0, 1, 2] = True
    middle = torch.ones(1, dtype=torch.int64)
    found = matting.nearest(inside, Pixels(0 * middle, middle, middle))
    assert (found.row[0], found.column[0]) == (1, 2)
