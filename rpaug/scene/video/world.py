"""Which way is up in a model's world, and how long its unit is."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from rpaug.core import geometry
from rpaug.scene.video.model import Reconstruction

ROLL, PITCH = (
    10.0,
    45.0,
)  # degrees that cameras are turned about their axes, and up or down: standard deviations
TILTED = 45.0  # degrees that the scene's level surfaces may differ from level by the cameras' own upright
ABOVE = 0.9  # of the cameras are above a support
SAMPLES = 3000
THICK = 0.006  # of the median distance: points so near to a plane lie in it
LEAST = 0.05  # of all sightings of points lie in a plane that is one
TYPICAL = 1.2  # metres: taken for the median depth where nothing tells the unit
RELATIVE = f"relative: the median depth is taken to be {TYPICAL} m, nothing tells the true one"


def upward(cam_to_world: Float64[np.ndarray, "m 4 4"]) -> Float64[np.ndarray, "3"]:
    """Up by the cameras alone: the direction that leaves them least rolled, and pitched (Brown and Lowe 2007).

    Where a camera looks straight down, its image's own upright is level: the images of a video that turns about tell.
    """
    right, down, ahead = (cam_to_world[:, :3, k] for k in range(3))
    rolled, pitched = np.sin(np.radians([ROLL, PITCH])) ** 2
    up = np.linalg.eigh(right.T @ right / rolled + ahead.T @ ahead / pitched)[1][:, 0]
    return np.asarray(up * np.sign(-(down + ahead).sum(0) @ up))


def upright(
    model: Reconstruction, start: Float64[np.ndarray, "3"]
) -> tuple[Float64[np.ndarray, "4 4"], float | None]:
    """The motion into a world whose z is up, and the support's height there, None where no level plane is found.

    The support is the plane that most sightings of points lie in, among those that are level by `start`, which is about
    up, and seen from above (random samples, Fischler and Bolles 1981, always the same ones). Its normal is up.
    """
    points, weight, eyes = model.points, model.seen.sum(0), model.cam_to_world[:, :3, 3]
    size = float(np.median(np.linalg.norm(points - eyes.mean(0), axis=1)))
    rng, best, kept = np.random.default_rng(0), 0.0, np.zeros(len(points), bool)
    for _ in range(SAMPLES):
        a, b, c = points[rng.integers(len(points), size=3)]
        normal = np.cross(b - a, c - a)
        normal /= max(float(np.linalg.norm(normal)), 1e-12)
        if abs(normal @ start) < np.cos(np.radians(TILTED)):
            continue
        if (((eyes - a) @ normal) * (normal @ start) > 0).mean() < ABOVE:
            continue
        inside = np.abs((points - a) @ normal) < THICK * size
        if (total := float(weight[inside].sum())) > best:
            best, kept = total, inside
    if best < LEAST * weight.sum():
        return _turned(start), None
    middle = points[kept].mean(0)
    normal = np.linalg.svd(points[kept] - middle)[2][2]
    motion = _turned(normal * np.sign(normal @ start))
    return motion, float((motion[:3, :3] @ middle)[2])


def _turned(up: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "4 4"]:
    """The rotation that makes a direction z."""
    axis = np.cross(up, [0.0, 0.0, 1.0])
    sine, cosine = float(np.linalg.norm(axis)), float(up[2])
    if sine < 1e-9:
        turn = np.zeros(3) if cosine > 0 else np.array([np.pi, 0.0, 0.0])
    else:
        turn = axis / sine * np.arctan2(sine, cosine)
    return geometry.rigid(turn, np.zeros(3))


def unit(depths: Sequence[np.ndarray], typical: float = TYPICAL) -> float:
    """What lengths are multiplied by so that the median depth is `typical` metres."""
    return typical / float(np.median([np.median(depth) for depth in depths]))


def aligned(
    points: Float64[np.ndarray, "n 3"], onto: Float64[np.ndarray, "n 3"]
) -> tuple[Float64[np.ndarray, "4 4"], float]:
    """The motion and scale that bring points onto others with least squares (Umeyama 1991): scale first."""
    a, b = points - points.mean(0), onto - onto.mean(0)
    u, s, v = np.linalg.svd(b.T @ a)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
    scale = float((s * np.diag(flip)).sum() / max((a**2).sum(), 1e-12))
    motion = np.eye(4)
    motion[:3, :3] = u @ flip @ v
    motion[:3, 3] = onto.mean(0) - scale * motion[:3, :3] @ points.mean(0)
    return motion, scale
