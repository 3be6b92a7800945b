"""What the gripper closes on, told by its opening and by where the robot's outline ends in the images.

The robot comes in from an image's edge, so that its fingers are what lies farthest from there along its own outline.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float64, Int, Int32

from rpaug.scene.instances.grouping import AROUND, MOVING, SUPPORT

CLOSES = 0.1  # of the widest opening: a gripper that gives up so much of it closes
FINGERS = 0.05  # of the image's width: so near to the farthest pixel they end
REACH = 0.09  # of the image's width around the fingers: what is gripped lies there
HELD = 0.5  # share of a thing that lies there, if it is gripped
ALONE = 0.9  # share of what lies there from which there is nothing else
CLEAR = 2.0  # times the next thing's share
LEFT = 0.3  # share of its place that shows neither it nor the robot at the end: it went away

Ids = Int32[np.ndarray, "h w"]


@dataclass(frozen=True)
class Gripped:
    """`thing` is what all cameras that see the fingers agree on, None without that, `share` how much of it at least is
    between them. `within` are those of support and surroundings that it may be part of instead."""

    thing: int | None = None
    share: float = 0.0
    within: frozenset[int] = frozenset()


def closes(opening: Float64[np.ndarray, "t"]) -> int | None:
    """The first frame in which a gripper has begun to close; None where it does not."""
    widest = np.maximum.accumulate(opening)
    shut = np.flatnonzero(opening < widest - CLOSES * max(float(opening.max()), 1e-9))
    return int(shut[0]) if len(shut) else None


def find(resting: Mapping[str, Ids], at: Mapping[str, Ids], last: Mapping[str, Ids]) -> Gripped:
    """What the cameras show at the fingers: the ids of each one's backdrop, of the frame in which the gripper begins
    to close, and of the last one."""
    best: list[tuple[int, float]] = []
    alone: list[int] = []
    for name, ids in at.items():
        near = _fingers(ids == MOVING)
        if not near.any():
            continue
        behind = resting[name]
        found, counts = np.unique(behind[near], return_counts=True)
        shares = {
            int(one): count / (behind == one).sum()
            for one, count in zip(found, counts, strict=True)
            if one > AROUND
        }
        order = sorted(shares, key=lambda one: -shares[one])
        clear = len(order) < 2 or shares[order[0]] >= CLEAR * shares[order[1]]
        held = bool(order) and clear and shares[order[0]] >= HELD
        best.append((order[0], float(shares[order[0]])) if held else (0, 0.0))
        commonest = int(found[counts.argmax()])
        alone.append(commonest if counts.max() >= ALONE * counts.sum() else 0)
    # Before the support a gripper is seen wherever it works; a thing that stands out from it in one camera is no part.
    within = {AROUND} & set(alone) | ({SUPPORT} if set(alone) == {SUPPORT} else set())
    named = {thing for thing, _ in best}
    if len(named) != 1 or 0 in named:
        return Gripped(within=frozenset(within))
    (thing,) = named
    if any(_gone(resting[name] == thing, last[name], thing) for name in at):
        return Gripped(within=frozenset(within))
    return Gripped(thing, min(share for _, share in best))


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
