"""The inner loops that carry Gaussians along with their bodies, and what a loss asks of them back.

Rows are changed in place; arrays may be float32 or float64. Sums are in float64.
"""

import math

import numpy as np

from rpaug.core.jit import kernel
from rpaug.scene.lighting.irradiance import LEAST, TERMS

SH0 = 0.28209479  # the constant spherical harmonic


@kernel
def _terms(quats, i, out):
    """Fill `out` with the terms of `irradiance.basis` for the third axis of row i."""
    w, x, y, z = quats[i, 0], quats[i, 1], quats[i, 2], quats[i, 3]
    length = max(math.sqrt(w * w + x * x + y * y + z * z), 1e-12)
    w, x, y, z = w / length, x / length, y / length, z / length
    a, b, c = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)
    out[0], out[1], out[2], out[3] = 1.0, a, b, c
    out[4], out[5], out[6] = a * b, b * c, c * a
    out[7], out[8] = a * a - b * b, 3 * c * c - 1


@kernel
def _lit(terms, light):
    total = 0.0
    for k in range(TERMS):
        total += terms[k] * light[k]
    return max(total, LEAST)


@kernel
def _turn(turn, quats, i):
    """Row i becomes the quaternion product turn * row."""
    a, b, c, d = turn
    w, x, y, z = quats[i, 0], quats[i, 1], quats[i, 2], quats[i, 3]
    quats[i, 0] = a * w - b * x - c * y - d * z
    quats[i, 1] = b * w + a * x - d * y + c * z
    quats[i, 2] = c * w + d * x + a * y - b * z
    quats[i, 3] = d * w - c * x + b * y + a * z


@kernel
def _rotate(motion, array, i):
    x, y, z = array[i, 0], array[i, 1], array[i, 2]
    for k in range(3):
        array[i, k] = motion[k, 0] * x + motion[k, 1] * y + motion[k, 2] * z


@kernel
def carry(rows, motion, turn, light, means, quats, sh):
    """Means and quaternions by the body's motion, constant colors by the light on where they then face."""
    terms = np.empty(TERMS)
    for i in rows:
        _rotate(motion, means, i)
        for k in range(3):
            means[i, k] += motion[k, 3]
        _turn(turn, quats, i)
        _terms(quats, i, terms)
        lit = _lit(terms, light)
        for k in range(3):
            sh[i, 0, k] = ((0.5 + SH0 * sh[i, 0, k]) * lit - 0.5) / SH0


@kernel
def carry_back(rows, motion, turn, light, means, quats, sh):
    """Undo `carry`: `motion` and `turn` are the inverse ones."""
    terms = np.empty(TERMS)
    for i in rows:
        _terms(quats, i, terms)
        lit = _lit(terms, light)
        for k in range(3):
            sh[i, 0, k] = ((0.5 + SH0 * sh[i, 0, k]) / lit - 0.5) / SH0
        _turn(turn, quats, i)
        _rotate(motion, means, i)
        for k in range(3):
            means[i, k] += motion[k, 3]


@kernel
def pull(rows, back, turn_back, light, sh, placed_quats, by_means, by_quats, by_sh, by_light):
    """Gradients by carried rows become gradients by the rows as they were; `by_light` gathers the light's."""
    terms = np.empty(TERMS)
    for i in rows:
        _rotate(back, by_means, i)
        _turn(turn_back, by_quats, i)
        _terms(placed_quats, i, terms)
        by_lit = 0.0
        for k in range(3):
            by_lit += (0.5 / SH0 + sh[i, 0, k]) * by_sh[i, 0, k]
        for k in range(TERMS):
            by_light[k] += by_lit * terms[k]
        lit = _lit(terms, light)
        for k in range(3):
            by_sh[i, 0, k] *= lit


@kernel
def twist(rows, middle, means, quats, by_means, by_quats, out):
    """Fill `out` with the derivative by a turn and a shift of the rows about `middle`, world axes."""
    out[:] = 0.0
    for i in rows:
        x, y, z = means[i, 0] - middle[0], means[i, 1] - middle[1], means[i, 2] - middle[2]
        u, v, w = by_means[i, 0], by_means[i, 1], by_means[i, 2]
        a, b, c, d = quats[i, 0], quats[i, 1], quats[i, 2], quats[i, 3]
        e, f, g, h = by_quats[i, 0], by_quats[i, 1], by_quats[i, 2], by_quats[i, 3]
        out[0] += y * w - z * v + 0.5 * (a * f - b * e + c * h - d * g)
        out[1] += z * u - x * w + 0.5 * (a * g - c * e + d * f - b * h)
        out[2] += x * v - y * u + 0.5 * (a * h - d * e + b * g - c * f)
        out[3] += u
        out[4] += v
        out[5] += w
