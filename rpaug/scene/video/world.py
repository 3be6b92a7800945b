"""Which way is up in a model's world, and how long its unit is."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from rpaug.core import geometry
from rpaug.scene.video.model import Reconstruction

TILTED = 45.0  # degrees that the scene's level surfaces may differ from level by the cameras' own upright
SAMPLES = 3000
THICK = 0.006  # of the median distance: points so near to a plane lie in it
LEAST = 0.05  # of all sightings of points lie in a plane that is one
TYPICAL = 1.2  # metres: taken for the median depth where nothing tells the unit


def upright(model: Reconstruction) -> tuple[Float64[np.ndarray, "4 4"], float | None]:
    """The motion into a world whose z is up, and the support's height there, None where no level plane is found.

    The support is the plane that most sightings of points lie in, among those that are level by the cameras' own
    upright (random samples, Fischler and Bolles 1981, always the same ones). Its normal is up.
    """
    ups = -model.cam_to_world[:, :3, 1]
    start = ups.mean(0) / np.linalg.norm(ups.mean(0))
    points, weight = model.points, model.seen.sum(0)
    size = float(np.median(np.linalg.norm(points - model.cam_to_world[:, :3, 3].mean(0), axis=1)))
    rng, best, kept = np.random.default_rng(0), 0.0, np.zeros(len(points), bool)
    for _ in range(SAMPLES):
        a, b, c = points[rng.integers(len(points), size=3)]
        normal = np.cross(b - a, c - a)
        normal /= max(float(np.linalg.norm(normal)), 1e-12)
        if abs(normal @ start) < np.cos(np.radians(TILTED)):
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
