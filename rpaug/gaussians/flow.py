"""How a bending surface moves from one recorded frame to another: each point to its likes, neighbours together."""

import numpy as np
from jaxtyping import Float64

ROUNDS = 8
COLOR = 4.0  # spacings that a whole step of color (0 to 1) is as far as
STIFF = (6.0, 1.5)  # spacings within which neighbours move together, at first and at last
MOST = 450  # points a flow is worked out on


def flow(
    points: Float64[np.ndarray, "n 3"],
    colors: Float64[np.ndarray, "n 3"],
    other: Float64[np.ndarray, "m 3"],
    other_colors: Float64[np.ndarray, "m 3"],
    guess: Float64[np.ndarray, "n 3"],
    spacing: float,
) -> Float64[np.ndarray, "n 3"]:
    """Displacements in metres that lay `points` on `other` ones, near `guess`; colors are in 0..1.

    Each round takes every point's nearest neighbour in space and color and averages the displacements over ever
    smaller neighbourhoods (non-rigid iterative closest points, Amberg et al. 2007, with averaging for stiffness).
    `spacing` is the distance between neighbouring points in metres.
    """
    few = _few(len(points))
    near, tint, moved = points[few], colors[few], guess[few]
    spacing = spacing * max(1.0, (len(points) / len(near)) ** 0.5)
    weight = COLOR * spacing
    targets = np.concatenate([other, weight * other_colors], 1)
    apart = _squared(near, near)
    for k in range(ROUNDS):
        reach = spacing * STIFF[0] * (STIFF[1] / STIFF[0]) ** (k / (ROUNDS - 1))
        here = np.concatenate([near + moved, weight * tint], 1)
        nearest = targets[_squared(here, targets).argmin(1), :3]
        moved = _averaged(nearest - near, apart, reach)
    return _averaged(moved, _squared(points, near), STIFF[1] * spacing)


def _few(count: int) -> slice:
    return slice(None, None, max(1, -(-count // MOST)))


def _averaged(
    values: Float64[np.ndarray, "k 3"], apart: Float64[np.ndarray, "n k"], reach: float
) -> Float64[np.ndarray, "n 3"]:
    """Means over Gaussian neighbourhoods, never without the nearest one."""
    weights = np.exp(-0.5 * (apart - apart.min(1, keepdims=True)) / reach**2)
    return weights @ values / weights.sum(1, keepdims=True)


def _squared(a: Float64[np.ndarray, "n d"], b: Float64[np.ndarray, "m d"]) -> np.ndarray:
    return np.maximum((a**2).sum(1)[:, None] + (b**2).sum(1) - 2 * a @ b.T, 0.0)
