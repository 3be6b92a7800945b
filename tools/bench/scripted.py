"""Outlines as published models give them, made from the truth: boundaries that are off, frames missed, wrong things.

A quality is named by the overlap of its masks with the true ones. The signed distance to a true outline is added to a
smooth random field whose strength is sought for that overlap; some frames are dropped, and some show the words where
they do not belong. All of it is drawn from a seed, and written as a file of outlines (`rpaug.providers.finder`).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float

from rpaug.core.types import Episode


@dataclass(frozen=True)
class Quality:
    """`iou` of a mask with the true one, `dropped` share of frames without it, `wrong` share with one elsewhere too."""

    iou: float
    dropped: float
    wrong: float


QUALITIES: Mapping[str, Quality] = {
    "perfect": Quality(1.0, 0.0, 0.0),
    "high": Quality(0.98, 0.02, 0.01),
    "middle": Quality(0.95, 0.05, 0.05),
    "low": Quality(0.90, 0.10, 0.10),
}
GRAIN = 0.12  # of a thing's size: the smooth field's bumps
SMALLEST = 4  # pixels of a mask that is drawn at all


def outlines(
    episode: Episode, things: Mapping[str, Sequence[int]], quality: Quality, seed: int
) -> dict[str, object]:
    """A file of outlines of these instances, by the words that name them; `episode` has true masks."""
    rng = np.random.default_rng([seed, 24])
    cameras: dict[str, dict[str, list[object]]] = {}
    for name, view in episode.views.items():
        assert view.ids is not None
        frames: dict[str, list[object]] = {}
        for t in range(episode.length):
            ids = view.ids(t)
            frames[str(t)] = [
                {"words": words, "polygons": polygons}
                for words, instances in things.items()
                for polygons in _drawn(np.isin(ids, list(instances)), quality, rng)
            ]
        cameras[name] = frames
    return {episode.key: cameras}


def _drawn(
    true: Bool[np.ndarray, "h w"], quality: Quality, rng: np.random.Generator
) -> Iterator[list[list[list[float]]]]:
    """The polygons of what a model says of one frame."""
    dropped, wrong = rng.random(2) < (quality.dropped, quality.wrong)
    made = spoilt(true, quality.iou, rng)
    if not dropped and made.sum() >= SMALLEST:
        yield polygons(made)
    if wrong:
        elsewhere = np.zeros(true.shape, np.uint8)
        middle = [int(rng.integers(side)) for side in true.shape[::-1]]
        size = max(3, round(float(np.sqrt(max(true.sum(), 30)) / 2)))
        cv2.ellipse(elsewhere, middle, (size, max(2, size // 2)), 0, 0, 360, 1, -1)
        yield polygons(elsewhere > 0)


def spoilt(
    true: Bool[np.ndarray, "h w"], iou: float, rng: np.random.Generator
) -> Bool[np.ndarray, "h w"]:
    """A mask that overlaps the true one by about `iou`; one of a few pixels may be off by more."""
    if iou >= 1 or not true.any():
        return true
    inside = cv2.distanceTransform(true.astype(np.uint8), cv2.DIST_L2, 5)
    outside = cv2.distanceTransform((~true).astype(np.uint8), cv2.DIST_L2, 5)
    signed = inside - outside - np.where(true, 0.5, -0.5)
    noise = rng.normal(size=true.shape).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), max(1.0, GRAIN * float(np.sqrt(true.sum()))))
    smooth /= max(float(smooth.std()), 1e-9)
    low, high = 0.0, 20.0
    for _ in range(20):
        strength = (low + high) / 2
        low, high = (
            (strength, high) if _overlap(signed, smooth, strength, true) > iou else (low, strength)
        )
    return signed + low * smooth > 0


def _overlap(
    signed: Float[np.ndarray, "h w"],
    smooth: Float[np.ndarray, "h w"],
    strength: float,
    true: Bool[np.ndarray, "h w"],
) -> float:
    made = signed + strength * smooth > 0
    return float((made & true).sum() / max((made | true).sum(), 1))


def polygons(mask: Bool[np.ndarray, "h w"]) -> list[list[list[float]]]:
    """The outlines of a mask's pieces that have three corners; one of fewer is drawn as a small square."""
    found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    out = []
    for contour in found:
        corners = contour[:, 0].astype(float)
        if len(corners) < 3:
            x, y = corners[0]
            corners = np.array([[x, y], [x + 0.5, y], [x, y + 0.5]])
        out.append(corners.tolist())
    return out
