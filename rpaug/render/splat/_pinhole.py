"""The camera as the kernels take it, and the geometry that forward and backward share.

A Gaussian becomes one row of `records`: column, row, l11, l21, l22, opacity, farthest, half width. A pixel
at offset (dx, dy) from its centre has exponent s = u^2 + v^2 with u = l11 dx + l21 dy and v = l22 dy, and
alpha = opacity * exp(-s). In these whitened coordinates s is never negative and thin needles lose no digits;
the gradients by mean and covariance follow from the moments of ds over (u, v) without an inverse. `farthest`
is the exponent at which alpha falls to the floor: a splat ends where |v| = root(farthest), and half a width
to either side of its centre. The half width is -1 where nothing is drawn.

Geometry is done in float64, CHUNK Gaussians at a time: their numbers are gathered into `lanes`, one row of
CHUNK numbers for each quantity, so that LLVM turns the arithmetic into vectors.
"""

import math
from typing import NamedTuple

from rpaug.core.jit import inlined
from rpaug.render.splat.settings import Settings, View

COLUMN, ROW, L11, L21, L22, OPACITY, FARTHEST, HALF_WIDTH = range(8)
MOMENTS = 6  # ds, ds u, ds v, ds u u, ds u v, ds v v: first in each gradient slot
DEPTH_CHANNEL = 3  # values are red, green, blue, depth, features
SMALLEST_RATIO = 1e-12  # of determinants, in antialiased mode: keeps the root's slope finite

CHUNK = 16
# Where each quantity begins in `lanes`: offset to the camera, quaternion, scales, world covariance.
X, Y, Z, QW, QX, QY, QZ, SX, SY, SZ, XX, XY, XZ, YY, YZ, ZZ = (CHUNK * row for row in range(16))
FREE = 16  # rows taken so far


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
def rotation(w, x, y, z):
    """Rows of the rotation matrix of a unit quaternion."""
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


@inlined
def dot(a, b):
    """Inner product of two 3-tuples."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def combine(p, a, q, b):
    """p a + q b."""
    return (p * a[0] + q * b[0], p * a[1] + q * b[1], p * a[2] + q * b[2])


@inlined
def times(shape, a):
    """A symmetric matrix (xx, xy, xz, yy, yz, zz) times a vector."""
    xx, xy, xz, yy, yz, zz = shape
    return (
        xx * a[0] + xy * a[1] + xz * a[2],
        xy * a[0] + yy * a[1] + yz * a[2],
        xz * a[0] + yz * a[1] + zz * a[2],
    )


@inlined
def axes(eye):
    """The camera's axes in the world: right, down, ahead."""
    return (
        (eye.r00, eye.r01, eye.r02),
        (eye.r10, eye.r11, eye.r12),
        (eye.r20, eye.r21, eye.r22),
    )


@inlined
def to_image(x, y, z, eye):
    """The two rows of (Jacobian of the projection) * (rotation), with far-off points held at the margin.

    Also the slopes x / z and y / z so held.
    """
    right, down, ahead = axes(eye)
    near = 1.0 / z
    across = min(max(x * near, eye.across_low), eye.across_high)
    below = min(max(y * near, eye.down_low), eye.down_high)
    return (
        combine(eye.fx * near, right, -eye.fx * near * across, ahead),
        combine(eye.fy * near, down, -eye.fy * near * below, ahead),
        across,
        below,
    )


@inlined
def antialias(a, b, c, determinant, eye):
    """Share of its opacity that a splat keeps when dilation grows it (Mip-Splatting, eq. 10)."""
    sharp = (a - eye.dilation) * (c - eye.dilation) - b * b
    return math.sqrt(max(sharp / determinant, SMALLEST_RATIO))


@inlined
def factor(a, b, c):
    """Lower triangle L with 2 L L^T the inverse of the covariance (a, b, c)."""
    l11, inverse = math.sqrt(0.5 * c / (a * c - b * b)), 1.0 / c
    return l11, -b * inverse * l11, math.sqrt(0.5 * inverse)


@inlined
def gather(lanes, lane, i, means, quats, scales, covariances, eye):
    """Put the geometry of Gaussian i into one lane."""
    lanes[X + lane] = means[i, 0] - eye.centre_x
    lanes[Y + lane] = means[i, 1] - eye.centre_y
    lanes[Z + lane] = means[i, 2] - eye.centre_z
    if len(covariances):
        for k in range(6):
            lanes[XX + k * CHUNK + lane] = covariances[i, k]
    else:
        for k in range(4):
            lanes[QW + k * CHUNK + lane] = quats[i, k]
        for k in range(3):
            lanes[SX + k * CHUNK + lane] = scales[i, k]


@inlined
def unit(lanes, lane):
    """A lane's unit quaternion and the factor that made it so; zeros for a quaternion of zeros."""
    w, x, y, z = lanes[QW + lane], lanes[QX + lane], lanes[QY + lane], lanes[QZ + lane]
    square = w * w + x * x + y * y + z * z
    factor = 1.0 / math.sqrt(square) if square > 0.0 else 0.0
    return w * factor, x * factor, y * factor, z * factor, factor


@inlined
def covariances_of(lanes):
    """Fill the world covariances of all lanes from their quaternions and scales."""
    for lane in range(CHUNK):
        w, x, y, z, _ = unit(lanes, lane)
        a, b, c = rotation(w, x, y, z)
        s, t, u = lanes[SX + lane] ** 2, lanes[SY + lane] ** 2, lanes[SZ + lane] ** 2
        p, q = (a[0] * s, a[1] * t, a[2] * u), (b[0] * s, b[1] * t, b[2] * u)
        r = (c[0] * s, c[1] * t, c[2] * u)
        lanes[XX + lane], lanes[XY + lane], lanes[XZ + lane] = dot(p, a), dot(p, b), dot(p, c)
        lanes[YY + lane], lanes[YZ + lane], lanes[ZZ + lane] = dot(q, b), dot(q, c), dot(r, c)


@inlined
def shape_of(lanes, lane):
    """A lane's world covariance, six entries."""
    return (
        lanes[XX + lane], lanes[XY + lane], lanes[XZ + lane],
        lanes[YY + lane], lanes[YZ + lane], lanes[ZZ + lane],
    )  # fmt: skip


@inlined
def direction(offset, count):
    """Unit vector from the camera and 1 / distance; zeros where only the constant harmonic is asked for."""
    near = 1.0 / math.sqrt(dot(offset, offset)) if count > 1 else 0.0
    return offset[0] * near, offset[1] * near, offset[2] * near, near


@inlined
def half_size(records, i):
    """Half width and half height of what a Gaussian may change, in pixels."""
    return records[i, HALF_WIDTH], math.sqrt(records[i, FARTHEST]) / records[i, L22]
