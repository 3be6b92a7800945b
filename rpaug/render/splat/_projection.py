"""Gaussians onto the image plane, and the gradient of that, in float64 one Gaussian at a time.

A Gaussian becomes one row of `records`: column, row, l11, l21, l22, opacity, farthest, half width. A pixel
at offset (dx, dy) from its centre has exponent s = u^2 + v^2 with u = l11 dx + l21 dy and v = l22 dy, and
alpha = opacity * exp(-s). In these whitened coordinates s is never negative and thin needles lose no digits;
the gradients by mean and covariance follow from the moments of ds over (u, v) without an inverse. `farthest`
is the exponent at which alpha falls to the floor: a splat ends where |v| = root(farthest), and half a width
to either side of its centre. The half width is -1 where nothing is drawn.
"""

import math
from typing import NamedTuple

import numpy as np

from rpaug.render.jit import inlined, kernel
from rpaug.render.splat import _harmonics
from rpaug.render.splat._simd import WIDTH, load, store
from rpaug.render.splat.settings import LARGEST, Settings, View

COLUMN, ROW, L11, L21, L22, OPACITY, FARTHEST, HALF_WIDTH = range(8)
MOMENTS = 6  # ds, ds u, ds v, ds u u, ds u v, ds v v: first in each gradient slot
DEPTH_CHANNEL = 3  # values are red, green, blue, depth, features
SMALLEST_RATIO = 1e-12  # of determinants, in antialiased mode: keeps the root's slope finite


class Pinhole(NamedTuple):
    """A view and the constants of projection as plain numbers."""

    r00: float
    r01: float
    r02: float
    r10: float
    r11: float
    r12: float
    r20: float
    r21: float
    r22: float
    centre_x: float
    centre_y: float
    centre_z: float
    fx: float
    fy: float
    cx: float
    cy: float
    across_low: float
    across_high: float
    down_low: float
    down_high: float
    near: float
    dilation: float
    alpha_floor: float
    antialiased: bool


