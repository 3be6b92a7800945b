"""Spherical harmonics of turned Gaussians: colors that depend on direction turn along (PhysGaussian, section 3.3)."""

from functools import cache

import numpy as np
from jaxtyping import Float, Float64

# Real harmonics up to degree 3, in the order and with the signs of 3DGS.
C0, C1 = 0.28209479177387814, 0.4886025119029199
C2 = (1.0925484305920792, 0.31539156525252005, 0.5462742152960396)
C3 = (0.5900435899266435, 2.890611442640554, 0.4570457994644658, 0.3731763325901154)
C3X = 1.445305721320277
SAMPLES = 64  # directions that the turned coefficients are told from, exactly


def turned(
    sh: Float[np.ndarray, "n k 3"], rotation: Float[np.ndarray, "*n 3 3"]
) -> Float[np.ndarray, "n k 3"]:
    """Coefficients whose color in direction R d is what it was in direction d, with one R for all or one for each."""
    terms = sh.shape[1]
    if terms == 1:
        return sh
    directions = _sphere()
    before = np.einsum("...ji,sj->...si", np.asarray(rotation, float), directions)
    mixture = np.linalg.pinv(basis(directions, terms)) @ basis(before, terms)
    return (mixture @ sh).astype(sh.dtype)


def basis(directions: Float[np.ndarray, "*m 3"], terms: int) -> Float64[np.ndarray, "*m k"]:
    """The first `terms` harmonics (1, 4, 9 or 16) in unit directions."""
    x, y, z = np.moveaxis(np.asarray(directions, float), -1, 0)
    xx, yy, zz = x * x, y * y, z * z
    found = [np.full_like(x, C0), -C1 * y, C1 * z, -C1 * x]
    found += [C2[0] * x * y, -C2[0] * y * z, C2[1] * (2 * zz - xx - yy)]
    found += [-C2[0] * x * z, C2[2] * (xx - yy)]
    found += [-C3[0] * y * (3 * xx - yy), C3[1] * x * y * z, -C3[2] * y * (4 * zz - xx - yy)]
    found += [C3[3] * z * (2 * zz - 3 * xx - 3 * yy), -C3[2] * x * (4 * zz - xx - yy)]
    found += [C3X * z * (xx - yy), -C3[0] * x * (xx - 3 * yy)]
    return np.stack(found[:terms], -1)


@cache
def _sphere() -> Float64[np.ndarray, "s 3"]:
    """Directions spread evenly over the sphere (a Fibonacci lattice)."""
    number = np.arange(SAMPLES) + 0.5
    z, turn = 1 - 2 * number / SAMPLES, np.pi * (1 + 5**0.5) * number
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], -1)
