"""Simple solids that a standing thing may be: the box, cylinder, capsule or ball whose surface its points lie on."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import chain

import cv2
import numpy as np
from jaxtyping import Float64

from rpaug.core import geometry

CLOSE = 0.001  # metres from the surface: what lies on it
MOST_OFF = 0.05  # share of points near the surface that may be farther from it: outlines, noise
DIRECTIONS = 400
LOWEST = 0.0
MOST_POINTS = 2000
STEPS = 20  # Gauss-Newton's, at most
DONE = 1e-6  # metres and radians: a step that changes nothing
SMALL = 1e-5  # metres and radians: what derivatives are taken over


@dataclass(frozen=True)
class Solid:
    """A `box`, `cylinder`, `capsule` or `sphere` at a pose in the world; `size` in metres is as MuJoCo has it."""

    kind: str
    pose: Float64[np.ndarray, "4 4"]
    size: tuple[float, ...]

    def distance(self, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n"]:
        """Metres from its surface, negative inside."""
        own = (points - self.pose[:3, 3]) @ self.pose[:3, :3]
        return DISTANCE[self.kind](np.array(self.size), own)

    def reach(self, directions: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n"]:
        """How far it reaches along unit directions."""
        own = directions @ self.pose[:3, :3]
        return directions @ self.pose[:3, 3] + REACH[self.kind](np.array(self.size), own)

    def lifted(self, by: Float64[np.ndarray, "3"]) -> "Solid":
        """The same, `by` metres away."""
        return replace(self, pose=geometry.rigid(np.zeros(3), by) @ self.pose)

    def written(self, how: str = "") -> str:
        """Itself as a geom of MuJoCo's XML, with attributes of `how`."""
        quaternion = geometry.quaternion_of(self.pose[None])[0][[3, 0, 1, 2]]
        rows = {"size": self.size, "pos": self.pose[:3, 3], "quat": quaternion}
        stated = " ".join(f'{k}="{" ".join(f"{v:.7g}" for v in row)}"' for k, row in rows.items())
        return f'<geom type="{self.kind}" {stated} {how}/>'


def _outside(over: Float64[np.ndarray, "n k"]) -> Float64[np.ndarray, "n"]:
    """Distance from a corner whose faces a point is `over` so far (negative: under them)."""
    return np.linalg.norm(np.maximum(over, 0), axis=1) + np.minimum(over.max(1), 0)


