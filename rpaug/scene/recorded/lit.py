"""Cast shadows that wander over what rests, told by the same pixel at other times.

A pixel of a fixed camera that shows the same resting instance shows the same place of it, so its albedo cancels in the
ratio of its brightness to that of its lit times: what is left is light (Weiss 2001, "Deriving intrinsic images from
image sequences"). A place that is in shadow at all times counts as lit.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8

from rpaug.core import memo, pixels, sampling
from rpaug.core.types import Episode

FRAMES = 48
LIT = 0.05  # of a place's times, the brightest: the last of them counts as fully lit
NOISE = 3 / 255  # that far below it a place is lit still
DARK = 0.04  # of the brightest channel: below, nothing tells
BESIDE = 2  # pixels: as far as light is taken from beside a pixel that shows two things
SPECK = 3  # pixels: a shadow thinner than half of it is the edge of one that stands all but still
BLOCK = np.ones((3, 3), np.uint8)


@dataclass(frozen=True)
class LitPlaces:
    """Which resting instance each pixel shows, -1 for none, and the brightness it has there when lit, 0..1."""

    ids: Int32[np.ndarray, "h w"]
    brightness: Float32[np.ndarray, "h w"]


@memo.of_episode
def places(episode: Episode, name: str, moving: frozenset[int]) -> LitPlaces | None:
    """What one camera saw at rest in some frames; None for a camera that moves or has no instance ids."""
    view = episode.views[name]
    if view.ids is None or not view.camera.fixed:
        return None
    times = sampling.frames(episode.length, FRAMES)
    ids = np.stack([view.ids(t) for t in times])
    bright = np.stack([_brightest(view.rgb(t)) for t in times])
    known = np.stack([inside(one) for one in ids]) & ~np.isin(ids, sorted(moving))
    first = np.take_along_axis(ids, known.argmax(0)[None], 0)[0]
    known &= ids == first
    count = known.sum(0)
    order = -np.sort(-np.where(known, bright, -1), axis=0)
    lit = np.take_along_axis(order, np.floor(LIT * count).astype(int)[None], 0)[0]
    return LitPlaces(np.where(count > 0, first, -1).astype(np.int32), np.where(count > 0, lit, 0))


def share(
    episode: Episode, name: str, moving: frozenset[int], t: int
) -> Float32[np.ndarray, "h w"] | None:
    """Of the light that each pixel of a camera has when lit, what it has at t: 1 where nothing tells."""
    lit, view = places(episode, name, moving), episode.views[name]
    if lit is None or view.ids is None:
        return None
    ids = view.ids(t)
    known = (ids == lit.ids) & (lit.brightness > DARK + NOISE)
    ratio = np.ones(ids.shape, np.float32)
    full = lit.brightness[known] - NOISE
    ratio[known] = np.minimum(_brightest(view.rgb(t))[known] / full, 1)
    pure = known & inside(ids)
    size = (2 * BESIDE + 1, 2 * BESIDE + 1)
    weight = cv2.boxFilter(pure.astype(np.float32), -1, size, borderType=cv2.BORDER_CONSTANT)
    beside = cv2.boxFilter(np.where(pure, ratio, 0), -1, size, borderType=cv2.BORDER_CONSTANT)
    mixed = known & ~pure
    ratio[mixed] = np.where(weight > 0, beside / np.maximum(weight, 1e-6), 1)[mixed]
    return np.asarray(cv2.medianBlur(ratio, SPECK), np.float32)


def _brightest(rgb: UInt8[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w"]:
    return pixels.brightest(rgb).astype(np.float32) / np.float32(255)


def inside(ids: Int32[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels among others of their own instance alone: an outline's pixel is a mixture."""
    even = ids.astype(np.float32)
    return (cv2.dilate(even, BLOCK) == even) & (cv2.erode(even, BLOCK) == even)
