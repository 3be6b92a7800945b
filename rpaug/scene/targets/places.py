"""Where things are in the robot's frame, and which of them a relation or a ranking picks.

The frame's x points ahead of the robot, y to its left, z up; its origin is the robot's foot. Everything is measured
at the first frame, on recorded surface points.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float64

from rpaug.core import geometry
from rpaug.core.types import Body, Scene
from rpaug.scene.sampled_frames import SampledFrames
from rpaug.scene.targets.roles import surface

POINTS = 400  # of each thing, looked at
SLACK = 0.01  # metres: noise of depth, and outlines cut off by what stands before them
RESTS = 0.03  # metres of gap that still count as lying on something
TIE = 0.005  # metres: distances that differ by less are equal
OUTER = 1.0  # percent of the points on each side that do not count for a thing's extent


@dataclass(frozen=True, eq=False)
class LocatedInstance:
    """One thing, of some instance ids, and surface points of it in the robot's frame, metres."""

    instance_ids: frozenset[int]
    points: Float64[np.ndarray, "n 3"]

    @cached_property
    def low(self) -> Float64[np.ndarray, "3"]:
        return np.percentile(self.points, OUTER, axis=0)

    @cached_property
    def high(self) -> Float64[np.ndarray, "3"]:
        return np.percentile(self.points, 100 - OUTER, axis=0)

    @property
    def middle(self) -> Float64[np.ndarray, "3"]:
        return (self.low + self.high) / 2

    @property
    def size(self) -> Float64[np.ndarray, "3"]:
        return self.high - self.low


def robot_frame(scene: Scene, sampled: SampledFrames) -> Float64[np.ndarray, "4 4"]:
    """World to the robot's frame: its foot is what of the robot stands still, or else its lowest part.

    Ahead is the world's horizontal axis that is nearest to the way from the foot to where the gripper works.
    Without a known robot it is the world's own frame.
    """
    parts = scene.roles.get("robot", frozenset())
    still = {h for body in scene.bodies if body.motion == "static" for h in body.instance_ids}
    foot = _points(scene, sampled, parts & still or parts)
    works = _gripper(scene)
    if not len(foot) or works is None:
        return np.eye(4)
    base = foot[foot[:, 2] <= np.percentile(foot[:, 2], 25)].mean(0)
    ahead = np.median(works, 0) - base
    turn = np.round(np.arctan2(ahead[1], ahead[0]) / (np.pi / 2)) * (np.pi / 2)
    pose = geometry.rigid(np.array([0, 0, turn]), base)
    return geometry.inverse(pose)


def _gripper(scene: Scene) -> Float64[np.ndarray, "t 3"] | None:
    poses = scene.episode.robot.gripper_to_world
    return None if poses is None or not len(poses) else poses[:, :3, 3]


def places(
    scene: Scene, sampled: SampledFrames, groups: Iterable[frozenset[int]]
) -> dict[frozenset[int], LocatedInstance]:
    """The place of each group of instance ids; groups of which no surface was recorded are left out."""
    frame = robot_frame(scene, sampled)
    out = {}
    for group in groups:
        points = _points(scene, sampled, group)
        if len(points):
            out[group] = LocatedInstance(group, geometry.transform(frame, points))
    return out


def _points(
    scene: Scene, sampled: SampledFrames, instance_ids: Iterable[int]
) -> Float64[np.ndarray, "n 3"]:
    """Surface points in the world at the first frame."""
    body_of: dict[int, Body] = {h: body for body in scene.bodies for h in body.instance_ids}
    found = [np.zeros((0, 3))]
    for instance_id in sorted(instance_ids):
        if instance_id in body_of:
            points = surface(sampled, instance_id, body_of[instance_id], POINTS)[0]
            body = body_of[instance_id]
            found.append(geometry.transform(body.to_world[0], body.scale * points))
    return np.concatenate(found)


