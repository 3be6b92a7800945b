"""How far a standing thing can grow before it meets what stands beside it or what moves past."""

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float64

from rpaug.errors import TargetError
from rpaug.scene.placement.placing import CELL, Room, hull, points_of, room
from rpaug.types import Scene

STEPS = 24  # factors tried between the recorded size and the one asked for
LIFTED = 0.02  # metres over the support: what begins higher does not stand on it


def largest(
    scene: Scene, handles: frozenset[int], pivot: Float64[np.ndarray, "3"], wanted: float
) -> tuple[float, str | None]:
    """The largest factor up to `wanted` by which the things can grow about `pivot` (world), and what stops them there.

    Only what the growth newly takes counts: as things were recorded they met nothing. Things that do not stand on the
    support, or that the robot moves, are judged by their contacts alone.
    """
    moved = scene.roles.get("manipulated", frozenset()) | scene.roles.get("robot", frozenset())
    points = points_of(scene, handles)
    if wanted <= 1 or handles & moved or len(points) < 4:
        return wanted, None
    try:
        around = room(scene, handles)
    except TargetError:  # no support, so nothing to stand beside
        return wanted, None
    if abs(float(np.quantile(points[:, 2], 0.01)) - around.level) > LIFTED:
        return wanted, None
    fits = 1.0
    for factor in np.linspace(1.0, wanted, STEPS + 1)[1:].tolist():
        what = _met(around, points, pivot + factor * (points - pivot))
        if what is not None:
            return fits, what
        fits = factor
    return wanted, None


def _met(
    around: Room, before: Float[np.ndarray, "n 3"], after: Float[np.ndarray, "n 3"]
) -> str | None:
    """What stands or passes where the grown thing is and the recorded one was not."""
    was, now = _covered(around, before), _covered(around, after)
    low, high = (float(points[:, 2].max()) - around.level for points in (before, after))
    for height, what in (
        (around.still, "what stands beside it"),
        (around.swept, "what moves past it"),
    ):
        taken = height < high
        if (taken & now & ~(was & (height < low))).any():
            return what
    return None


def _covered(around: Room, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "r c"]:
    mask = np.zeros(around.seen.shape, np.uint8)
    corners = np.rint((hull(points) - around.origin) / CELL).astype(np.int32)
    cv2.fillConvexPoly(mask, corners, 1)
    return mask > 0
