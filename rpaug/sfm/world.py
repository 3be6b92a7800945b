"""Which way is up in a model's world, and how long its unit is."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from rpaug import geometry
from rpaug.sfm.model import Model
from rpaug.sfm.things import Plane

TILTED = 45.0  # degrees that the scene's level surfaces may differ from level by the cameras' own upright
KERNEL = 10.0  # degrees within which normals belong to one direction
TYPICAL = 1.2  # metres: taken for the median depth where nothing tells the unit


def upright(model: Model, planes: Sequence[Plane]) -> Float64[np.ndarray, "4 4"]:
    """The motion into a world whose z is up: what most flat things are level by, nearest to the cameras' own upright."""
    ups = -model.cam_to_world[:, :3, 1]
    start = ups.mean(0) / np.linalg.norm(ups.mean(0))
    turned = [(np.sign(p.normal @ start) * p.normal, p.inside) for p in planes]
    near = [(n, w) for n, w in turned if n @ start > np.cos(np.radians(TILTED))]
    up, most = start, 0.0
    for candidate, _ in near:
        alike = [(n, w) for n, w in near if n @ candidate > np.cos(np.radians(KERNEL))]
        weight = sum(w for _, w in alike)
        if weight > most:
            total = np.sum([w * n for n, w in alike], 0)
            up, most = total / np.linalg.norm(total), weight
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