def pinhole(view: View, settings: Settings) -> Pinhole:
    """The numbers the kernels need; the camera's centre is found in float64."""
    turn, shift = view.world_to_camera[:3, :3], view.world_to_camera[:3, 3]
    fx, fy, cx, cy = (float(view.K[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
    wide = settings.frustum_margin * view.width / (2 * fx)
    high = settings.frustum_margin * view.height / (2 * fy)
    return Pinhole._make(
        [
            *turn.ravel().tolist(),
            *(-turn.T @ shift).tolist(),
            *(fx, fy, cx, cy),
            -(cx + 0.5) / fx - wide,
            (view.width - 0.5 - cx) / fx + wide,
            -(cy + 0.5) / fy - high,
            (view.height - 0.5 - cy) / fy + high,
            *(float(settings.near), float(settings.dilation), float(settings.alpha_floor)),
            bool(settings.antialiased),
        ]
    )


@inlined
def _unit(quats, i):
    """The unit quaternion and the factor that made it so; zeros for a quaternion of zeros."""
    w, x, y, z = (float(quats[i, 0]), float(quats[i, 1]), float(quats[i, 2]), float(quats[i, 3]))
    square = w * w + x * x + y * y + z * z
    factor = 1.0 / math.sqrt(square) if square > 0.0 else 0.0
    return w * factor, x * factor, y * factor, z * factor, factor


@inlined
def _rotation(w, x, y, z):
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


@inlined
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def _combine(p, a, q, b):
    return (p * a[0] + q * b[0], p * a[1] + q * b[1], p * a[2] + q * b[2])


@inlined
def _times(shape, a):
    """A symmetric matrix (xx, xy, xz, yy, yz, zz) times a vector."""
    xx, xy, xz, yy, yz, zz = shape
    return (
        xx * a[0] + xy * a[1] + xz * a[2],
        xy * a[0] + yy * a[1] + yz * a[2],
        xz * a[0] + yz * a[1] + zz * a[2],
    )


@inlined
def _world_covariance(quats, scales, covariances, i):
    """Six entries of the world covariance, in float64."""
    if len(covariances):
        c = covariances[i]
        return (float(c[0]), float(c[1]), float(c[2]), float(c[3]), float(c[4]), float(c[5]))
    w, x, y, z, _ = _unit(quats, i)
    a, b, c = _rotation(w, x, y, z)
    s, t, u = (float(scales[i, 0]) ** 2, float(scales[i, 1]) ** 2, float(scales[i, 2]) ** 2)
    return (
        a[0] * a[0] * s + a[1] * a[1] * t + a[2] * a[2] * u,
        a[0] * b[0] * s + a[1] * b[1] * t + a[2] * b[2] * u,
        a[0] * c[0] * s + a[1] * c[1] * t + a[2] * c[2] * u,
        b[0] * b[0] * s + b[1] * b[1] * t + b[2] * b[2] * u,
        b[0] * c[0] * s + b[1] * c[1] * t + b[2] * c[2] * u,
        c[0] * c[0] * s + c[1] * c[1] * t + c[2] * c[2] * u,
    )


@inlined
def _offset(means, i, eye):
    """The centre relative to the camera's, on world axes."""
    return (
        float(means[i, 0]) - eye.centre_x,
        float(means[i, 1]) - eye.centre_y,
        float(means[i, 2]) - eye.centre_z,
    )


@inlined
def _axes(eye):
    return (
        (eye.r00, eye.r01, eye.r02),
        (eye.r10, eye.r11, eye.r12),
        (eye.r20, eye.r21, eye.r22),
    )


@inlined
def _direction(offset, count):
    """Unit vector from the camera and 1 / distance; zeros where only the constant harmonic is asked for."""
    near = 1.0 / math.sqrt(_dot(offset, offset)) if count > 1 else 0.0
    return offset[0] * near, offset[1] * near, offset[2] * near, near


@inlined
def _clamped(value, low, high):
    return min(max(value, low), high)


@inlined
def _to_image(point, eye):
    """The two rows of (Jacobian of the projection) * (rotation), with far-off points held at the margin."""
    right, down, ahead = _axes(eye)
    x, y, z = point
    near = 1.0 / z
    across = _clamped(x * near, eye.across_low, eye.across_high)
    below = _clamped(y * near, eye.down_low, eye.down_high)
    return (
        _combine(eye.fx * near, right, -eye.fx * near * across, ahead),
        _combine(eye.fy * near, down, -eye.fy * near * below, ahead),
        across,
        below,
    )


@inlined
def _poison(array, i):
    """0 if a row is finite, else NaN: 0 * infinity is NaN too."""
    total = 0.0
    for k in range(array.shape[1]):
        total += array[i, k] * 0.0
    return total


@inlined
def _all_finite(means, opacities, sh, quats, scales, covariances, features, i):
    total = _poison(means, i) + opacities[i] * 0.0 + _poison(features, i)
    if len(covariances):
        total += _poison(covariances, i)
    else:
        total += _poison(quats, i) + _poison(scales, i)
    for k in range(sh.shape[1]):
        for channel in range(3):
            total += sh[i, k, channel] * 0.0
    return total == 0.0


@inlined
def _antialias(a, b, c, determinant, eye):
    """Share of its opacity that a splat keeps when dilation grows it (Mip-Splatting, eq. 10)."""
    sharp = (a - eye.dilation) * (c - eye.dilation) - b * b
    return math.sqrt(max(sharp / determinant, SMALLEST_RATIO))


@inlined
def _factor(a, b, c):
    """Lower triangle L with 2 L L^T the inverse of the covariance (a, b, c)."""
    l11, inverse = math.sqrt(0.5 * c / (a * c - b * b)), 1.0 / c
    return l11, -b * inverse * l11, math.sqrt(0.5 * inverse)


@inlined
def _antialias_backward(a, b, c, pull, eye):
    """The share kept, and the gradient of pull * share by the undilated variances (a, b, c).

    d root(D0 / D1) = (adj C0 / root(D0 D1) - root(D0 / D1) adj C1 / D1) / 2, with C1 the dilated matrix.
    """
    wide, high = a + eye.dilation, c + eye.dilation
    determinant = wide * high - b * b
    kept = _antialias(wide, b, high, determinant, eye)
    if kept * kept <= SMALLEST_RATIO:
        return kept, 0.0, 0.0, 0.0
    blurred = 0.5 * pull * kept / determinant
    sharp = blurred / (kept * kept)
    return kept, sharp * c - blurred * high, (blurred - sharp) * b, sharp * a - blurred * wide


@inlined
def half_size(records, i):
    """Half width and half height of what a Gaussian may change, in pixels."""
    return records[i, HALF_WIDTH], math.sqrt(records[i, FARTHEST]) / records[i, L22]


@kernel
def project(
    start,
    stop,
    means,
    opacities,
    sh,
    quats,
    scales,
    covariances,
    features,
    eye,
    records,
    values,
    depths,
):
    """Fill rows start..stop of `records`, `values` and `depths`; returns how many were not finite.

    `values` gets red, green, blue, depth, the features, then zeros. `depths` is z in the camera's frame.
    """
    right, down, ahead = _axes(eye)
    count, bad = sh.shape[1], 0
    harmonic = np.empty(16, np.float64)
    for i in range(start, stop):
        records[i, HALF_WIDTH] = -1.0
        if not _all_finite(means, opacities, sh, quats, scales, covariances, features, i):
            bad += 1
            continue
        offset = _offset(means, i, eye)
        x, y, z = _dot(right, offset), _dot(down, offset), _dot(ahead, offset)
        if not z >= eye.near:
            continue
        shape = _world_covariance(quats, scales, covariances, i)
        first, second, _, _ = _to_image((x, y, z), eye)
        along = _times(shape, first)
        a = _dot(first, along) + eye.dilation
        b = _dot(second, along)
        c = _dot(second, _times(shape, second)) + eye.dilation
        near = 1.0 / z
        column, row = eye.fx * x * near + eye.cx, eye.fy * y * near + eye.cy
        if not (a + c < LARGEST and abs(column) < LARGEST and abs(row) < LARGEST):
            bad += 1
            continue
        determinant = a * c - b * b
        if not determinant > 0.0:
            continue
        opacity = min(float(opacities[i]), 1.0)
        if eye.antialiased:
            opacity *= _antialias(a, b, c, determinant, eye)
        if not np.float32(opacity) >= np.float32(eye.alpha_floor):
            continue
        farthest = math.log(np.float32(opacity / eye.alpha_floor)) * (1 + 1e-4) + 1e-4
        records[i, COLUMN], records[i, ROW] = column, row
        records[i, L11], records[i, L21], records[i, L22] = _factor(a, b, c)
        records[i, OPACITY] = opacity
        records[i, FARTHEST] = farthest
        records[i, HALF_WIDTH] = math.sqrt(2 * farthest * a)
        depths[i] = z

        east, south, far, _ = _direction(offset, count)
        _harmonics.basis(east, south, far, count, harmonic)
        for channel in range(3):
            colour = 0.5
            for k in range(count):
                colour += harmonic[k] * sh[i, k, channel]
            values[i, channel] = max(colour, 0.0)
        values[i, DEPTH_CHANNEL] = z
        for k in range(features.shape[1]):
            values[i, DEPTH_CHANNEL + 1 + k] = features[i, k]
    return bad


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
def _shape_backward(quats, scales, covariances, i, d, d_quats, d_scales, d_covariances):
    """Write the gradients by a Gaussian's shape, from that by its world covariance (symmetric, six entries)."""
    if len(covariances):
        for k in range(6):
            twice = 1.0 if k == 0 or k == 3 or k == 5 else 2.0  # xy stands for two entries
            d_covariances[i, k] = twice * d[k]
        return
    w, x, y, z, factor = _unit(quats, i)
    a, b, c = _rotation(w, x, y, z)
    s, t, u = float(scales[i, 0]), float(scales[i, 1]), float(scales[i, 2])
    # cov = M M^T with M = R diag(scales): dM = 2 dcov M, column by column.
    p = _times(d, (a[0], b[0], c[0]))
    q = _times(d, (a[1], b[1], c[1]))
    r = _times(d, (a[2], b[2], c[2]))
    d_scales[i, 0] = 2 * s * _dot(p, (a[0], b[0], c[0]))
    d_scales[i, 1] = 2 * t * _dot(q, (a[1], b[1], c[1]))
    d_scales[i, 2] = 2 * u * _dot(r, (a[2], b[2], c[2]))
    s, t, u = 2 * s * s, 2 * t * t, 2 * u * u
    d_rotation = (
        (s * p[0], t * q[0], u * r[0]),
        (s * p[1], t * q[1], u * r[1]),
        (s * p[2], t * q[2], u * r[2]),
    )
    dw, dx, dy, dz = _rotation_to_quaternion(d_rotation, w, x, y, z)
    along = dw * w + dx * x + dy * y + dz * z  # length does not matter: no gradient along q
    d_quats[i, 0] = (dw - along * w) * factor
    d_quats[i, 1] = (dx - along * x) * factor
    d_quats[i, 2] = (dy - along * y) * factor
    d_quats[i, 3] = (dz - along * z) * factor


@inlined
def _colour_backward(sh, i, offset, gradient, harmonic, weight, d_sh):
    """Write the gradient by the harmonics' coefficients; returns that by the offset to the camera."""
    count = sh.shape[1]
    x, y, z, near = _direction(offset, count)
    _harmonics.basis(x, y, z, count, harmonic)
    for k in range(count):
        weight[k] = 0.0
    for channel in range(3):
        colour = 0.5
        for k in range(count):
            colour += harmonic[k] * sh[i, k, channel]
        pull = float(gradient[MOMENTS + channel]) if colour >= 0.0 else 0.0  # black is clamped
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


@kernel
def project_backward(
    start, stop, means, opacities, sh, quats, scales, covariances, features, eye, records,
    channels, first_slot, slots, d_means, d_opacities, d_sh, d_quats, d_scales, d_covariances, d_features, motion,
):  # fmt: skip
    """Gradients of rows start..stop, from the slots that the tiles filled.

    The slots of Gaussian i are numbers first_slot[i]..first_slot[i + 1]; each holds the six moments and one
    number per channel, padded to whole vectors. They are summed in order, whoever filled them. Gaussians
    without slots get zeros.
    """
    right, down, ahead = _axes(eye)
    stride = WIDTH * ((MOMENTS + channels + WIDTH - 1) // WIDTH)
    total = np.empty(stride, np.float32)
    harmonic, weight = np.empty(16, np.float64), np.empty(16, np.float64)
    for i in range(start, stop):
        if first_slot[i] == first_slot[i + 1]:
            d_opacities[i] = motion[i] = 0.0
            d_means[i], d_sh[i] = 0.0, 0.0
            if len(covariances):
                d_covariances[i] = 0.0
            else:
                d_quats[i], d_scales[i] = 0.0, 0.0
            d_features[i] = 0.0
            continue
        for k in range(0, stride, WIDTH):
            summed = load(slots, first_slot[i] * stride + k)
            for slot in range(first_slot[i] + 1, first_slot[i + 1]):
                summed = summed + load(slots, slot * stride + k)
            store(total, k, summed)

        offset = _offset(means, i, eye)
        x, y, z = _dot(right, offset), _dot(down, offset), _dot(ahead, offset)
        shape = _world_covariance(quats, scales, covariances, i)
        first, second, across, below = _to_image((x, y, z), eye)
        along, aslant = _times(shape, first), _times(shape, second)
        a, b, c = _dot(first, along), _dot(second, along), _dot(second, aslant)
        # Not from the records: a long needle's gradients cancel to more digits than float32 has.
        l11, l21, l22 = _factor(a + eye.dilation, b, c + eye.dilation)

        # s = u^2 + v^2 with (u, v) = L^T (pixel - centre), so dcov = -2 L W L^T with W the second moments.
        m, mu, mv = float(total[0]), float(total[1]), float(total[2])
        muu, muv, mvv = float(total[3]), float(total[4]), float(total[5])
        d_column, d_row = -2 * l11 * mu, -2 * (l21 * mu + l22 * mv)
        side, corner = l21 * muu + l22 * muv, l21 * muv + l22 * mvv
        da, db, dc = -2 * l11 * l11 * muu, -2 * l11 * side, -2 * (l21 * side + l22 * corner)

        opacity, kept = min(float(opacities[i]), 1.0), 1.0
        d_drawn = -m / float(records[i, OPACITY])
        if eye.antialiased:
            kept, ea, eb, ec = _antialias_backward(a, b, c, d_drawn * opacity, eye)
            da, db, dc = da + ea, db + eb, dc + ec
        d_opacities[i] = d_drawn * kept if opacities[i] <= 1.0 else 0.0
        motion[i] = math.sqrt(d_column * d_column + d_row * d_row)

        d_shape = (
            da * first[0] * first[0] + 2 * db * first[0] * second[0] + dc * second[0] * second[0],
            da * first[0] * first[1]
            + db * (first[0] * second[1] + first[1] * second[0])
            + dc * second[0] * second[1],
            da * first[0] * first[2]
            + db * (first[0] * second[2] + first[2] * second[0])
            + dc * second[0] * second[2],
            da * first[1] * first[1] + 2 * db * first[1] * second[1] + dc * second[1] * second[1],
            da * first[1] * first[2]
            + db * (first[1] * second[2] + first[2] * second[1])
            + dc * second[1] * second[2],
            da * first[2] * first[2] + 2 * db * first[2] * second[2] + dc * second[2] * second[2],
        )
        _shape_backward(quats, scales, covariances, i, d_shape, d_quats, d_scales, d_covariances)

        # The rows that map to the image depend on the point too.
        d_first = _combine(2 * da, along, 2 * db, aslant)
        d_second = _combine(2 * db, along, 2 * dc, aslant)
        near = 1.0 / z
        p, q = eye.fx * near, eye.fy * near
        d_across, d_below = -p * _dot(d_first, ahead), -q * _dot(d_second, ahead)
        dx, dy = p * d_column, q * d_row
        dz = -p * (_dot(d_first, right) + d_column * x) - q * (_dot(d_second, down) + d_row * y)
        dz = (dz - d_across * across - d_below * below) * near + total[MOMENTS + DEPTH_CHANNEL]
        if eye.across_low <= x * near <= eye.across_high:
            dx += d_across * near
            dz -= d_across * x * near * near
        if eye.down_low <= y * near <= eye.down_high:
            dy += d_below * near
            dz -= d_below * y * near * near

        ex, ey, ez = _colour_backward(sh, i, offset, total, harmonic, weight, d_sh)
        d_means[i, 0] = right[0] * dx + down[0] * dy + ahead[0] * dz + ex
        d_means[i, 1] = right[1] * dx + down[1] * dy + ahead[1] * dz + ey
        d_means[i, 2] = right[2] * dx + down[2] * dy + ahead[2] * dz + ez
        for k in range(features.shape[1]):
            d_features[i, k] = total[MOMENTS + DEPTH_CHANNEL + 1 + k]
