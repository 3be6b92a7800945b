"""From the tiles' gradient slots back to the Gaussians' own numbers."""

import math

import numpy as np

from rpaug.core.jit import inlined, kernel
from rpaug.render.splat import _harmonics
from rpaug.render.splat._pinhole import (
    CHUNK,
    DEPTH_CHANNEL,
    FREE,
    HALF_WIDTH,
    MOMENTS,
    OPACITY,
    SMALLEST_RATIO,
    SX,
    SY,
    SZ,
    X,
    Y,
    Z,
    antialias,
    axes,
    combine,
    covariances_of,
    direction,
    dot,
    factor,
    gather,
    rotation,
    shape_of,
    times,
    to_image,
    unit,
)
from rpaug.render.splat._simd import WIDTH, load, store

# More rows of `lanes`: moments of ds over (u, v); pulls on the drawn opacity and on the depth; the opacity;
# gradients by the world covariance, quaternion and scales, by the centre; share kept; motion on the image.
MU, MV, MUU, MUV, MVV, DRAWN, DEPTH, GIVEN = (CHUNK * row for row in range(FREE, FREE + 8))
D_XX, D_XY, D_XZ, D_YY, D_YZ, D_ZZ = (CHUNK * row for row in range(FREE + 8, FREE + 14))
D_QW, D_SX, D_X, D_Y, D_Z = (CHUNK * (FREE + row) for row in (14, 18, 21, 22, 23))
KEPT, MOTION, ROWS = CHUNK * (FREE + 24), CHUNK * (FREE + 25), FREE + 26


@inlined
def _antialias_backward(a, b, c, pull, eye):
    """The share kept, and the gradient of pull * share by the undilated variances (a, b, c).

    d root(D0 / D1) = (adj C0 / root(D0 D1) - root(D0 / D1) adj C1 / D1) / 2, with C1 the dilated matrix.
    """
    wide, high = a + eye.dilation, c + eye.dilation
    determinant = wide * high - b * b
    kept = antialias(wide, b, high, determinant, eye)
    if kept * kept <= SMALLEST_RATIO:
        return kept, 0.0, 0.0, 0.0
    blurred = 0.5 * pull * kept / determinant
    sharp = blurred / (kept * kept)
    return kept, sharp * c - blurred * high, (blurred - sharp) * b, sharp * a - blurred * wide


@inlined
def _rotation_to_quaternion(d, w, x, y, z):
    """Gradient by a unit quaternion from the gradient by its rotation matrix."""
    a, b, c = d
    return (
        2 * (z * (b[0] - a[1]) + y * (a[2] - c[0]) + x * (c[1] - b[2])),
        2 * (y * (a[1] + b[0]) + z * (a[2] + c[0]) - 2 * x * (b[1] + c[2]) + w * (c[1] - b[2])),
        2 * (x * (a[1] + b[0]) + z * (b[2] + c[1]) - 2 * y * (a[0] + c[2]) + w * (a[2] - c[0])),
        2 * (x * (a[2] + c[0]) + y * (b[2] + c[1]) - 2 * z * (a[0] + b[1]) + w * (b[0] - a[1])),
    )


