"""What holds a thing: a rail or a hinge that its recorded motion shows, or what stands around it on opposite sides."""

import numpy as np
from jaxtyping import Float, Float64

from rpaug.core import geometry
from rpaug.core.types import Scene
from rpaug.physics.bound import nearest
from rpaug.physics.rigid import Hinge, Rail
from rpaug.scene.tracking.slide import STIRS, about_hinge, along_rail

STEEPEST = 0.7  # of an axis' length upwards: what goes up more is lifted, not drawn
NEAR_AXIS = 0.03  # metres from a thing to the hinge it turns on: what was carried round in a hand is farther
RESTS = 4  # first frames: what does not turn in them, its hinge holds
BESIDE = 0.015  # metres to what stands beside a thing and may hold it
FACING = 0.7  # cosine: that is on this side of the thing
FEW = 8  # points on a side
SIDES = 8  # horizontal directions looked in
MOST = 3000  # points of each that are compared


def held(
    scene: Scene,
    instance_ids: frozenset[int],
    points: Float64[np.ndarray, "n 3"],
    standing: Float64[np.ndarray, "m 3"],
    level: float | None,
    lifted: float,
) -> Rail | Hinge | None:
    """The rail or hinge that a thing with these surface points is on, a rail of no length if it is fixed, None if it is
    free.

    What stands on the support, at height `level`, is free: what is pushed over a table goes straight too. Above it, a
    recorded slide that does not rise is a drawer's, over the way recorded; a turn about an axis that stays is a door's
    or a lid's; and what never moved, with something still within `BESIDE` metres on two opposite sides, is fixed.
    """
    foot = float(np.quantile(points[:, 2], 0.01))
    if level is not None and foot - level < lifted:
        return None
    recorded = [body.to_world for body in scene.tracked if body.instance_ids & instance_ids]
    tracks = [track @ geometry.inverse(track[0]) for track in recorded]
    if all((track == track[:1]).all() for track in recorded):
        return Rail((0.0, 0.0, 1.0), 0.0, 0.0) if enclosed(points, standing) else None
    if not all(np.allclose(track, tracks[0]) for track in tracks):
        return None
    return _rail(tracks[0], points) or _hinge(tracks[0], points)


def _rail(track: Float64[np.ndarray, "t 4 4"], points: Float64[np.ndarray, "n 3"]) -> Rail | None:
    found = along_rail(track, points.mean(0))
    if found is None or abs(found[0][2]) > STEEPEST:
        return None
    (x, y, z), along = found[0].tolist(), found[1]
    return Rail((x, y, z), float(along.min()), float(along.max()))


def _hinge(track: Float64[np.ndarray, "t 4 4"], points: Float64[np.ndarray, "n 3"]) -> Hinge | None:
    found = about_hinge(track, points)
    if found is None or _apart(points, found[0], found[1]) > NEAR_AXIS:
        return None
    (a, b, c), (x, y, z), angles = found[0].tolist(), found[1].tolist(), found[2]
    stiff = bool((np.abs(angles[:RESTS]) < STIRS).all())
    return Hinge((a, b, c), (x, y, z), float(angles.min()), float(angles.max()), stiff)


def _apart(
    points: Float64[np.ndarray, "n 3"],
    at: Float64[np.ndarray, "3"],
    axis: Float64[np.ndarray, "3"],
) -> float:
    """Metres from an axis to the nearest of some points."""
    away = points - at
    return float(np.linalg.norm(away - np.outer(away @ axis, axis), axis=1).min())


def enclosed(points: Float64[np.ndarray, "n 3"], standing: Float64[np.ndarray, "m 3"]) -> bool:
    """Whether something stands close to a thing on two opposite sides of it."""
    low, high = points.min(0) - BESIDE, points.max(0) + BESIDE
    near = _some(standing[((standing >= low) & (standing <= high)).all(1)])
    if not len(near):
        return False
    mine = _some(points)
    which, away = nearest(near, mine, 1)
    way = near - mine[which[:, 0]]
    close = (away[:, 0] < BESIDE) & (away[:, 0] > 0)
    way = way[close] / away[close]
    turn = np.arange(SIDES) * 2 * np.pi / SIDES
    sides = np.stack([np.cos(turn), np.sin(turn), 0 * turn])
    count = (way @ sides > FACING).sum(0)
    return bool((np.minimum(count, np.roll(count, SIDES // 2)) >= FEW).any())


def _some(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 3"]:
    """At most MOST of the points, evenly."""
    return points[:: max(1, -(-len(points) // MOST))]
