"""Gaussians onto the image plane: what `_pinhole` calls records, and the values they blend."""

import math

import numpy as np

from rpaug.core.jit import inlined, kernel
from rpaug.render.splat import _harmonics
from rpaug.render.splat._pinhole import (
    CHUNK,
    COLUMN,
    DEPTH_CHANNEL,
    FARTHEST,
    FREE,
    HALF_WIDTH,
    L11,
    L21,
    L22,
    OPACITY,
    QW,
    ROW,
    XX,
    X,
    Y,
    Z,
    antialias,
    axes,
    covariances_of,
    direction,
    dot,
    factor,
    gather,
    shape_of,
    times,
    to_image,
)
from rpaug.render.splat.settings import LARGEST

ROWS = 11
NOWHERE = -1e9  # pixels
# More rows of `lanes`: z, the centre on the image, variances, determinant, L, share of opacity kept, and a
# number that is 0 if the geometry was given in finite numbers.
DEPTH, CENTRE_X, CENTRE_Y, WIDE, HIGH, DETERMINANT, P11, P21, P22, KEPT, POISON = (
    CHUNK * row for row in range(FREE, FREE + ROWS)
)


@inlined
def _finite(lane, i, lanes, opacities, sh, features):
    """Whether every number of Gaussian i is finite: 0 times infinity or NaN is NaN."""
    total = np.float32(0) * opacities[i]
    for k in range(sh.shape[1]):
        for channel in range(3):
            total += np.float32(0) * sh[i, k, channel]
    for k in range(features.shape[1]):
        total += np.float32(0) * features[i, k]
    return total + lanes[POISON + lane] == 0.0


@inlined
def _leave_out(records, i):
    """A record that nothing sees, even where an older order still lists it."""
    records[i, COLUMN] = records[i, ROW] = NOWHERE
    records[i, L11], records[i, L21], records[i, L22] = 0.0, 0.0, 1.0
    records[i, OPACITY] = records[i, FARTHEST] = 0.0
    records[i, HALF_WIDTH] = -1.0


@inlined
def _flatten(lanes, eye):
    """The geometry of all lanes on the image; where it makes no sense the numbers do not either."""
    right, down, ahead = axes(eye)
    for lane in range(CHUNK):
        offset = (lanes[X + lane], lanes[Y + lane], lanes[Z + lane])
        x, y, z = dot(right, offset), dot(down, offset), dot(ahead, offset)
        shape = shape_of(lanes, lane)
        first, second, _, _ = to_image(x, y, z, eye)
        along = times(shape, first)
        a = dot(first, along) + eye.dilation
        b = dot(second, along)
        c = dot(second, times(shape, second)) + eye.dilation
        lanes[DEPTH + lane] = z
        near = 1.0 / z
        lanes[CENTRE_X + lane] = eye.fx * x * near + eye.cx
        lanes[CENTRE_Y + lane] = eye.fy * y * near + eye.cy
        lanes[WIDE + lane], lanes[HIGH + lane] = a, c
        determinant = a * c - b * b
        lanes[DETERMINANT + lane] = determinant
        lanes[P11 + lane], lanes[P21 + lane], lanes[P22 + lane] = factor(a, b, c)
        if eye.antialiased:
            lanes[KEPT + lane] = antialias(a, b, c, determinant, eye)
        given = lanes[X + lane] + lanes[Y + lane] + lanes[Z + lane]
        for k in range(QW, XX + 6 * CHUNK, CHUNK):
            given += lanes[k + lane]
        lanes[POISON + lane] = 0.0 * given


@kernel
def project(
    start, stop, means, opacities, sh, quats, scales, covariances, features, eye, records, values, depths,
):  # fmt: skip
    """Fill rows start..stop of `records`, `values` and `depths`; returns how many were not finite.

    `values` gets red, green, blue, depth, the features, then zeros. `depths` is z in the camera's frame.
    """
    count, bad = sh.shape[1], 0
    harmonic = np.empty(16, np.float64)
    lanes = np.ones((FREE + ROWS) * CHUNK, np.float64)
    for begin in range(start, stop, CHUNK):
        end = min(begin + CHUNK, stop)
        for i in range(begin, end):
            gather(lanes, i - begin, i, means, quats, scales, covariances, eye)
        if not len(covariances):
            covariances_of(lanes)
        _flatten(lanes, eye)
        for i in range(begin, end):
            lane = i - begin
            _leave_out(records, i)
            if not _finite(lane, i, lanes, opacities, sh, features):
                bad += 1
                continue
            z = lanes[DEPTH + lane]
            if not z >= eye.near:
                continue
            wide, column, row = lanes[WIDE + lane], lanes[CENTRE_X + lane], lanes[CENTRE_Y + lane]
            size = max(wide + lanes[HIGH + lane], abs(column), abs(row))
            if not size < LARGEST:
                bad += 1
                continue
            if not lanes[DETERMINANT + lane] > 0.0:
                continue
            opacity = min(float(opacities[i]), 1.0)
            if eye.antialiased:
                opacity *= lanes[KEPT + lane]
            if not np.float32(opacity) >= np.float32(eye.alpha_floor):
                continue
            farthest = math.log(np.float32(opacity / eye.alpha_floor)) * (1 + 1e-4) + 1e-4
            records[i, COLUMN], records[i, ROW] = column, row
            records[i, L11], records[i, L21] = lanes[P11 + lane], lanes[P21 + lane]
            records[i, L22], records[i, OPACITY] = lanes[P22 + lane], opacity
            records[i, FARTHEST] = farthest
            records[i, HALF_WIDTH] = math.sqrt(2 * farthest * wide)
            depths[i] = z
            offset = (lanes[X + lane], lanes[Y + lane], lanes[Z + lane])
            _colors(i, offset, sh, count, harmonic, values)
            values[i, DEPTH_CHANNEL] = z
            for k in range(features.shape[1]):
                values[i, DEPTH_CHANNEL + 1 + k] = features[i, k]
    return bad


@inlined
def _colors(i, offset, sh, count, harmonic, values):
    """Red, green and blue of Gaussian i as seen along `offset`, not below zero."""
    if count == 1:
        for channel in range(3):
            values[i, channel] = max(0.5 + _harmonics.C0 * sh[i, 0, channel], 0.0)
        return
    east, south, far, _ = direction(offset, count)
    _harmonics.basis(east, south, far, count, harmonic)
    for channel in range(3):
        color = 0.5
        for k in range(count):
            color += harmonic[k] * sh[i, k, channel]
        values[i, channel] = max(color, 0.0)