@inlined
def _flatten_backward(lanes, eye):
    """Gradients by the world covariances and the centres of all lanes, from their moments and pulls."""
    right, down, ahead = axes(eye)
    for lane in range(CHUNK):
        offset = (lanes[X + lane], lanes[Y + lane], lanes[Z + lane])
        x, y, z = dot(right, offset), dot(down, offset), dot(ahead, offset)
        shape = shape_of(lanes, lane)
        f, g, across, below = to_image(x, y, z, eye)
        along, aslant = times(shape, f), times(shape, g)
        a, b, c = dot(f, along), dot(g, along), dot(g, aslant)
        # Not from the records: a long needle's gradients cancel to more digits than float32 has.
        l11, l21, l22 = factor(a + eye.dilation, b, c + eye.dilation)

        # s = u^2 + v^2 with (u, v) = L^T (pixel - centre), so dcov = -2 L W L^T with W the second moments.
        mu, mv = lanes[MU + lane], lanes[MV + lane]
        muu, muv, mvv = lanes[MUU + lane], lanes[MUV + lane], lanes[MVV + lane]
        d_column, d_row = -2 * l11 * mu, -2 * (l21 * mu + l22 * mv)
        side, corner = l21 * muu + l22 * muv, l21 * muv + l22 * mvv
        da, db, dc = -2 * l11 * l11 * muu, -2 * l11 * side, -2 * (l21 * side + l22 * corner)
        lanes[MOTION + lane] = math.sqrt(d_column * d_column + d_row * d_row)
        if eye.antialiased:
            pull = lanes[DRAWN + lane] * lanes[GIVEN + lane]
            kept, ea, eb, ec = _antialias_backward(a, b, c, pull, eye)
            lanes[KEPT + lane] = kept
            da, db, dc = da + ea, db + eb, dc + ec

        lanes[D_XX + lane] = da * f[0] * f[0] + 2 * db * f[0] * g[0] + dc * g[0] * g[0]
        lanes[D_YY + lane] = da * f[1] * f[1] + 2 * db * f[1] * g[1] + dc * g[1] * g[1]
        lanes[D_ZZ + lane] = da * f[2] * f[2] + 2 * db * f[2] * g[2] + dc * g[2] * g[2]
        lanes[D_XY + lane] = da * f[0] * f[1] + db * (f[0] * g[1] + f[1] * g[0]) + dc * g[0] * g[1]
        lanes[D_XZ + lane] = da * f[0] * f[2] + db * (f[0] * g[2] + f[2] * g[0]) + dc * g[0] * g[2]
        lanes[D_YZ + lane] = da * f[1] * f[2] + db * (f[1] * g[2] + f[2] * g[1]) + dc * g[1] * g[2]

        # The rows that map to the image depend on the point too.
        df, dg = combine(2 * da, along, 2 * db, aslant), combine(2 * db, along, 2 * dc, aslant)
        near = 1.0 / z
        p, q = eye.fx * near, eye.fy * near
        d_across, d_below = -p * dot(df, ahead), -q * dot(dg, ahead)
        dz = -p * (dot(df, right) + d_column * x) - q * (dot(dg, down) + d_row * y)
        dz = (dz - d_across * across - d_below * below) * near + lanes[DEPTH + lane]
        # Where the slopes are held at the margin they pass no gradient on.
        d_across = d_across * near if across == x * near else 0.0
        d_below = d_below * near if below == y * near else 0.0
        dx, dy = p * d_column + d_across, q * d_row + d_below
        dz -= (d_across * x + d_below * y) * near
        lanes[D_X + lane] = right[0] * dx + down[0] * dy + ahead[0] * dz
        lanes[D_Y + lane] = right[1] * dx + down[1] * dy + ahead[1] * dz
        lanes[D_Z + lane] = right[2] * dx + down[2] * dy + ahead[2] * dz


@inlined
def _shapes_backward(lanes):
    """Gradients by the quaternions and scales of all lanes, from those by their world covariances."""
    for lane in range(CHUNK):
        w, x, y, z, length = unit(lanes, lane)
        a, b, c = rotation(w, x, y, z)
        s, t, u = lanes[SX + lane], lanes[SY + lane], lanes[SZ + lane]
        d = (
            lanes[D_XX + lane], lanes[D_XY + lane], lanes[D_XZ + lane],
            lanes[D_YY + lane], lanes[D_YZ + lane], lanes[D_ZZ + lane],
        )  # fmt: skip
        # cov = M M^T with M = R diag(scales): dM = 2 dcov M, column by column.
        first, second, third = (a[0], b[0], c[0]), (a[1], b[1], c[1]), (a[2], b[2], c[2])
        p, q, r = times(d, first), times(d, second), times(d, third)
        lanes[D_SX + lane] = 2 * s * dot(p, first)
        lanes[D_SX + CHUNK + lane] = 2 * t * dot(q, second)
        lanes[D_SX + 2 * CHUNK + lane] = 2 * u * dot(r, third)
        s, t, u = 2 * s * s, 2 * t * t, 2 * u * u
        d_rotation = (
            (s * p[0], t * q[0], u * r[0]),
            (s * p[1], t * q[1], u * r[1]),
            (s * p[2], t * q[2], u * r[2]),
        )
        dw, dx, dy, dz = _rotation_to_quaternion(d_rotation, w, x, y, z)
        along = dw * w + dx * x + dy * y + dz * z  # length does not matter: no gradient along q
        lanes[D_QW + lane] = (dw - along * w) * length
        lanes[D_QW + CHUNK + lane] = (dx - along * x) * length
        lanes[D_QW + 2 * CHUNK + lane] = (dy - along * y) * length
        lanes[D_QW + 3 * CHUNK + lane] = (dz - along * z) * length


