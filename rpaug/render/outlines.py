"""What a recorded pixel's surfel covers: its slope, and where inside the pixel an outline ends it.

A pixel shows one thing, but the outline between two things passes somewhere between their pixels. The staircase of
pixels along it tells where: the share of pixels around that show the near thing, and the direction they lie in, fix a
straight line to a fraction of a pixel. The near thing's surfels end at that line, and the far thing's go on behind.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, Int8, Int32

from rpaug.core.jit import inlined, kernel

HALF = 0.52  # pixels: a pixel's own 0.5 and a little more, so that rounding leaves no gap
WIDE = 0.8  # pixels: how far a surfel at an outline may reach, short of the next pixel's centre
MAX_SLOPE = 0.08  # of 1/z per pixel: steeper is a step between two surfaces, not a plane
STEP = 0.006  # of 1/z: the least step between two surfaces, in depth without noise
BEND = 0.03  # of 1/z per pixel: what a surface of one id may curve away from the plane
RADIUS, SPREAD = 3, 1.2  # pixels around that tell where an outline runs, and their Gaussian weight
INNERMOST = 0.02  # pixels between a pixel's centre and its outline, at least
MOST = 0.9  # of the pixels around, either way: with more the erf's inverse is all rounding

_BELL = np.exp(-0.5 * (np.arange(RADIUS + 1) / SPREAD) ** 2)

INSIDE, BEHIND, TOUCHING, BEFORE = 0, 1, 2, 3


@dataclass(frozen=True)
class Footprints:
    """Per pixel: `near`, 1/z; `slope` of 1/z across and down, per pixel; `edge`, how the surfel ends; `line` (a, b, c).

    `edge` is INSIDE a surface, BEHIND a nearer neighbour, TOUCHING another thing at the same depth, or BEFORE a
    farther neighbour. The last two have an outline: (x, y) pixels from the pixel's centre is within it where
    a x + b y + c >= 0.
    """

    near: Float64[np.ndarray, "h w"]
    slope: Float64[np.ndarray, "h w 2"]
    edge: Int8[np.ndarray, "h w"]
    line: Float64[np.ndarray, "h w 3"]

    @property
    def nbytes(self) -> int:
        """Bytes that the arrays hold."""
        return sum(array.nbytes for array in (self.near, self.slope, self.edge, self.line))


def grown(prints: Footprints, scale: float) -> Footprints:
    """The footprints of the same image if camera and world were `scale` times as large."""
    if scale == 1.0:
        return prints
    near = np.where(prints.near > 0, prints.near / scale, prints.near)
    return replace(prints, near=near, slope=prints.slope / scale)


def footprints(
    near: Float64[np.ndarray, "h w"], ids: Int32[np.ndarray, "h w"], step: float = STEP
) -> Footprints:
    """Footprints of an image of 1/z (0: infinitely far, negative: not known) and instance ids.

    A neighbour that is off a surfel's plane by the share `step` of 1/z lies before or behind it.
    """
    slope, line = np.zeros((*near.shape, 2)), np.zeros((*near.shape, 3))
    edge = np.zeros(near.shape, np.int8)
    _footprints(near, ids, step, slope, edge, line)
    return Footprints(near, slope, edge, line)


@kernel
def _footprints(near, ids, step, slope, edge, line):
    for row in range(near.shape[0]):
        for column in range(near.shape[1]):
            if near[row, column] <= 0.0:
                continue
            slope[row, column, 0] = _slope(near, ids, row, column, 0, 1)
            slope[row, column, 1] = _slope(near, ids, row, column, 1, 0)
    within = np.empty(near.shape[1], np.bool_)
    for row in range(near.shape[0]):
        _within(near, ids, slope, row, within)
        for column in range(near.shape[1]):
            if near[row, column] <= 0.0 or within[column]:
                continue
            edge[row, column] = _edge(near, ids, slope, step, row, column)
            if edge[row, column] >= TOUCHING:
                a, b, c = _outline(near, ids, slope, step, row, column)
                line[row, column, 0], line[row, column, 1], line[row, column, 2] = a, b, c


@inlined
def _slope(near, ids, row, column, down, right):
    """Change of 1/z per pixel along one axis, from the flatter side among neighbours of the same id.

    The flatter side is the one that stays on the surface where a pixel lies at the edge of a step.
    """
    here = near[row, column]
    best, limit = 0.0, MAX_SLOPE * here
    for side in (-1, 1):
        i, j = row + side * down, column + side * right
        if 0 <= i < near.shape[0] and 0 <= j < near.shape[1]:
            step = side * (near[i, j] - here)
            if near[i, j] > 0.0 and ids[i, j] == ids[row, column] and abs(step) < limit:
                best, limit = step, abs(step)
    return best


@kernel
def _within(near, ids, slope, row, out):
    """Which pixels of a row lie within their surface: each known neighbour shows it too. Without branches, for vectors;
    `_edge` finds the same."""
    width = near.shape[1]
    out[:] = True
    for i in range(max(0, row - 1), min(near.shape[0], row + 2)):
        for right in range(-1, 2):
            left, end = max(0, -right), min(width, width - right)
            here, there = near[row, left:end], near[i, left + right : end + right]
            own, other = ids[row, left:end], ids[i, left + right : end + right]
            steps, still = slope[row, left:end].reshape(-1), out[left:end]
            for k in range(len(here)):
                off = there[k] - (here[k] + steps[2 * k] * right + steps[2 * k + 1] * (i - row))
                same = (own[k] == other[k]) & (abs(off) < BEND * here[k])
                still[k] &= same | (there[k] < 0.0)


@inlined
def _hides(near, slope, step, row, column, i, j):
    """Whether the nearer surface at (i, j) stands before the one at (row, column), rather than meets it."""
    there = near[i, j] + slope[i, j, 0] * (column - j) + slope[i, j, 1] * (row - i)
    return there >= (1.0 + step) * near[row, column]


@inlined
def _edge(near, ids, slope, step, row, column):
    """How the surfel ends, from its eight neighbours."""
    here, across, down = near[row, column], slope[row, column, 0], slope[row, column, 1]
    found = INSIDE
    for i in range(max(0, row - 1), min(near.shape[0], row + 2)):
        for j in range(max(0, column - 1), min(near.shape[1], column + 2)):
            off = near[i, j] - (here + across * (j - column) + down * (i - row))
            if near[i, j] < 0.0 or (ids[i, j] == ids[row, column] and abs(off) < BEND * here):
                continue
            if off <= -step * here:
                found = max(found, BEFORE)
            elif off < step * here or not _hides(near, slope, step, row, column, i, j):
                found = max(found, TOUCHING)
            else:
                found = max(found, BEHIND)
    return found


@kernel
def _outline(near, ids, slope, step, row, column):
    """The straight line between this surface and what lies behind or beside it; what hides it tells nothing.

    Under Gaussian weights the share of a half-plane is erf(c / sqrt(2) SPREAD) for a line at distance c. No
    neighbour's centre that shows something else is within it.
    """
    here, across, down = near[row, column], slope[row, column, 0], slope[row, column, 1]
    total = share = x_share = y_share = 0.0
    for i in range(max(0, row - RADIUS), min(near.shape[0], row + RADIUS + 1)):
        for j in range(max(0, column - RADIUS), min(near.shape[1], column + RADIUS + 1)):
            x, y = j - column, i - row
            off = near[i, j] - (here + across * x + down * y)
            bend = BEND * here * (1 + max(abs(x), abs(y)))
            side = 1.0 if ids[i, j] == ids[row, column] and abs(off) < bend else -1.0
            if near[i, j] < 0.0:
                continue
            if side < 0.0 and off >= step * here and _hides(near, slope, step, row, column, i, j):
                continue
            weight = _BELL[abs(y)] * _BELL[abs(x)]
            total += weight
            share += weight * side
            x_share += weight * side * x
            y_share += weight * side * y
    size = math.hypot(x_share, y_share)
    if size < 1e-9 * total:
        return 0.0, 0.0, HALF  # the same on all sides
    share = min(max(share / total, -MOST), MOST)
    away = math.sqrt(2.0) * SPREAD * _inverse_erf(share)
    a, b = x_share / size, y_share / size
    away = min(away, _nearest_other(near, ids, slope, step, row, column, a, b) - INNERMOST)
    return a, b, max(away, INNERMOST)


@inlined
def _nearest_other(near, ids, slope, step, row, column, a, b):
    """How far out along (-a, -b) the first neighbour's centre lies that shows something beside or behind."""
    here, across, down = near[row, column], slope[row, column, 0], slope[row, column, 1]
    nearest = 2.0
    for i in range(max(0, row - 1), min(near.shape[0], row + 2)):
        for j in range(max(0, column - 1), min(near.shape[1], column + 2)):
            away = -a * (j - column) - b * (i - row)
            if away <= 0.0 or away >= nearest or near[i, j] < 0.0:
                continue
            off = near[i, j] - (here + across * (j - column) + down * (i - row))
            if ids[i, j] == ids[row, column] and abs(off) < 2.0 * BEND * here:
                continue
            if off < step * here or not _hides(near, slope, step, row, column, i, j):
                nearest = away
    return nearest


@inlined
def _inverse_erf(share):
    """To 2e-3 (Winitzki 2008)."""
    log = math.log(1.0 - share * share)
    half = 2.0 / (math.pi * 0.147) + 0.5 * log
    return math.copysign(math.sqrt(math.sqrt(half * half - log / 0.147) - half), share)