def related(
    name: str, candidates: Sequence[LocatedInstance], anchors: Sequence[LocatedInstance]
) -> list[LocatedInstance]:
    """The candidates that stand in a relation (a name of `relations.RELATIONS`) to the anchors.

    "closest to" and "farthest from" leave one, or those that are as close as it.
    """
    if name in ("closest to", "farthest from"):
        sign = 1.0 if name == "closest to" else -1.0
        distance = [sign * gap(one, anchors[0]) for one in candidates]
        least = min(distance, default=0.0)
        return [one for one, d in zip(candidates, distance, strict=True) if d <= least + TIE]
    return [one for one in candidates if _holds(name, one, anchors)]


def _holds(name: str, a: LocatedInstance, anchors: Sequence[LocatedInstance]) -> bool:
    b = anchors[0]
    over = bool((a.low[:2] < b.high[:2] + SLACK).all() and (b.low[:2] < a.high[:2] + SLACK).all())
    match name:
        case "left of":
            return bool(a.middle[1] > b.high[1])
        case "right of":
            return bool(a.middle[1] < b.low[1])
        case "in front of":
            return bool(a.middle[0] < b.low[0])
        case "behind":
            return bool(a.middle[0] > b.high[0])
        case "above":
            return over and bool(a.low[2] > b.high[2] - SLACK)
        case "below":
            return over and bool(a.high[2] < b.low[2] + SLACK)
        case "on":
            return over and _on(a, b)
        case "in":
            inside = (a.middle[:2] > b.low[:2]) & (a.middle[:2] < b.high[:2])
            return bool(inside.all() and b.low[2] - SLACK < a.low[2] < b.high[2] - SLACK)
        case "between":
            return _between(a.middle, anchors[0].middle, anchors[1].middle)
    raise ValueError(f"no relation is called {name!r}")


def _on(a: LocatedInstance, b: LocatedInstance) -> bool:
    """Does `a` end where the part of `b` below it ends? What is broad, like a tray with a rim, counts by that part."""
    inner = ((b.points[:, :2] > a.low[:2] - SLACK) & (b.points[:, :2] < a.high[:2] + SLACK)).all(-1)
    top = float(np.percentile(b.points[inner, 2], 90)) if inner.any() else float(b.high[2])
    return abs(float(a.low[2]) - top) < RESTS and bool(a.middle[2] > top)


def _between(
    at: Float64[np.ndarray, "3"], a: Float64[np.ndarray, "3"], b: Float64[np.ndarray, "3"]
) -> bool:
    """Seen from above: past one, not yet at the other, and nearer to the way than a third of its length."""
    way, own = (b - a)[:2], (at - a)[:2]
    length = float(np.linalg.norm(way))
    along = float(own @ way) / max(length, 1e-9)
    aside = abs(float(way[0] * own[1] - way[1] * own[0])) / max(length, 1e-9)
    return 0 < along < length and aside < length / 3


def gap(a: LocatedInstance, b: LocatedInstance) -> float:
    """The least distance between their surface points, metres."""
    apart = a.points[:, None] - b.points[None]
    return float(np.sqrt((apart**2).sum(-1).min()))


def ranked(rank: str, candidates: Sequence[LocatedInstance]) -> list[LocatedInstance]:
    """The candidates from most to least by a rank of `relations.RANKS`."""
    return sorted(candidates, key=lambda one: _key(rank, one))


def _key(rank: str, a: LocatedInstance) -> float:
    match rank:
        case "largest":
            return -float(a.size.prod())
        case "smallest":
            return float(a.size.prod())
        case "tallest":
            return -float(a.size[2])
        case "shortest":
            return float(a.size[2])
        case "leftmost":
            return -float(a.middle[1])
        case "rightmost":
            return float(a.middle[1])
        case "frontmost":
            return float(a.middle[0])
        case "rearmost":
            return -float(a.middle[0])
        case "highest":
            return -float(a.high[2])
        case "lowest":
            return float(a.low[2])
    raise ValueError(f"no rank is called {rank!r}")
