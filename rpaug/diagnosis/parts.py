"""Regions of an image, parted where two things touch: each part is compact and of one hue.

A pattern is not parted, since its colors interleave: what is parted must be nearly all of the region, in pieces that
fill their convex outlines.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8

LEAST = 14  # pixels of a region
APART = 22.0  # in hue: two colors that are nearer are one thing's
SOLID = 0.8  # share of their convex outlines that parts must fill
NEARLY = 0.75  # share of a region that its parts must cover
DEEPEST = 4  # times that a region is parted
DIM = 20.0  # of lightness + 16: what is darker has no hue to speak of


def hue(lab: Float32[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w 2"]:
    """What of a color shading leaves as it is.

    L + 16, a and b of CIELAB are all proportional to the cube root of the light, so that their ratios do not depend
    on it.
    """
    return 100 * lab[..., 1:] / np.maximum(lab[..., :1] + 16, DIM)


def opened(mask: Bool[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    """Without lone pixels and lines one pixel wide."""
    square = np.ones((2, 2), np.uint8)
    # A square of even width has no middle: grown by the one that it shrank by, all would lie one pixel off.
    return cv2.dilate(cv2.erode(mask.astype(np.uint8), square), square, anchor=(0, 0))


def regions(mask: UInt8[np.ndarray, "h w"]) -> list[Bool[np.ndarray, "h w"]]:
    """Connected regions of enough pixels."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    return [labels == i for i in range(1, count) if stats[i, cv2.CC_STAT_AREA] >= LEAST]


def thin(mask: Bool[np.ndarray, "h w"]) -> bool:
    """Is it nowhere three pixels wide? Then it is the outline of something."""
    return int(cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)).sum()) < 4


def parted(
    whole: Bool[np.ndarray, "h w"], lab: Float32[np.ndarray, "h w 3"], deep: int = DEEPEST
) -> list[Bool[np.ndarray, "h w"]]:
    """The region, or its compact parts of one hue each."""
    if not deep or whole.sum() < 2 * LEAST:
        return [whole]
    centres, near = clustered(hue(lab)[whole], count=2)
    if np.linalg.norm(centres[0] - centres[1]) < APART:
        return [whole]
    labels = np.full(whole.shape, -1)
    labels[whole] = near
    pieces = [one for k in range(2) for one in regions(opened(labels == k))]
    covered = sum(int(one.sum()) for one in pieces)
    if len(pieces) < 2 or covered < NEARLY * whole.sum():
        return [whole]
    if sum(solid(one) * one.sum() for one in pieces) < SOLID * covered:
        return [whole]
    return [part for one in pieces for part in parted(one, lab, deep - 1)]


def solid(mask: Bool[np.ndarray, "h w"]) -> float:
    """The share of its convex outline that a region fills."""
    outline = np.zeros(mask.shape, np.uint8)
    cv2.fillConvexPoly(outline, cv2.convexHull(np.argwhere(mask)[:, ::-1].astype(np.int32)), 1)
    return float(mask.sum() / outline.sum())


def clustered(
    pixels: Float32[np.ndarray, "n c"], count: int, rounds: int = 12
) -> tuple[Float32[np.ndarray, "k c"], Int32[np.ndarray, "n"]]:
    """k-means that begins at the pixels furthest from each other: the same every time (Lloyd 1982)."""
    some = pixels[:: max(1, len(pixels) // 3000)]
    centres = [np.median(some, 0)]
    for _ in range(count - 1):
        apart = np.min([np.linalg.norm(some - c, axis=1) for c in centres], 0)
        # Not the very furthest: that is a lone pixel on an outline.
        centres.append(some[int(np.argsort(apart)[int(0.98 * (len(some) - 1))])])
    middle = np.array(centres, np.float32)
    for _ in range(rounds):
        near = _nearest(some, middle)
        for k in range(count):
            if (near == k).any():
                middle[k] = some[near == k].mean(0)
    return middle, _nearest(pixels, middle)


def _nearest(
    pixels: Float32[np.ndarray, "n c"], centres: Float32[np.ndarray, "k c"]
) -> Int32[np.ndarray, "n"]:
    return np.argmin(((pixels[:, None] - centres) ** 2).sum(2), 1).astype(np.int32)
