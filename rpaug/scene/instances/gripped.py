"""What the gripper closes on, told by its opening and by where the robot's outline ends in the images.

The robot comes in from an image's edge, so that its fingers are what lies farthest from there along its own outline.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float64, Int, Int32

from rpaug.scene.instances.grouping import AROUND, MOVING, SUPPORT

CLOSES = 0.1  # of the widest opening: a gripper that gives up so much of it closes
FINGERS = 0.05  # of the image's width: so near to the farthest pixel they end
REACH = 0.09  # of the image's width around the fingers: what is gripped lies there
HELD = 0.5  # share of a thing that lies there, if it is gripped
HALTED = 0.2  # of the image's width at most between two frames: faster, it is on its way
SOME = 0.2  # share of what lies there from which it may be gripped
CLEAR = 2.0  # times the next thing's share
LEFT = 0.3  # share of its place that shows neither it nor the robot at the end: it went away

Ids = Int32[np.ndarray, "h w"]


@dataclass(frozen=True)
class Gripped:
    """`thing` is what all cameras that see the fingers agree on, None without that, `share` how much of it at least is
    between them. `within` are those of support and surroundings that it may be part of where no camera shows any
    instance there. `rivals` are several things that all cameras show there, none of them clearly."""

    thing: int | None = None
    share: float = 0.0
    within: frozenset[int] = frozenset()
    rivals: frozenset[int] = frozenset()


def closes(opening: Float64[np.ndarray, "t"]) -> int | None:
    """The first frame in which a gripper has begun to close; None where it does not."""
    widest = np.maximum.accumulate(opening)
    shut = np.flatnonzero(opening < widest - CLOSES * max(float(opening.max()), 1e-9))
    return int(shut[0]) if len(shut) else None


def find(
    resting: Mapping[str, Ids], shown: Callable[[int], Mapping[str, Ids]], start: int, last: int
) -> Gripped:
    """What the cameras show at the fingers in frame `start`, in which the gripper begins to close; `last` is the last
    one, and `resting` the ids of each camera's backdrop.

    A gripper that closes where it began, or on its way, closes on nothing.
    """
    at = shown(start)
    near = {name: mask for name, ids in at.items() if (mask := _fingers(ids == MOVING)).any()}
    came = _steps(shown(0), near)
    halted = all(step <= HALTED for step in _steps(shown(max(start - 1, 0)), near).values())
    if not halted or all(came.get(name, np.inf) <= REACH for name in near):
        return Gripped()
    shares: list[dict[int, float]] = []
    there = set[int]()
    for name, mask in near.items():
        behind = resting[name]
        found, counts = np.unique(behind[mask & (behind != MOVING)], return_counts=True)
        there |= set(found[counts >= SOME * counts.sum()].tolist())
        shares.append(
            {
                int(one): float(count / (behind == one).sum())
                for one, count in zip(found, counts, strict=True)
                if one > AROUND
            }
        )
    within = frozenset(there) if there <= {SUPPORT, AROUND} else frozenset()
    thing, share, rivals = _agreed(shares)
    if thing is None:
        return Gripped(within=within, rivals=rivals)
    end = shown(last)
    if any(_gone(resting[name] == thing, end[name], thing) for name in at):
        return Gripped(within=within)
    return Gripped(thing, share)


def _agreed(shares: Sequence[Mapping[int, float]]) -> tuple[int | None, float, frozenset[int]]:
    """The one thing that lies at the fingers in every camera, by its least share there; that share; and, in place of
    both, the several that may be it. What one camera shows there beside it lies before or behind it if another camera
    does not."""
    every = set[int]().union(*shares)
    least = {one: min(seen.get(one, 0.0) for seen in shares) for one in every}
    order = sorted(every, key=lambda one: -least[one])
    if not order or least[order[0]] < HELD:
        return None, 0.0, frozenset()
    rivals = frozenset(one for one in order if least[order[0]] < CLEAR * least[one])
    if len(rivals) > 1:
        return None, 0.0, rivals
    return order[0], least[order[0]], frozenset()


def _steps(
    before: Mapping[str, Ids], near: Mapping[str, Bool[np.ndarray, "h w"]]
) -> dict[str, float]:
    """How far the fingers have moved in each camera that saw them before, in shares of its width."""
    out = {}
    for name, mask in near.items():
        if (then := _fingers(before[name] == MOVING)).any():
            off = np.argwhere(mask).mean(0) - np.argwhere(then).mean(0)
            out[name] = float(np.hypot(*off)) / mask.shape[1]
    return out


def _fingers(robot: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """The pixels around the end of the robot that is farthest from the image's edge; none where it does not enter."""
    far = _from_edge(robot)
    reach = max(1.0, FINGERS * robot.shape[1])
    if far.max() <= reach:
        return np.zeros_like(robot)
    down, right = np.argwhere(far >= far.max() - reach).mean(0)
    rows, columns = np.mgrid[: robot.shape[0], : robot.shape[1]]
    return np.hypot(rows - down, columns - right) < REACH * robot.shape[1]


def _from_edge(mask: Bool[np.ndarray, "h w"]) -> Int[np.ndarray, "h w"]:
    """Steps through the mask from where it touches the image's edge; -1 outside and where no way leads."""
    steps = np.full(mask.shape, -1)
    front = mask.copy()
    front[1:-1, 1:-1] = False
    count, square = 0, np.ones((3, 3), np.uint8)
    while front.any():
        steps[front] = count
        count += 1
        front = (cv2.dilate(front.astype(np.uint8), square) > 0) & mask & (steps < 0)
    return steps


def _gone(place: Bool[np.ndarray, "h w"], ids: Ids, thing: int) -> bool:
    """Is a thing's place seen without it and without the robot?"""
    return bool(place.any() and (~np.isin(ids[place], (thing, MOVING))).mean() > LEFT)