@inlined
def _color_backward(sh, i, offset, gradient, at, harmonic, weight, d_sh):
    """Write the gradient by the harmonics' coefficients; returns that by the offset to the camera."""
    count = sh.shape[1]
    x, y, z, near = direction(offset, count)
    _harmonics.basis(x, y, z, count, harmonic)
    for k in range(count):
        weight[k] = 0.0
    for channel in range(3):
        color = 0.5
        for k in range(count):
            color += harmonic[k] * sh[i, k, channel]
        pull = float(gradient[at + MOMENTS + channel]) if color >= 0.0 else 0.0  # black is clamped
        for k in range(count):
            d_sh[i, k, channel] = pull * harmonic[k]
            weight[k] += pull * sh[i, k, channel]
    if count == 1:
        return 0.0, 0.0, 0.0
    dx, dy, dz = _harmonics.slope(x, y, z, count, weight)
    outward = dx * x + dy * y + dz * z
    return (
        (dx - outward * x) * near,
        (dy - outward * y) * near,
        (dz - outward * z) * near,
    )


@inlined
def _summed(slots, first, last, stride, out, at):
    """out[at:at + stride] = the sum of slots first..last, in order; there is one at least."""
    for k in range(0, stride, WIDTH):
        total = load(slots, first * stride + k)
        for slot in range(first + 1, last):
            total = total + load(slots, slot * stride + k)
        store(out, at + k, total)


@kernel
# Long: one chain rule from top to bottom, in the order of the forward pass.
def project_backward(
    start, stop, means, opacities, sh, quats, scales, covariances, features, eye, records, channels,
    first_slot, slots, d_means, d_opacities, d_sh, d_quats, d_scales, d_covariances, d_features, motion,
):  # fmt: skip
    """Gradients of rows start..stop, from the slots that the tiles filled.

    The slots of Gaussian i are numbers first_slot[i]..first_slot[i + 1]; each holds the six moments and one
    number per channel, padded to whole vectors. They are summed in order, whoever filled them. Gaussians
    without slots get zeros.
    """
    stride = WIDTH * ((MOMENTS + channels + WIDTH - 1) // WIDTH)
    totals = np.empty(CHUNK * stride, np.float32)
    harmonic, weight = np.empty(16, np.float64), np.empty(16, np.float64)
    lanes = np.ones(ROWS * CHUNK, np.float64)
    who = np.empty(CHUNK, np.int64)  # the Gaussians in the lanes: those that were seen
    i = start
    while i < stop:
        count = 0
        while i < stop and count < CHUNK:
            if first_slot[i] < first_slot[i + 1] and records[i, HALF_WIDTH] >= 0:
                who[count] = i
                count += 1
            else:  # its numbers may make no sense
                d_opacities[i] = motion[i] = 0.0
                d_means[i], d_sh[i], d_features[i] = 0.0, 0.0, 0.0
                if len(covariances):
                    d_covariances[i] = 0.0
                else:
                    d_quats[i], d_scales[i] = 0.0, 0.0
            i += 1
        for lane in range(count):
            seen, at = who[lane], lane * stride
            _summed(slots, first_slot[seen], first_slot[seen + 1], stride, totals, at)
            gather(lanes, lane, seen, means, quats, scales, covariances, eye)
            for k in range(1, MOMENTS):
                lanes[MU + (k - 1) * CHUNK + lane] = totals[at + k]
            lanes[DEPTH + lane] = totals[at + MOMENTS + DEPTH_CHANNEL]
            lanes[GIVEN + lane] = min(opacities[seen], np.float32(1))
            lanes[DRAWN + lane] = -totals[at] / records[seen, OPACITY]
        if not len(covariances):
            covariances_of(lanes)
        _flatten_backward(lanes, eye)
        if not len(covariances):
            _shapes_backward(lanes)
        for lane in range(count):
            seen, at = who[lane], lane * stride
            kept = lanes[KEPT + lane] if eye.antialiased else 1.0
            d_opacities[seen] = lanes[DRAWN + lane] * kept if opacities[seen] <= 1.0 else 0.0
            motion[seen] = lanes[MOTION + lane]
            if len(covariances):
                for k in range(6):
                    twice = 1.0 if k == 0 or k == 3 or k == 5 else 2.0  # xy stands for two entries
                    d_covariances[seen, k] = twice * lanes[D_XX + k * CHUNK + lane]
            else:
                for k in range(4):
                    d_quats[seen, k] = lanes[D_QW + k * CHUNK + lane]
                for k in range(3):
                    d_scales[seen, k] = lanes[D_SX + k * CHUNK + lane]
            offset = (lanes[X + lane], lanes[Y + lane], lanes[Z + lane])
            ex, ey, ez = _color_backward(sh, seen, offset, totals, at, harmonic, weight, d_sh)
            d_means[seen, 0] = lanes[D_X + lane] + ex
            d_means[seen, 1] = lanes[D_Y + lane] + ey
            d_means[seen, 2] = lanes[D_Z + lane] + ez
            for k in range(features.shape[1]):
                d_features[seen, k] = totals[at + MOMENTS + DEPTH_CHANNEL + 1 + k]
