"""A Gaussian in space and time, what is left of it at one time, and how a loss there pulls on it.

After Yang et al. 2023 (arXiv 2310.10642, equations 4 to 8): a 4D covariance R S S' R' from four scales and two
isoclinic rotations; at a time it leaves a 3D Gaussian, whose middle moves evenly, and a weight in time. Time is
counted in metres, `pace` of them to a frame, so that a rotation mixes alike units.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int

from rpaug.core.types import Gaussians4

REACH = 3.0  # standard deviations in time beyond which a Gaussian is not there (weight 0.011)
UPPER = (
    [0, 0, 0, 1, 1, 2],
    [0, 1, 2, 1, 2, 2],
)  # of a symmetric 3 x 3 matrix, in the rasteriser's order

# The product of quaternions is linear in each factor. Rows and columns are (x, y, z, t), t the real part.
_LEFT = np.array(
    [
        [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        [[0, 0, 0, 1], [0, 0, -1, 0], [0, 1, 0, 0], [-1, 0, 0, 0]],
        [[0, 0, 1, 0], [0, 0, 0, 1], [-1, 0, 0, 0], [0, -1, 0, 0]],
        [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1], [0, 0, -1, 0]],
    ],
    float,
)
_RIGHT = np.array(
    [
        [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        [[0, 0, 0, 1], [0, 0, 1, 0], [0, -1, 0, 0], [-1, 0, 0, 0]],
        [[0, 0, -1, 0], [0, 0, 0, 1], [1, 0, 0, 0], [0, -1, 0, 0]],
        [[0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1], [0, 0, -1, 0]],
    ],
    float,
)


@dataclass(frozen=True)
class Slice:
    """What is left at one time: 3D middles relative to the origin, covariances, and weights in time, of `rows`."""

    rows: Int[np.ndarray, "m"]
    means: Float64[np.ndarray, "m 3"]
    covariances: Float64[np.ndarray, "m 3 3"]
    weights: Float64[np.ndarray, "m"]


@dataclass(frozen=True)
class Pull:
    """Derivatives of a loss by the parameters of the rows of a slice."""

    means: Float64[np.ndarray, "m 4"]
    left: Float64[np.ndarray, "m 4"]
    right: Float64[np.ndarray, "m 4"]
    scales: Float64[np.ndarray, "m 4"]


def rotations(
    left: Float[np.ndarray, "n 4"], right: Float[np.ndarray, "n 4"]
) -> Float64[np.ndarray, "n 4 4"]:
    """The rotation v -> left * v * right of space-time, of quaternions (w, x, y, z) of any length but zero."""
    return _matrix(_unit(left), _LEFT) @ _matrix(_unit(right), _RIGHT)


def quaternions(
    rotation: Float64[np.ndarray, "n 4 4"],
) -> tuple[Float64[np.ndarray, "n 4"], Float64[np.ndarray, "n 4"]]:
    """The two unit quaternions of each rotation of space-time (Van Elfrinkhof's theorem; Mebius 2005)."""
    basis = np.einsum("iab,jbc->ijac", _LEFT, _RIGHT)
    both = np.einsum("nac,ijac->nij", rotation, basis) / 4.0  # of rank one: left times right
    u, _, v = np.linalg.svd(both)
    left, right = u[:, :, 0], v[:, 0, :]
    sign = np.sign(np.einsum("ni,nij,nj->n", left, both, right))
    return left * sign[:, None], right


def covariances(
    left: Float[np.ndarray, "n 4"],
    right: Float[np.ndarray, "n 4"],
    scales: Float[np.ndarray, "n 4"],
) -> Float64[np.ndarray, "n 4 4"]:
    """R S S' R' of each Gaussian, square metres."""
    turned = rotations(left, right) * scales[:, None, :].astype(np.float64)
    return turned @ np.swapaxes(turned, 1, 2)


def at(gaussians: Gaussians4, t: float) -> Slice:
    """The Gaussians that are there at frame t (any real number)."""
    g = gaussians
    # The variance in time alone first: most of them are not there.
    turn = rotations(g.left, g.right)[:, 3]
    spread = ((turn * g.scales) ** 2).sum(1)
    rows = np.flatnonzero((g.means[:, 3] - t * g.pace) ** 2 <= REACH**2 * spread)
    whole = covariances(g.left[rows], g.right[rows], g.scales[rows])
    late = t * g.pace - g.means[rows, 3].astype(np.float64)
    along, across = whole[:, 3, 3], whole[:, :3, 3]
    return Slice(
        rows,
        g.means[rows, :3] + across * (late / along)[:, None],
        whole[:, :3, :3] - across[:, :, None] * across[:, None, :] / along[:, None, None],
        np.exp(-0.5 * late**2 / along),
    )


def pull_back(
    gaussians: Gaussians4,
    t: float,
    rows: Int[np.ndarray, "m"],
    by_means: Float[np.ndarray, "m 3"],
    by_covariances: Float[np.ndarray, "m 6"],
    by_weights: Float[np.ndarray, "m"],
) -> Pull:
    """Gradients by a slice's means, covariances (upper triangles, each off-diagonal number standing for two) and
    weights, as gradients by what the Gaussians are made of."""
    left, right = gaussians.left[rows].astype(float), gaussians.right[rows].astype(float)
    scales = gaussians.scales[rows].astype(float)
    turn_left, turn_right = _matrix(_unit(left), _LEFT), _matrix(_unit(right), _RIGHT)
    turn = turn_left @ turn_right
    shaped = turn * scales[:, None, :]
    whole = shaped @ np.swapaxes(shaped, 1, 2)
    late = t * gaussians.pace - gaussians.means[rows, 3].astype(float)
    along, across = whole[:, 3, 3], whole[:, :3, 3]
    slope = late / along
    weight = np.exp(-0.5 * late * slope)

    by_space = _symmetric(by_covariances)
    # The middle is m + across * slope, the covariance space - across across' / along.
    by_across = by_means * slope[:, None]
    by_across -= 2.0 * np.einsum("nij,nj->ni", by_space, across) / along[:, None]
    by_slope = (by_means * across).sum(1)
    by_late = by_slope / along - by_weights * weight * slope
    by_along = -by_slope * slope / along + 0.5 * by_weights * weight * slope**2
    by_along += np.einsum("ni,nij,nj->n", across, by_space, across) / along**2

    by_whole = np.empty_like(whole)
    by_whole[:, :3, :3] = by_space
    by_whole[:, :3, 3] = by_whole[:, 3, :3] = 0.5 * by_across
    by_whole[:, 3, 3] = by_along
    by_shaped = 2.0 * by_whole @ shaped
    by_turn = by_shaped * scales[:, None, :]
    by_left = by_turn @ np.swapaxes(turn_right, 1, 2)
    by_right = np.swapaxes(turn_left, 1, 2) @ by_turn
    return Pull(
        np.concatenate([by_means, -by_late[:, None]], 1),
        _off_length(left, np.einsum("nab,iab->ni", by_left, _LEFT)),
        _off_length(right, np.einsum("nab,iab->ni", by_right, _RIGHT)),
        (by_shaped * turn).sum(1),
    )


def moving(
    shape: Float64[np.ndarray, "n 3 3"],
    velocity: Float64[np.ndarray, "n 3"],
    lasting: Float64[np.ndarray, "n"],
) -> tuple[Float64[np.ndarray, "n 4"], Float64[np.ndarray, "n 4"], Float64[np.ndarray, "n 4"]]:
    """Left and right quaternions and scales of Gaussians that leave the covariance `shape` at every time, move by
    `velocity` (metres per metre of time) and last for a standard deviation of `lasting` metres."""
    across = velocity * (lasting**2)[:, None]
    whole = np.empty((len(shape), 4, 4))
    whole[:, :3, :3] = shape + across[:, :, None] * velocity[:, None, :]
    whole[:, :3, 3] = whole[:, 3, :3] = across
    whole[:, 3, 3] = lasting**2
    variances, turn = np.linalg.eigh(whole)
    turn[:, :, 0] *= np.sign(np.linalg.det(turn))[:, None]  # no reflections
    left, right = quaternions(turn)
    return left, right, np.sqrt(np.maximum(variances, 1e-30))


def _matrix(
    quaternion: Float64[np.ndarray, "n 4"], basis: Float64[np.ndarray, "4 4 4"]
) -> Float64[np.ndarray, "n 4 4"]:
    return np.tensordot(quaternion, basis, 1)


def _unit(quaternion: Float[np.ndarray, "n 4"]) -> Float64[np.ndarray, "n 4"]:
    q = quaternion.astype(np.float64)
    return q / np.maximum(np.linalg.norm(q, axis=1, keepdims=True), 1e-12)


def _off_length(
    quaternion: Float64[np.ndarray, "n 4"], by_unit: Float64[np.ndarray, "n 4"]
) -> Float64[np.ndarray, "n 4"]:
    """A gradient by the unit quaternion as one by the quaternion of any length."""
    length = np.maximum(np.linalg.norm(quaternion, axis=1, keepdims=True), 1e-12)
    unit = quaternion / length
    return (by_unit - unit * (unit * by_unit).sum(1, keepdims=True)) / length


def _symmetric(upper: Float[np.ndarray, "m 6"]) -> Float64[np.ndarray, "m 3 3"]:
    """A gradient by the upper triangle as one by the matrix."""
    out = np.zeros((len(upper), 3, 3))
    out[:, UPPER[0], UPPER[1]] = upper
    return 0.5 * (out + np.swapaxes(out, 1, 2))
