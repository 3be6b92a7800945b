"""Depth noise: how much of it there is, recorded depth smoothed by as much as it asks for, and its holes filled.

1/z is affine over a plane's pixels, so the best plane through a pixel's neighbours of the same thing keeps planes as
they are and averages the noise away. Rendered depth has none, and is never touched.
"""

import numpy as np
from jaxtyping import Float32, Float64, Int32

from rpaug.core.jit import inlined, kernel

NOISY = 4e-4  # of depth: rendered depth, also when stored as 16 bits of millimetres, has less
RADIUS = 2  # pixels: 5 x 5 neighbours
OUTLIER = 6.0  # standard deviations: a neighbour farther off is another surface
FEWEST = 6  # neighbours for a plane
STEP = 0.03  # of depth: what differs more is an edge
EQUAL = 0.4  # of neighbours have the same depth where it comes in steps
SOME = 0.02  # of them differ by a step
ALIKE = 0.2  # of a step's size: by so little steps differ
ALONE = (
    2.0  # times as many neighbours on other surfaces as on its own: a pixel that flies between two
)
MANY = 0.25  # of a window: so many tell a plane that goes on; fewer only where nothing larger does
STEPS = 6  # of a window, to each side, that are looked at
TWO = 0.02  # of depth a pixel: what differs more lies on two surfaces


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


def steps(depth: Float32[np.ndarray, "h w"], ids: Int32[np.ndarray, "h w"]) -> float:
    """Deviation, as a share of depth, of depth that comes in steps which pixels share, 0 where it does not.

    Within a thing most pixels then have their neighbours' very value, and where not, 1/z or z differs by one step,
    along rows and columns the same. A level camera sees rows of equal depth on a table, but no such columns.
    """
    near, found = _nearness(depth), [list[float](), list[float]()]
    for one, other in (np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:]):
        both = (ids[one] == ids[other]) & (near[one] > 0) & (near[other] > 0)
        if both.sum() < 100:
            return 0.0
        larger = np.maximum(near[one], near[other])[both]
        share = np.abs(near[one] - near[other])[both] / larger
        step = (share > 0) & (share < STEP)
        if (share == 0).mean() < EQUAL or step.mean() < SOME:
            return 0.0
        for kind, unit in zip(found, (share * larger, share / larger), strict=True):  # 1/z, z
            low, middle, high = np.quantile(unit[step], (0.25, 0.5, 0.75))
            if high - low < ALIKE * middle:
                kind.append(float(middle))
        middle_share = float(np.median(share[step]))
    same = any(len(kind) == 2 and max(kind) < (1 + ALIKE) * min(kind) for kind in found)
    return middle_share / np.sqrt(12.0) if same else 0.0


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
            told = _at_middle(n, sx, sy, sxx, sxy, syy, sw, sxw, syw) if n >= FEWEST else np.nan
            if not np.isnan(told):
                out[row, column] = max(here + told, 1e-3 * here)
            elif n > 0:
                out[row, column] = here + sw / n
    return out


@inlined
def _at_middle(n, sx, sy, sxx, sxy, syy, sw, sxw, syw):
    """What off = a + b x + c y is at x = y = 0, nan where its sums tell no plane: a by Cramer's rule."""
    minor = sxx * syy - sxy * sxy
    whole = n * minor - sx * (sx * syy - sxy * sy) + sy * (sx * sxy - sxx * sy)
    top = sw * minor - sx * (sxw * syy - sxy * syw) + sy * (sxw * sxy - sxx * syw)
    return top / whole if whole > 1e-6 else np.nan


def grounded(
    depth: Float32[np.ndarray, "h w"], ids: Int32[np.ndarray, "h w"], level: float
) -> Float32[np.ndarray, "h w"]:
    """Depth without flying pixels: 0 where most neighbours of the same id lie on another surface than the pixel."""
    flies = _flying(_nearness(depth), ids, level)
    return np.where(flies | ~np.isfinite(depth), np.float32(0), depth)