def _across(own: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n"]:
    return np.hypot(own[:, 0], own[:, 1])


def _from_capsule(size: Float64[np.ndarray, "2"], own: Float64[np.ndarray, "n 3"]) -> np.ndarray:
    return np.hypot(_across(own), np.maximum(np.abs(own[:, 2]) - size[1], 0)) - size[0]


Measure = Callable[[Float64[np.ndarray, "k"], Float64[np.ndarray, "n 3"]], np.ndarray]
DISTANCE: Mapping[str, Measure] = {
    "box": lambda size, own: _outside(np.abs(own) - size),
    "cylinder": lambda size, own: _outside(
        np.column_stack([_across(own), np.abs(own[:, 2])]) - size
    ),
    "capsule": _from_capsule,
    "sphere": lambda size, own: np.linalg.norm(own, axis=1) - size[0],
}
REACH: Mapping[str, Measure] = {
    "box": lambda size, own: np.abs(own) @ size,
    "cylinder": lambda size, own: size[0] * _across(own) + size[1] * np.abs(own[:, 2]),
    "capsule": lambda size, own: size[0] + size[1] * np.abs(own[:, 2]),
    "sphere": lambda size, own: np.full(len(own), size[0]),
}
LYING = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # takes z to x


def around() -> Float64[np.ndarray, "n 3"]:
    """Unit directions, evenly over the sphere (a Fibonacci lattice)."""
    k = np.arange(DIRECTIONS) + 0.5
    z, turn = 1 - 2 * k / DIRECTIONS, np.pi * (1 + 5**0.5) * k
    r = np.sqrt(1 - z * z)
    return np.column_stack([r * np.cos(turn), r * np.sin(turn), z])


def solid(points: Float64[np.ndarray, "n 3"], footprint: float, bottom: float) -> Solid | None:
    """The simple solid, standing or lying at height `bottom`, on whose surface points lie that are `footprint` metres
    apart; None if they lie on none.

    Points deeper than a footprint under the surface are a hollow's, and do not count: a cup is a cylinder, as its
    convex hull is. A solid may reach no more than a footprint farther than the points do.
    """
    some = points[:: max(1, len(points) // MOST_POINTS)]
    ways = around()
    ways = ways[ways[:, 2] > LOWEST]
    farthest = (points @ ways.T).max(0) + footprint
    best, least = None, MOST_OFF
    for kind, lying, start in _starts(points, bottom):
        found = _fitted(kind, lying, start, some, footprint, bottom)
        if found is None or (found.reach(ways) > farthest).any():
            continue
        away = found.distance(some)
        off = float((np.abs(away[away > -footprint]) > CLOSE).mean())
        if off < least:
            best, least = found, off
    return best


def _starts(
    points: Float64[np.ndarray, "n 3"], bottom: float
) -> list[tuple[str, bool, Float64[np.ndarray, "k"]]]:
    """Kinds, standing or lying, with x, y, turn, and sizes to begin from."""
    (x, y), sides, turn = cv2.minAreaRect(points[:, :2].astype(np.float32))
    half = float(points[:, 2].max() - bottom) / 2
    long, wide = sides[0] / 2, sides[1] / 2
    round_, turn = (long + wide) / 2, float(np.deg2rad(turn))
    standing = [
        ("box", False, [x, y, turn, long, wide, half]),
        ("cylinder", False, [x, y, turn, round_, half]),
        ("sphere", False, [x, y, turn, (round_ + half) / 2]),
        ("capsule", False, [x, y, turn, round_, max(half - round_, SMALL)]),
    ]
    lying = [
        (kind, True, [x, y, angle, (half + across) / 2, max(along - less * across, SMALL)])
        for angle, along, across in ((turn, long, wide), (turn + np.pi / 2, wide, long))
        for kind, less in (("cylinder", 0), ("capsule", 1))
    ]
    return [(kind, lies, np.array(values)) for kind, lies, values in chain(standing, lying)]


def _fitted(
    kind: str,
    lying: bool,
    values: Float64[np.ndarray, "k"],
    points: Float64[np.ndarray, "n 3"],
    footprint: float,
    bottom: float,
) -> Solid | None:
    """The solid of a kind with points nearest to its surface, by Gauss and Newton; None if there is none."""
    for _ in range(STEPS):
        away = _placed(kind, lying, values, bottom).distance(points)
        near = points[np.abs(away) < footprint]
        if len(near) < len(values):
            return None
        off, slopes = away[np.abs(away) < footprint], []
        for step in SMALL * np.eye(len(values)):
            more, less = (_placed(kind, lying, values + way, bottom) for way in (step, -step))
            slopes.append((more.distance(near) - less.distance(near)) / (2 * SMALL))
        change = np.linalg.lstsq(np.stack(slopes, 1), -off, rcond=1e-6)[0]
        values = values + change
        if (values[3:] <= 0).any():
            return None
        if np.abs(change).max() < DONE:
            break
    return _placed(kind, lying, values, bottom)


def _placed(kind: str, lying: bool, values: Float64[np.ndarray, "k"], bottom: float) -> Solid:
    """A solid at x and y with its foot at `bottom`, turned about the vertical."""
    x, y, turn = values[:3].tolist()
    pose = geometry.rigid(np.array([0.0, 0.0, turn]), np.array([x, y, 0.0]))
    if lying:
        pose[:3, :3] = pose[:3, :3] @ LYING
    made = Solid(kind, pose, tuple(values[3:].tolist()))
    pose[2, 3] = bottom + made.reach(np.array([[0.0, 0.0, -1.0]]))[0]
    return made
