"""What carries what: level surfaces that face up, and which of them is the first below a thing."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Bool, Float64, Int

from rpaug.scene.targets.observed import BESIDE, Evidence, Thing

FACES_UP = 0.95  # vertical part of a normal that is level
THICK = 0.02  # metres: heights of one level surface differ by less
LEAST = 12  # points of a level surface
CELL = 0.03  # metres: a surface seen in one square is there all over it
ROW = 1 << 20  # squares of a row of the world
AROUND = np.array([x * ROW + y for x in (-1, 0, 1) for y in (-1, 0, 1)])
SOME = 100  # points of a thing that are dropped
RAYS = 100_000  # lines of sight that may tell of a hole, at most


@dataclass(frozen=True)
class LevelSurface:
    """A level surface that faces up: of one instance, at a height in metres, within a convex outline from above.

    `cells` are the numbers of the squares of CELL metres in which it was seen, and of their neighbours.
    """

    instance_id: int
    height: float
    outline: Float64[np.ndarray, "k 2"]
    cells: Int[np.ndarray, "c"]

    @property
    def area(self) -> float:
        """Square metres within the outline."""
        return float(cv2.contourArea(self.outline.astype(np.float32)))

    def within(self, points: Float64[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        """Which points, seen from above, lie within the outline."""
        edge = np.roll(self.outline, -1, 0) - self.outline
        to = points[:, None] - self.outline
        side = edge[:, 0] * to[..., 1] - edge[:, 1] * to[..., 0]
        return (side >= 0).all(1) | (side <= 0).all(1)


def levels(things: Collection[Thing]) -> list[LevelSurface]:
    """The level surfaces of static things, the upper ones first; of equals the smaller one, which lies on the other."""
    found = [level for thing in things if thing.static for level in _levels(thing)]
    return sorted(found, key=lambda level: (-round(level.height / THICK), level.area))


def _levels(thing: Thing) -> list[LevelSurface]:
    up = thing.points[thing.normals[:, 2] > FACES_UP]
    up = up[np.argsort(up[:, 2], kind="stable")]
    out = []
    for group in np.split(up, 1 + np.flatnonzero(np.diff(up[:, 2]) > THICK / 2)):
        if len(group) < LEAST:
            continue
        outline = cv2.convexHull(group[:, :2].astype(np.float32))[:, 0].astype(np.float64)
        if len(outline) > 2:
            height = float(np.median(group[:, 2]))
            around = np.unique(_cells(group[:, :2])[:, None] + AROUND)
            out.append(LevelSurface(thing.instance_id, height, outline, around))
    return out


def _cells(points: Float64[np.ndarray, "n 2"]) -> Int[np.ndarray, "n"]:
    x, y = np.floor(points / CELL).astype(int).T
    return x * ROW + y


class Ground:
    """The level surfaces of all static things but the arm's, and what lands on them."""

    def __init__(self, evidence: Evidence, arm: Collection[int]) -> None:
        self._evidence = evidence
        self.levels = levels([t for h, t in evidence.things.items() if h not in arm])
        self._landed: dict[tuple[int, int], Mapping[int, float]] = {}
        self._holes: dict[float, np.ndarray] = {}

    def falls(self, instance_id: int, frame: int = 0) -> Mapping[int, float]:
        """What a thing lands on if it falls straight down in a frame: share of its outline by instance id."""
        if (instance_id, frame) not in self._landed:
            thing = self._evidence.things[instance_id]
            pose = thing.body.to_world[frame]
            points = thing.points[:: max(1, len(thing.points) // SOME)] @ pose[:3, :3].T
            points = points + pose[:3, 3]
            points[:, 2] = np.percentile(points[:, 2], 2)
            self._landed[instance_id, frame] = self.landing(points, instance_id)
        return self._landed[instance_id, frame]

    def landing(self, points: Float64[np.ndarray, "n 3"], without: int = 0) -> dict[int, float]:
        """Share of the points that land on each thing; a surface a little above a point still counts as below.

        A point within a level's outline lands there unless somebody saw through the level at that place: frames have a
        hole. What stands on a table hides it, and the floor that is seen below from beside tells of no hole.
        """
        left = np.ones(len(points), bool)
        cells = _cells(points[:, :2])
        out: dict[int, float] = {}
        for level in self.levels:
            if level.instance_id == without:
                continue
            here = _among(cells, level.cells)
            under = left & (points[:, 2] > level.height - THICK)
            unsure = under & ~here
            if unsure.any():
                unsure[unsure] = level.within(points[unsure, :2])
            if unsure.any():
                unsure[unsure] = ~_among(cells[unsure], self._seen_through(level.height))
            under = (under & here) | unsure
            if under.any():
                out[level.instance_id] = out.get(level.instance_id, 0.0) + float(under.mean())
            left &= ~under
        return out

    def _seen_through(self, height: float) -> Int[np.ndarray, "c"]:
        """The squares in which a line of sight from above a height ends below it."""
        if height not in self._holes:
            eyes, ends = self._sights
            part = (height - eyes[:, 2]) / np.where(
                ends[:, 2] == eyes[:, 2], np.nan, ends[:, 2] - eyes[:, 2]
            )
            through = (eyes[:, 2] > height) & (ends[:, 2] < height - THICK)
            at = eyes[through, :2] + part[through, None] * (ends - eyes)[through, :2]
            self._holes[height] = np.unique(_cells(at))
        return self._holes[height]

    @cached_property
    def _sights(self) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3"]]:
        """Where lines of sight begin and end, evenly chosen from all sampled frames."""
        sampled = self._evidence.sampled
        known = np.flatnonzero(sampled.depth > 0)
        known = known[:: max(1, len(known) // RAYS)]
        s, c, _, _ = np.unravel_index(known, sampled.depth.shape)
        return sampled.cam_to_world[s, c, :3, 3], sampled.points.reshape(-1, 3)[known].astype(
            np.float64
        )

    def top(self, instance_id: int) -> LevelSurface:
        """The level surface of a thing of which most was seen: an outline may be that of a mere rim."""
        return max(
            (level for level in self.levels if level.instance_id == instance_id),
            key=lambda level: len(level.cells),
        )

    def hangs(self, instance_id: int) -> bool:
        """Is there air below a thing, in the first frame, so that something beside it holds it up?"""
        low = self._evidence.bounds(instance_id, 0)[0][2]
        on = self.falls(instance_id)
        heights = [level.height for level in self.levels if level.instance_id in on]
        return low - max((h for h in heights if h < low + THICK), default=low) > BESIDE

    def carried(self, dropped: Mapping[int, float], around: float) -> "Load":
        """Let things fall straight down, each with its weight, from where they are at first and at last, and with the
        rest of 1 the gripper's path and what is `around` metres beside it; what lands on a thing lands with it on what
        that falls on."""
        rank: dict[int, int] = {}
        for level in self.levels:
            rank.setdefault(level.instance_id, len(rank))
        weight = dict.fromkeys(rank, 0.0)
        for instance_id, amount in dropped.items():
            for frame in (0, -1):
                for on, part in self.falls(instance_id, frame).items():
                    weight[on] += amount * part / 2
        if (path := self._evidence.gripper) is not None:
            rest = 1 - sum(dropped.values())
            beside = [(x, y, 0.0) for x in (-around, 0, around) for y in (-around, 0, around)]
            for on, part in self.landing((path[:, None] + beside).reshape(-1, 3)).items():
                weight[on] += rest * part
        passed = {}
        for instance_id in rank:
            for on, part in _stable(self.falls(instance_id)).items():
                if rank[on] > rank[instance_id]:
                    passed[instance_id, on] = weight[instance_id] * part
                    weight[on] += passed[instance_id, on]
        return Load(weight, passed)


@dataclass(frozen=True)
class Load:
    """How much of what matters stands on each static thing: itself, or on what stands on it (1 is all of it).

    `passed[a, b]` of it comes from a to b, that a stands on.
    """

    weight: Mapping[int, float]
    passed: Mapping[tuple[int, int], float]

    def together(self, instance_ids: Collection[int]) -> float:
        """How much stands on any of these."""
        inner = sum(self.passed.get((a, b), 0.0) for a in instance_ids for b in instance_ids)
        return sum(self.weight[h] for h in instance_ids) - inner


def _stable(parts: Mapping[int, float]) -> Mapping[int, float]:
    """What carries more than half of a thing at rest carries it all: what overhangs is held by the rest."""
    main = max(parts, key=lambda on: parts[on], default=None)
    return {main: 1.0} if main is not None and parts[main] > 0.5 else parts


def _among(cells: Int[np.ndarray, "n"], ordered: Int[np.ndarray, "c"]) -> Bool[np.ndarray, "n"]:
    """Which numbers are among the ascending ones."""
    at = np.minimum(np.searchsorted(ordered, cells), len(ordered) - 1)
    return ordered[at] == cells if len(ordered) else np.zeros(len(cells), bool)
