"""Spherical harmonics of turned Gaussians: a colour that depended on direction turns along (PhysGaussian, section 3.3)."""

import numpy as np
from jaxtyping import Float, Float64

C1 = 0.4886025119029199
C2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396)
C3 = (
    -0.5900435899266435,
    2.890611442640554,
    -0.4570457994644658,
    0.3731763325901154,
    -0.4570457994644658,
    1.445305721320277,
    -0.5900435899266435,
)
SAMPLES = 48  # directions that coefficients are told from


def turned(
    sh: Float[np.ndarray, "n k 3"], rotations: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, "n k 3"]:
    """Coefficients whose colour in direction R d is what it was in direction d."""
    terms = sh.shape[1]
    if terms == 1:
        return sh
    directions = _sphere(SAMPLES)
    back = np.linalg.pinv(basis(directions, terms))
    before = np.einsum("nji,sj->nsi", rotations, directions)
    colours = basis(before, terms) @ sh
    return (back @ colours).astype(sh.dtype)


def basis(d: Float[np.ndarray, "*m 3"], terms: int) -> Float64[np.ndarray, "*m k"]:
    """The first 4, 9 or 16 real harmonics in 3DGS order, in unit directions."""
    x, y, z = np.moveaxis(np.asarray(d, float), -1, 0)
    one = [np.full_like(x, 0.28209479177387814), -C1 * y, C1 * z, -C1 * x]
    two = [
        C2[0] * x * y,
        C2[1] * y * z,
        C2[2] * (2 * z * z - x * x - y * y),
        C2[3] * x * z,
        C2[4] * (x * x - y * y),
    ]
    three = [
        C3[0] * y * (3 * x * x - y * y),
        C3[1] * x * y * z,
        C3[2] * y * (4 * z * z - x * x - y * y),
        C3[3] * z * (2 * z * z - 3 * x * x - 3 * y * y),
        C3[4] * x * (4 * z * z - x * x - y * y),
        C3[5] * z * (x * x - y * y),
        C3[6] * x * (x * x - 3 * y * y),
    ]
    return np.stack([*one, *two, *three][:terms], -1)


def _sphere(count: int) -> Float64[np.ndarray, "s 3"]:
    """Directions spread evenly, along a spiral."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], -1)
