"""Things of the colors of what is around them: no tint tells them, but where they went the change lasts.

A drawer of its cabinet's wood is what covers the table at the end and did not at the start. Which end shows the thing
and which what lies behind it is told by the outline of the change: what lies behind goes on across it. Where the thing
rested nothing tells it from its surroundings, so that it is known to move and is no target (docs/why/rgb-only.md).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, UInt8

from rpaug.scene.instances import blobs, color_clusters, ends
from rpaug.scene.instances.backdrop import DIFFERS, LEAST, Backdrop, distance
from rpaug.scene.instances.resting import Resting
from rpaug.scene.instances.watched import Watched

CLEAR = 1.25  # times as far that colors must jump across the outline where the thing is seen
SHADE = 2.0  # times darker or brighter that a place may become and show the same


@dataclass(frozen=True)
class Lasting:
    """One camera's part: `where` the change lasts, and how the place looks without the thing."""

    behind: UInt8[np.ndarray, "h w 3"]
    where: Bool[np.ndarray, "h w"]
    limit: float

    def shown(self, image: UInt8[np.ndarray, "h w 3"]) -> Bool[np.ndarray, "h w"]:
        """Where an image shows something before what lies behind: the thing, or the robot."""
        return self.where & _differs(image, self.behind, self.limit)


def find(
    cameras: Mapping[str, Watched], seen: Mapping[str, Resting], mobile: frozenset[int]
) -> dict[str, Lasting]:
    """The cameras that see where a thing went or came from; none where nothing tells thing and place apart."""
    found: dict[str, tuple[ends.End, ends.End, np.ndarray, float]] = {}
    jumps = np.zeros(2)
    for name, watched in cameras.items():
        first, last = ends.of(watched, mobile)
        limit = _limit(watched.backdrop)
        where = _lasts(first, last, limit, watched, seen[name])
        if not where.any():
            continue
        found[name] = (first, last, where, limit)
        jumps += where.sum() * np.array([_jump(one.image, where) for one in (first, last)])
    if not found or jumps.max() < CLEAR * jumps.min():
        return {}
    # Seen at the end whose outline jumps: the other end shows what lies behind.
    behind = int(jumps.argmin())
    return {
        name: Lasting((first, last)[behind].image, where, limit)
        for name, (first, last, where, limit) in found.items()
    }


def _limit(drop: Backdrop) -> float:
    return max(DIFFERS * drop.noise, LEAST)


def _differs(
    one: UInt8[np.ndarray, "h w 3"], other: UInt8[np.ndarray, "h w 3"], limit: float
) -> Bool[np.ndarray, "h w"]:
    shade = color_clusters.shaded(
        color_clusters.weighted(one), color_clusters.weighted(other), SHADE
    )
    return (distance(one, other) > limit) & ~shade


def _lasts(
    first: ends.End, last: ends.End, limit: float, watched: Watched, seen: Resting
) -> Bool[np.ndarray, "h w"]:
    """Where the two ends differ in colors that other resting patches have too, in pieces that are no outlines."""
    rest = {blob.cluster for k, blob in enumerate(seen.blobs) if k not in seen.robot}
    mask = first.known & last.known & _differs(first.image, last.image, limit)
    for end in (first, last):
        mask &= np.isin(color_clusters.labelled(end.image, watched.clusters), list(rest))
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    _, pieces, stats, _ = cv2.connectedComponentsWithStats(opened)
    areas = stats[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0
    if areas.max() < blobs.LEAST * mask.size:
        return np.zeros_like(mask)
    return np.isin(pieces, np.flatnonzero(areas >= blobs.SMALL * mask.size))


def _jump(image: UInt8[np.ndarray, "h w 3"], where: Bool[np.ndarray, "h w"]) -> float:
    """How far colors differ across the outline of a mask: mean weighted Lab distance of the pixels on both sides."""
    shown, off = color_clusters.weighted(image), []
    for axis in (0, 1):
        ahead = np.roll(where, -1, axis)
        crossed = where != ahead
        crossed[(slice(None),) * axis + (-1,)] = False  # the image's edge is no neighbour
        off.append(np.linalg.norm(shown - np.roll(shown, -1, axis), axis=-1)[crossed])
    every = np.concatenate(off)
    return float(every.mean()) if len(every) else 0.0
