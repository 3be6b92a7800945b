"""Do cameras agree on where surfaces are?"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Float64, Int

from rpaug.core import geometry
from rpaug.core.types import Camera, CameraView

NEAR = 0.005  # metres


def reprojection(
    depths: tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]],
    ids: tuple[Int[np.ndarray, "h w"], Int[np.ndarray, "h w"]],
    cameras: tuple[Camera, Camera],
    t: int,
    hidden: float = 0.02,
) -> Float64[np.ndarray, "n"]:
    """Metres between the first camera's points and the surface the second saw there, on instance ids both name.

    Points that lie `hidden` metres or more behind that surface are taken for unseen by the second. The inverse of depth
    is interpolated, which is exact on planes, and only between four pixels of one instance id.
    """
    points = geometry.world_points(depths[0], cameras[0], t)
    at, z = geometry.project(points, cameras[1], t)
    corner = np.floor(np.nan_to_num(at, nan=-1.0, posinf=-1.0, neginf=-1.0)).astype(np.int64)
    limit = np.array([cameras[1].width, cameras[1].height]) - 1
    inside = ((corner >= 0) & (corner < limit)).all(-1) & (z > 0) & (depths[0] > 0)
    (column, row), (x, y) = corner[inside].T, (at - corner)[inside].T
    inverse, same = np.zeros(len(x)), np.ones(len(x), bool)
    for down in (0, 1):
        for right in (0, 1):
            place = row + down, column + right
            weight = (y if down else 1 - y) * (x if right else 1 - x)
            inverse += weight / np.maximum(depths[1][place], 1e-6)
            same &= (ids[1][place] == ids[0][inside]) & (depths[1][place] > 0)
    apart = np.abs(1 / inverse - z[inside])
    return apart[same & (apart < hidden)]


def median_mm(views: Iterable[CameraView], times: Sequence[int]) -> float | None:
    """Median distance in millimetres between the points of one camera and the surface the next one sees there.

    Views without depth, and cameras whose place is assumed, are left out; without instance ids all is one thing.
    None where
    nothing can be compared.
    """
    known = [view for view in views if view.depth is not None and not view.camera.assumed]
    found = []
    for first, second in pairwise([*known, known[0]] if len(known) > 1 else []):
        for t in times:
            depths = first.depth(t), second.depth(t)  # type: ignore[misc]
            ids = _ids(first, t), _ids(second, t)
            found.append(reprojection(depths, ids, (first.camera, second.camera), t))
    apart = np.concatenate(found) if found else np.empty(0)
    return 1000 * float(np.median(apart)) if len(apart) else None


def by_pair(
    views: Mapping[str, CameraView], times: Sequence[int]
) -> dict[tuple[str, str], tuple[float, float]]:
    """For each camera and the next: the median distance in millimetres, and the share of the first's points that lie
    within NEAR of a surface that the second saw. Pairs that see nothing in common are left out."""
    known = {
        name: view
        for name, view in views.items()
        if view.depth is not None and not view.camera.assumed
    }
    found = {}
    for one, other in pairwise([*known, next(iter(known))] if len(known) > 1 else []):
        apart, points = [], 0
        for t in times:
            first, second = known[one], known[other]
            depths = first.depth(t), second.depth(t)  # type: ignore[misc]
            ids = _ids(first, t), _ids(second, t)
            apart.append(reprojection(depths, ids, (first.camera, second.camera), t))
            points += int((depths[0] > 0).sum())
        together = np.concatenate(apart) if apart else np.empty(0)
        if len(together):
            share = float((together < NEAR).sum()) / points
            found[one, other] = 1000 * float(np.median(together)), share
    return found


def _ids(view: CameraView, t: int) -> Int[np.ndarray, "h w"]:
    shape = view.camera.height, view.camera.width
    return np.ones(shape, np.int32) if view.ids is None else view.ids(t)
