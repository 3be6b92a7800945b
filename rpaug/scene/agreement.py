"""Do cameras agree on where surfaces are?"""

import numpy as np
from jaxtyping import Float, Float64, Int

from rpaug import geometry
from rpaug.types import Camera


def reprojection(
    depths: tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]],
    ids: tuple[Int[np.ndarray, "h w"], Int[np.ndarray, "h w"]],
    cameras: tuple[Camera, Camera],
    t: int,
    hidden: float = 0.02,
) -> Float64[np.ndarray, "n"]:
    """Metres between the first camera's points and the surface the second saw there, on handles both name.

    Points that lie `hidden` metres or more behind that surface are taken for unseen by the second. The inverse of depth
    is interpolated, which is exact on planes, and only between four pixels of one handle.
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
