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
from rpaug.core.types import Scene
from rpaug.scene.sampled_frames import SampledFrames
from rpaug.scene.targets.observed import surface

POINTS = 400  # of each thing, looked at
SLACK = 0.01  # metres: noise of depth, and outlines cut off by what stands before them
RESTS = 0.03  # metres of gap that still count as lying on something
TIE = 0.005  # metres: distances that differ by less are equal
EVEN = 1.5  # the widest step of a row over its narrowest, from which a part is missing between
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
    """Surface points in the world at the first frame, where edits of the scene put them."""
    found = [np.zeros((0, 3)), *(stands(scene, sampled, h)[0] for h in sorted(instance_ids))]
    return np.concatenate(found)


def stands(
    scene: Scene, sampled: SampledFrames, instance_id: int, frames: Sequence[int] = (0,)
) -> list[Float64[np.ndarray, "n 3"]]:
    """Surface points of an instance in the world at these frames, as recorded or where an edit put and scaled it."""
    now = next((body for body in scene.bodies if instance_id in body.instance_ids), None)
    was = next((body for body in scene.tracked if instance_id in body.instance_ids), now)
    if now is None or was is None:
        return [np.zeros((0, 3)) for _ in frames]
    points = now.scale / was.scale * surface(sampled, instance_id, was, POINTS)[0]
    return [geometry.transform(now.to_world[t], points) for t in frames]


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
        case "part of":
            return a.instance_ids <= b.instance_ids
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


# Axis of the robot's frame, and which way along it a place word begins to count.
AXES = {
    "highest": (2, -1), "lowest": (2, 1), "upper": (2, -1), "lower": (2, 1), "leftmost": (1, -1), "rightmost": (1, 1),
    "frontmost": (0, 1), "rearmost": (0, -1),
}  # fmt: skip


def ranked(rank: str, candidates: Sequence[LocatedInstance]) -> list[LocatedInstance]:
    """The candidates from most to least by a rank of `relations.RANKS`, but for those that `placed` alone can tell."""
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


def placed(
    ranks: Sequence[str], ordinal: int, row: Sequence[LocatedInstance]
) -> list[LocatedInstance]:
    """The things that place words tell: "top left" those of the top level that are the leftmost there.

    Things that overlap by more than half are on one level. Raises ValueError that says why they settle nothing.
    """
    left = list(row)
    for rank in ranks:
        if rank == "middle":
            left = _middle(left)
        elif rank not in AXES:
            raise ValueError(f"they are alike in size, so none is the {rank}")
        else:
            axis, sign = AXES[rank]
            steps = levels(left, axis)[::sign]
            if len(steps) < 2 <= len(left):
                raise ValueError(f"they are level in that direction, so none is the {rank}")
            if rank in ("upper", "lower") and len(steps) > 2:
                raise ValueError(f"of {len(steps)} one above the other, several are {rank}")
            left = steps[ordinal] if ordinal < len(steps) else []
    return left


def _middle(row: Sequence[LocatedInstance]) -> list[LocatedInstance]:
    found = [
        steps[len(steps) // 2]
        for axis in range(3)
        if len(steps := levels(row, axis)) > 2 and len(steps) % 2
    ]
    if len(found) != 1:
        raise ValueError(f"of {len(row)} none is the one in the middle")
    return found[0]


def levels(row: Sequence[LocatedInstance], axis: int) -> list[list[LocatedInstance]]:
    """The things by where they are along an axis of the robot's frame, ascending."""
    out: list[list[LocatedInstance]] = []
    for one in sorted(row, key=lambda one: one.middle[axis]):
        before = out[-1][-1] if out else None
        if before is not None and before.high[axis] - one.low[axis] > 0.5 * min(
            before.size[axis], one.size[axis]
        ):
            out[-1].append(one)
        else:
            out.append([one])
    return out


def even(row: Sequence[LocatedInstance]) -> bool:
    """Is no part of a row missing between others: are its steps along every axis about equal?"""
    for axis in range(3):
        steps = np.diff(
            [np.mean([one.middle[axis] for one in level]) for level in levels(row, axis)]
        )
        if len(steps) and steps.max() > EVEN * steps.min():
            return False
    return True
