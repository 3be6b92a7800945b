"""Which patches things stand on, and which patches stand there."""

from collections.abc import Mapping

import cv2
import numpy as np
from jaxtyping import Bool

from rpaug.scene.instances import color_clusters
from rpaug.scene.instances.blobs import ring
from rpaug.scene.instances.resting import Resting

SPREAD = 0.35  # of the image: how far from its middle the support is looked for
ALIKE = 9.0  # weighted Lab: patches of one tint that differ by more are not one support
PIECE = 0.02  # of the largest patch's pixels: smaller ones of its color are none of the support
GRAIN = 0.08  # share of a patch's outline on the support from which it is its grain, if its color is a shade of it
WITHIN = 0.8  # share of a thing inside the support's outline, if it stands there
CUT = 0.1  # share of a thing's outline on the image's edge from which the image cuts it off
LARGE = 0.05  # share of the image from which what the image cuts off is wall or floor
SEEN_ON = 0.8  # share of what is seen of such a thing's outline that lies on the support, if it stands there
ON = 0.5  # share of a thing's outline that lies on the support, if it stands there


def find(
    cameras: Mapping[str, Resting], known: color_clusters.ColorClusters
) -> dict[str, frozenset[int]]:
    """The patches of each camera that things stand on: of the tint that covers most around the images' middles, and
    of its shades beside it, as wood has them."""
    score: dict[int, float] = {}
    for part in cameras.values():
        h, w = part.cluster.shape
        down, right = np.mgrid[0:h, 0:w]
        off = ((down / h - 0.55) ** 2 + (right / w - 0.5) ** 2) / (2 * SPREAD**2)
        weight = np.exp(-off) / (h * w)
        for k, blob in enumerate(part.blobs):
            if k not in part.robot:
                score[blob.cluster] = score.get(blob.cluster, 0.0) + float(weight[blob.mask].sum())
    if not score:
        return {}
    best = max(score, key=lambda cluster: score[cluster])
    shades = {
        cluster for cluster in score if color_clusters.shaded(known[cluster], known[best])
    } - {best}
    found = {name: _of(part, best, shades) for name, part in cameras.items()}
    return {name: patches for name, patches in found.items() if patches}


def _of(part: Resting, best: int, shades: set[int]) -> frozenset[int]:
    same = [k for k, blob in enumerate(part.blobs) if blob.cluster == best and k not in part.robot]
    if not same:
        return frozenset()
    # What the robot's arm cuts off from the largest patch belongs to it.
    first = part.blobs[same[0]]
    found = {
        k
        for k in same
        if np.linalg.norm(part.blobs[k].color - first.color) < ALIKE
        and part.blobs[k].area > PIECE * first.area
    }
    left = {
        k
        for k, blob in enumerate(part.blobs)
        if blob.cluster in shades | {best} and k not in part.robot | found
    }
    while grain := {k for k in left if _share_on(part, k, found) >= GRAIN}:
        found |= grain
        left -= grain
    return frozenset(found)


def stands_on(part: Resting, k: int, support: frozenset[int]) -> bool:
    """Does a patch lie within the support's outline, or does most of its own border on it?

    Patches on patches count through those below.
    """
    representation = _mask(part, support)
    if part.blobs[k].edge > CUT:
        # All that is seen of a wall's or a floor's outline may lie there too; but those are large.
        small = part.blobs[k].area < LARGE * part.cluster.size
        return small and bool(representation[ring(part.blobs[k].mask)].mean() >= SEEN_ON)
    if (
        part.blobs[k].edge == 0
        and (_hull(representation) & part.blobs[k].mask).sum() > WITHIN * part.blobs[k].area
    ):
        return True
    for _ in range(2):
        around = ring(part.blobs[k].mask)
        if representation[around].mean() >= ON:
            return True
        for j, blob in enumerate(part.blobs):
            if j != k and blob.edge == 0 and representation[ring(blob.mask)].mean() >= ON:
                representation = representation | blob.mask
    return False


def _share_on(part: Resting, k: int, patches: set[int]) -> float:
    return float(_mask(part, patches)[ring(part.blobs[k].mask)].mean())


def _mask(part: Resting, patches: frozenset[int] | set[int]) -> Bool[np.ndarray, "h w"]:
    out = np.zeros(part.cluster.shape, bool)
    for k in patches:
        out |= part.blobs[k].mask
    return out


def _hull(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """The convex outline of all pixels of a mask, filled."""
    out = np.zeros(mask.shape, np.uint8)
    rows, columns = np.nonzero(mask)
    if len(rows) > 2:
        corners = cv2.convexHull(np.column_stack([columns, rows]).astype(np.int32))
        cv2.fillConvexPoly(out, corners, 1)
    return out > 0
