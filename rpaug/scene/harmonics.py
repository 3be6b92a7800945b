"""Colours that depend on where one looks from, turned with what they belong to."""

from functools import cache

import numpy as np
from jaxtyping import Float, Float32, Float64

# Real spherical harmonics up to degree 3, in the order and with the signs of 3DGS.
C0, C1 = 0.28209479177387814, 0.4886025119029199
C2 = (1.0925484305920792, 0.31539156525252005, 0.5462742152960396)
C3 = (0.5900435899266435, 2.890611442640554, 0.4570457994644658, 0.3731763325901154)
C3X = 1.445305721320277
DIRECTIONS = 64


def basis(directions: Float[np.ndarray, "n 3"], count: int) -> Float64[np.ndarray, "n k"]:
    """The first `count` harmonics (1, 4, 9 or 16) in unit directions."""
    x, y, z = np.asarray(directions, np.float64).T
    terms = [np.full_like(x, C0), -C1 * y, C1 * z, -C1 * x]
    xx, yy, zz = x * x, y * y, z * z
    terms += [C2[0] * x * y, -C2[0] * y * z, C2[1] * (2 * zz - xx - yy)]
    terms += [-C2[0] * x * z, C2[2] * (xx - yy)]
    terms += [-C3[0] * y * (3 * xx - yy), C3[1] * x * y * z, -C3[2] * y * (4 * zz - xx - yy)]
    terms += [C3[3] * z * (2 * zz - 3 * xx - 3 * yy), -C3[2] * x * (4 * zz - xx - yy)]
    terms += [C3X * z * (xx - yy), -C3[0] * x * (xx - 3 * yy)]
    return np.stack(terms[:count], -1)


def turned(
    sh: Float32[np.ndarray, "n k 3"], rotation: Float[np.ndarray, "3 3"]
) -> Float32[np.ndarray, "n k 3"]:
    """The coefficients after the thing was rotated: what showed towards v shows towards rotation @ v.

    A rotation mixes the harmonics of each degree among themselves alone (Wigner); the mixture is told by their values
    in some directions, exactly.
    """
    out = sh.copy()
    where = _directions()
    now, before = basis(where, sh.shape[1]), basis(where @ np.asarray(rotation), sh.shape[1])
    for degree in range(1, int(np.sqrt(sh.shape[1]))):
        band = slice(degree**2, (degree + 1) ** 2)
        mixture = np.linalg.lstsq(now[:, band], before[:, band], rcond=None)[0]
        out[:, band] = np.einsum("jk,nkc->njc", mixture, sh[:, band])
    return out.astype(np.float32)


@cache
def _directions() -> Float64[np.ndarray, "m 3"]:
    """Spread evenly over the sphere (a Fibonacci lattice)."""
    number = np.arange(DIRECTIONS) + 0.5
    z = 1 - 2 * number / DIRECTIONS
    turn, flat = np.pi * (1 + 5**0.5) * number, np.sqrt(1 - z * z)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], -1)
