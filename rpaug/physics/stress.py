"""Stress from deformation, compiled: four laws, and what of a deformation stays.

Elastic things and jelly are neo-Hookean (Bonet and Wood 2008, section 6.4.3), jelly also viscous (Kelvin-Voigt).
Plasticine comes back to von Mises' and sand to Drucker-Prager's surface in logarithmic strain (Klar et al. 2016,
"Drucker-Prager Elastoplasticity for Sand Animation", section 7).
"""

import math

import numpy as np

from rpaug.core.jit import inlined, kernel

LEAST_J = 0.05  # volume ratio below which a particle counts as crushed
MOST_STRETCH = 20.0  # entry of F above which it counts as torn
ELASTIC, JELLY, PLASTICINE, SAND = 0, 1, 2, 3


@inlined
def _determinant(f):
    return (
        f[0, 0] * (f[1, 1] * f[2, 2] - f[1, 2] * f[2, 1])
        - f[0, 1] * (f[1, 0] * f[2, 2] - f[1, 2] * f[2, 0])
        + f[0, 2] * (f[1, 0] * f[2, 1] - f[1, 1] * f[2, 0])
    )


@kernel
def singular(f, u, s, w):
    """F = U diag(s) W^T for det F > 0, by Jacobi rotations of F^T F (Golub and Van Loan, section 8.5)."""
    a = np.empty((3, 3))
    for r in range(3):
        for c in range(3):
            a[r, c] = f[0, r] * f[0, c] + f[1, r] * f[1, c] + f[2, r] * f[2, c]
            w[r, c] = 1.0 if r == c else 0.0
    for _ in range(8):
        off = a[0, 1] * a[0, 1] + a[0, 2] * a[0, 2] + a[1, 2] * a[1, 2]
        size = a[0, 0] * a[0, 0] + a[1, 1] * a[1, 1] + a[2, 2] * a[2, 2]
        if off <= 1e-30 * size:
            break
        for pair in range(3):
            i, j = (0, 1) if pair == 0 else ((0, 2) if pair == 1 else (1, 2))
            if a[i, j] == 0.0:
                continue
            theta = (a[j, j] - a[i, i]) / (2.0 * a[i, j])
            t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
            if theta < 0:
                t = -t
            cosine = 1.0 / math.sqrt(t * t + 1.0)
            sine = t * cosine
            for k in range(3):
                p, q = a[k, i], a[k, j]
                a[k, i], a[k, j] = cosine * p - sine * q, sine * p + cosine * q
            for k in range(3):
                p, q = a[i, k], a[j, k]
                a[i, k], a[j, k] = cosine * p - sine * q, sine * p + cosine * q
            for k in range(3):
                p, q = w[k, i], w[k, j]
                w[k, i], w[k, j] = cosine * p - sine * q, sine * p + cosine * q
    for c in range(3):
        s[c] = math.sqrt(max(a[c, c], 1e-12))
        for r in range(3):
            u[r, c] = (f[r, 0] * w[0, c] + f[r, 1] * w[1, c] + f[r, 2] * w[2, c]) / s[c]


@inlined
def _mended(f):
    """The volume ratio of a deformation, and whether it had to be forgotten: inside out, crushed or torn."""
    J = _determinant(f)
    wide = 0.0
    for r in range(3):
        for c in range(3):
            wide = max(wide, abs(f[r, c]))
    if J > LEAST_J and wide < MOST_STRETCH:
        return J, False
    side = min(max(J, LEAST_J), 2.0) ** (1.0 / 3.0) if J == J else 1.0
    for r in range(3):
        for c in range(3):
            f[r, c] = side if r == c else 0.0
    return side * side * side, True


@inlined
def _returned(e, law, mu, la, limit):
    """Bring logarithmic strains back to the yield surface; whether they had left it.

    `limit` is the yield stress in Pa (plasticine), or Drucker-Prager's alpha (sand).
    """
    mean = (e[0] + e[1] + e[2]) / 3.0
    apart = math.sqrt((e[0] - mean) ** 2 + (e[1] - mean) ** 2 + (e[2] - mean) ** 2)
    if law == PLASTICINE:
        # Yield: sqrt(3/2) |2 mu dev e| = stress.
        excess = apart - limit / (math.sqrt(6.0) * mu)
    elif mean > 0.0:
        e[0], e[1], e[2] = 0.0, 0.0, 0.0
        return True
    else:
        excess = apart + (3.0 * la + 2.0 * mu) / (2.0 * mu) * 3.0 * mean * limit
    if excess <= 0.0 or apart <= 0.0:
        return False
    for c in range(3):
        e[c] -= min(excess, apart) * (e[c] - mean) / apart
    return True


@kernel
def stress(F, C, law, shear, volumetric, limit, viscosity, volume, tau, low, high):
    """Fill `tau` with initial volume times Kirchhoff stress; strains beyond yield are taken out of F first.

    Returns the elastic energy in joules, how many particles were crushed, and the least volume ratio.
    """
    u, w, s, e = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty(3)
    energy, least, crushed = 0.0, 1.0, 0
    for p in range(low, high):
        f = F[p]
        J, forgotten = _mended(f)
        crushed += forgotten
        least = min(least, J)
        mu, la, V = shear[p], volumetric[p], volume[p]
        if law[p] == ELASTIC or law[p] == JELLY:
            log = math.log(J)
            trace = 0.0
            for r in range(3):
                for c in range(r, 3):
                    b = f[r, 0] * f[c, 0] + f[r, 1] * f[c, 1] + f[r, 2] * f[c, 2]
                    value = mu * b
                    if r == c:
                        trace += b
                        value += la * log - mu
                    if law[p] == JELLY:
                        value += J * viscosity[p] * (C[p, r, c] + C[p, c, r])
                    tau[p, r, c] = tau[p, c, r] = V * value
            energy += V * (0.5 * mu * (trace - 3.0) - mu * log + 0.5 * la * log * log)
            continue
        singular(f, u, s, w)
        for c in range(3):
            e[c] = math.log(s[c])
        if _returned(e, law[p], mu, la, limit[p]):
            for r in range(3):
                for c in range(3):
                    value = 0.0
                    for k in range(3):
                        value += u[r, k] * math.exp(e[k]) * w[c, k]
                    f[r, c] = value
        total = e[0] + e[1] + e[2]
        for r in range(3):
            for c in range(r, 3):
                value = 0.0
                for k in range(3):
                    value += (2.0 * mu * e[k] + la * total) * u[r, k] * u[c, k]
                tau[p, r, c] = tau[p, c, r] = V * value
        energy += V * (mu * (e[0] * e[0] + e[1] * e[1] + e[2] * e[2]) + 0.5 * la * total * total)
    return energy, crushed, least
