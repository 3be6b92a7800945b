"""Depth noise: how much of it there is, and recorded depth smoothed by as much as it asks for.

1/z is affine over a plane's pixels, so the best plane through a pixel's neighbours of the same thing keeps planes as
they are and averages the noise away. Rendered depth has none, and is never touched.
"""

import numpy as np
from jaxtyping import Float32, Float64, Int32

from rpaug.core.jit import kernel

NOISY = 4e-4  # of depth: rendered depth, also when stored as 16 bits of millimetres, has less
RADIUS = 2  # pixels: 5 x 5 neighbours
OUTLIER = 6.0  # standard deviations: a neighbour farther off is another surface
FEWEST = 6  # neighbours for a plane


def noise(depth: Float32[np.ndarray, "h w"], ids: Int32[np.ndarray, "h w"]) -> float:
    """Standard deviation of the depth's noise as a share of depth, robustly, 0 where nothing can be told.

    From second differences of 1/z along rows within a thing, which vanish on planes; a curved surface or an edge
    is an outlier to the median.
    """
    near = _nearness(depth)
    left, middle, right = near[:, :-2], near[:, 1:-1], near[:, 2:]
    same = (ids[:, :-2] == ids[:, 1:-1]) & (ids[:, 2:] == ids[:, 1:-1])
    same &= (left > 0) & (middle > 0) & (right > 0)
    if same.sum() < 100:
        return 0.0
    bend = (left[same] - 2 * middle[same] + right[same]) / middle[same]
    return float(1.4826 * np.median(np.abs(bend)) / np.sqrt(6.0))


def smooth(
    depth: Float32[np.ndarray, "h w"], ids: Int32[np.ndarray, "h w"], level: float
) -> Float32[np.ndarray, "h w"]:
    """Depth on the planes through each pixel's neighbours of the same id; as it was for `level` below `NOISY`."""
    if level < NOISY:
        return depth
    near = _smooth(_nearness(depth), ids, level)
    return np.divide(1.0, near, out=np.zeros_like(near), where=near > 0).astype(np.float32)


def _nearness(depth: Float32[np.ndarray, "h w"]) -> Float64[np.ndarray, "h w"]:
    known = np.isfinite(depth) & (depth > 0)
    return np.divide(1.0, depth, out=np.zeros(depth.shape), where=known, dtype=np.float64)


@kernel
def _smooth(near, ids, level):
    out = near.copy()
    height, width = near.shape
    for row in range(height):
        for column in range(width):
            here = near[row, column]
            if here <= 0.0:
                continue
            n = sx = sy = sxx = sxy = syy = sw = sxw = syw = 0.0
            for i in range(max(0, row - RADIUS), min(height, row + RADIUS + 1)):
                for j in range(max(0, column - RADIUS), min(width, column + RADIUS + 1)):
                    off = near[i, j] - here
                    x, y = j - column, i - row
                    # Neighbours may also differ by the surface's own slope.
                    limit = (OUTLIER * level + 0.01 * max(abs(x), abs(y))) * here
                    if near[i, j] > 0.0 and ids[i, j] == ids[row, column] and abs(off) < limit:
                        n += 1
                        sx += x
                        sy += y
                        sxx += x * x
                        sxy += x * y
                        syy += y * y
                        sw += off
                        sxw += x * off
                        syw += y * off
            # Normal equations of off = a + b x + c y, by Cramer's rule; a alone is wanted.
            minor = sxx * syy - sxy * sxy
            whole = n * minor - sx * (sx * syy - sxy * sy) + sy * (sx * sxy - sxx * sy)
            if n >= FEWEST and whole > 1e-6:
                top = sw * minor - sx * (sxw * syy - sxy * syw) + sy * (sxw * sxy - sxx * syw)
                out[row, column] = max(here + top / whole, 1e-3 * here)
            elif n > 0:
                out[row, column] = here + sw / n
    return out
