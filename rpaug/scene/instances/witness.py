"""How well each supposed motion of a point agrees with what the cameras saw at other times.

A point is carried along by the motion and looked up in every fixed camera of every sampled frame. It may lie on the
surface there, with the right color or a wrong one; it may be hidden, which says nothing; or the camera may have seen
through the place, which speaks against it.
"""

import numpy as np
from jaxtyping import Float32, Float64

from rpaug.core.jit import kernel
from rpaug.scene.instances.sights import Sights

FOOTPRINTS = 0.6  # widths of a pixel that a point may lie in front of or behind a surface
COLOR = 0.12  # difference in display color that halves what a hit counts, about
AGAINST = 3.0  # hits that one look through the place outweighs
DOUBT = 1.5  # hits' worth of not knowing
EDGE = (
    4.0  # widths of a pixel over which a neighbourhood may reach in depth and still tell anything
)


def scores(
    points: Float64[np.ndarray, "n 3"],
    colors: Float32[np.ndarray, "n 3"],
    motions: Float64[np.ndarray, "k s 4 4"],
    sights: Sights,
) -> Float32[np.ndarray, "n k"]:
    """From -AGAINST (seen through wherever looked) over 0 (nothing known) to 1 (always on a surface of its color).

    `motions[k, s]` carries a point from where it is seen to where hypothesis k has it in sampled frame s.
    """
    out = np.zeros((len(points), len(motions)), np.float32)
    _scores(
        np.ascontiguousarray(points), np.ascontiguousarray(colors), np.ascontiguousarray(motions),
        sights.K, sights.world_to_camera, sights.depth, sights.nearest, sights.farthest, sights.darkest,
        sights.brightest, out,
    )  # fmt: skip
    return out


@kernel
def _scores(points, colors, motions, K, poses, depth, nearest, farthest, darkest, brightest, out):
    frames, cameras, height, width = nearest.shape
    p = np.zeros(3)
    for k in range(len(motions)):
        for n in range(len(points)):
            hits, through, looks = 0.0, 0.0, 0.0
            for s in range(frames):
                M = motions[k, s]
                for i in range(3):
                    p[i] = M[i, 3] + (
                        M[i, 0] * points[n, 0] + M[i, 1] * points[n, 1] + M[i, 2] * points[n, 2]
                    )
                for c in range(cameras):
                    W = poses[c]
                    z = W[2, 3] + W[2, 0] * p[0] + W[2, 1] * p[1] + W[2, 2] * p[2]
                    if z <= 1e-6:
                        continue
                    x = W[0, 3] + W[0, 0] * p[0] + W[0, 1] * p[1] + W[0, 2] * p[2]
                    y = W[1, 3] + W[1, 0] * p[0] + W[1, 1] * p[1] + W[1, 2] * p[2]
                    column = int(np.floor(K[c, 0, 0] * x / z + K[c, 0, 2] + 0.5))
                    row = int(np.floor(K[c, 1, 1] * y / z + K[c, 1, 2] + 0.5))
                    if row < 0 or row >= height or column < 0 or column >= width:
                        continue
                    near = nearest[s, c, row, column]
                    if near <= 0:
                        continue
                    far = farthest[s, c, row, column]
                    foot = FOOTPRINTS * z / K[c, 0, 0]
                    if z > far + foot:
                        continue
                    if z < near - foot:
                        through += 1.0
                        looks += 1.0
                    elif (
                        far - near < EDGE * z / K[c, 0, 0]
                        or abs(z - depth[s, c, row, column]) < 2 * foot
                    ):
                        off = 0.0
                        for i in range(3):
                            low = darkest[s, c, row, column, i] - colors[n, i]
                            high = colors[n, i] - brightest[s, c, row, column, i]
                            off = max(off, low, high)
                        hits += 1.0 / (1.0 + (off / COLOR) ** 2)
                        looks += 1.0
            out[n, k] = (hits - AGAINST * through) / (looks + DOUBT)