def filled(
    depth: Float32[np.ndarray, "h w"], ids: Int32[np.ndarray, "h w"], reach: int, inner: int = 0
) -> Float32[np.ndarray, "h w"]:
    """Depth whose holes lie on the plane through neighbours of their id, at most `reach` pixels away, else 0.

    Where two surfaces are near it is the farther one: a stereo camera's holes are what its other eye does not see.
    With `inner`, all pixels, told by those that are more than so many rows and columns away.
    """
    near = _nearness(depth)
    out = np.zeros_like(near) if inner else near.copy()
    radius = inner + 2
    while True:
        radius = min(radius, reach)
        few = FEWEST if radius == reach else MANY * (2 * min(radius, STEPS) + 1) ** 2
        _fill(near, ids, radius, inner, few, out)
        if radius == reach:
            break
        radius *= 2
    return np.divide(1.0, out, out=np.zeros_like(out), where=out > 0).astype(np.float32)


@kernel
def _flying(near, ids, level):
    flies = np.zeros(near.shape, np.bool_)
    height, width = near.shape
    for row in range(height):
        for column in range(width):
            here = near[row, column]
            same = other = 0
            for i in range(max(0, row - RADIUS), min(height, row + RADIUS + 1)):
                for j in range(max(0, column - RADIUS), min(width, column + RADIUS + 1)):
                    known = near[i, j] > 0.0 and ids[i, j] == ids[row, column]
                    if here <= 0.0 or not known or (i == row and j == column):
                        continue
                    steps = max(abs(i - row), abs(j - column))
                    if abs(near[i, j] - here) < (OUTLIER * level + 0.01 * steps) * here:
                        same += 1
                    else:
                        other += 1
            flies[row, column] = other > ALONE * same
    return flies


@kernel
def _fill(near, ids, radius, inner, few, out):
    """Gives pixels of `out` that have no 1/z the one of the plane around them."""
    height, width = near.shape
    step = max(1, radius // STEPS)
    for row in range(height):
        for column in range(width):
            if out[row, column] > 0.0:
                continue
            least, most = np.inf, 0.0
            # The same ones for all pixels of a hole, which would be rough otherwise.
            top, left = (row - radius) // step * step, (column - radius) // step * step
            for i in range(top, row + radius + 1, step):
                for j in range(left, column + radius + 1, step):
                    if _tells(near, ids, row, column, i, j, inner):
                        least, most = min(least, near[i, j]), max(most, near[i, j])
            if most == 0.0:
                continue
            middle = (least + most) / 2 if most > (1 + TWO * radius) * least else np.inf
            middle = min(middle, _between(near, ids, row, column, inner))
            n = sx = sy = sxx = sxy = syy = sw = sxw = syw = 0.0
            for i in range(top, row + radius + 1, step):
                for j in range(left, column + radius + 1, step):
                    if _tells(near, ids, row, column, i, j, inner) and near[i, j] < middle:
                        off, x, y = near[i, j] - least, j - column, i - row
                        n += 1
                        sx += x
                        sy += y
                        sxx += x * x
                        sxy += x * y
                        syy += y * y
                        sw += off
                        sxw += x * off
                        syw += y * off
            if n < few:
                continue
            told = _at_middle(n, sx, sy, sxx, sxy, syy, sw, sxw, syw)
            if np.isnan(told):
                told = sw / n
            room = min(most, middle) - least
            out[row, column] = least + min(max(told, -room), 2 * room)


@kernel
def _between(near, ids, row, column, inner):
    """The mean 1/z of the next known pixels to the left and to the right, if those lie on two surfaces; else inf."""
    found, steps = np.zeros(2), 0
    for side in range(2):
        j = column
        while found[side] == 0.0 and 0 <= j < near.shape[1]:
            if _tells(near, ids, row, column, row, j, inner):
                found[side] = near[row, j]
            j += 2 * side - 1
            steps += 1
    apart = min(found) > 0.0 and max(found) > (1 + TWO * steps) * min(found)
    return (found[0] + found[1]) / 2 if apart else np.inf


@kernel
def _tells(near, ids, row, column, i, j, inner):
    """Whether a neighbour is in the image, known, of the same id, and not too close."""
    if not (0 <= i < near.shape[0] and 0 <= j < near.shape[1]):
        return False
    if max(abs(i - row), abs(j - column)) <= inner:
        return False
    return near[i, j] > 0.0 and ids[i, j] == ids[row, column]
