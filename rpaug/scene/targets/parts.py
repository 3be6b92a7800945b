"""The parts of one piece of furniture: what belongs to it, and the row of drawers or doors that the moved one is of.

A piece is the receiver with what the robot moves on it without taking it off: a drawer, not a block that it lays in.
Its row are the parts of about the same size as the moved one was when it was shut. The world's z axis points up.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float64

from rpaug.core import geometry
from rpaug.core.types import Scene
from rpaug.scene.sampled_frames import SampledFrames
from rpaug.scene.targets.places import OUTER, RESTS, LocatedInstance, gap, robot_frame, stands
from rpaug.scene.tracking.chain import OFTEN
from rpaug.scene.tracking.touch import touching

ALIKE = 0.15  # share by which the sides of parts of one row differ at most
SPREAD = 0.02  # metres by which they differ at least: a handle hidden, an edge cut off


@dataclass(frozen=True, eq=False)
class Furniture:
    """One piece: all its instance ids, those that the robot moves on it, and its row of parts, in the robot's frame.

    `row` is empty where nothing moved on the piece, and has the moved part alone where no other is like it.
    """

    instance_ids: frozenset[int]
    moved: frozenset[int]
    row: tuple[LocatedInstance, ...]


def furniture(scene: Scene, sampled: SampledFrames) -> Furniture | None:
    """The piece of furniture that the robot works on; None where the receiver is no more than a table, or unknown."""
    still = scene.roles.get("receiver", frozenset()) - scene.roles.get("table", frozenset())
    if not still:
        return None
    moved = [group for group in moved_things(scene, sampled) if _always(group, still, sampled)]
    ids = frozenset[int]().union(*moved)
    if len(moved) != 1:
        return Furniture(still | ids, ids, ())
    row = _row(scene, sampled, still | _against(scene, sampled, still), ids)
    return Furniture(still.union(ids, *(part.instance_ids for part in row)), ids, row)


def _against(scene: Scene, sampled: SampledFrames, still: frozenset[int]) -> frozenset[int]:
    """Things of no role that stand still and touch the piece: some fronts stand out of its outline."""
    taken = frozenset[int]().union(*scene.roles.values())
    static = {h for body in scene.bodies if body.motion == "static" for h in body.instance_ids}
    pairs = touching(sampled)
    return frozenset(h for pair in pairs if pair & still for h in pair & static - taken)


def moved_things(scene: Scene, sampled: SampledFrames) -> list[frozenset[int]]:
    """What is manipulated, as things that move by themselves; a handle that the gripper holds is of what it is on."""
    role = scene.roles.get("manipulated", frozenset())
    groups = [body.instance_ids & role for body in scene.bodies if body.instance_ids & role]
    if len(groups) < 2 or not sampled.cameras:
        return groups
    held = gripped(scene, sampled)
    grips = [group for group in groups if group <= held]
    things = [group for group in groups if group not in grips]
    for grip in grips:
        on = [k for k, thing in enumerate(things) if _always(grip, thing, sampled)]
        if len(on) == 1:
            things[on[0]] |= grip
        else:
            things.append(grip)
    return things


def gripped(scene: Scene, sampled: SampledFrames) -> frozenset[int]:
    """Those instance ids of the manipulated that the gripper touches."""
    hand = {h for body in scene.bodies if body.motion == "gripper" for h in body.instance_ids}
    hand &= scene.roles.get("robot", frozenset())
    role = scene.roles.get("manipulated", frozenset())
    return frozenset(h for pair in touching(sampled) if pair & hand for h in pair & role)


def stood_on(scene: Scene, sampled: SampledFrames) -> frozenset[int]:
    """What the manipulated touches in the first frame, but for robot, table and background."""
    taken = frozenset().union(
        *(scene.roles.get(name, frozenset()) for name in ("robot", "table", "background"))
    )
    role = scene.roles.get("manipulated", frozenset())
    pairs = touching(sampled, slice(0, 1))
    return frozenset(h for pair in pairs if pair & role for h in pair - role - taken)


def _always(group: frozenset[int], other: frozenset[int], sampled: SampledFrames) -> bool:
    """Does a thing touch another from the first frame to the last, and in most between?"""
    shown = np.isin(sampled.ids[:, sampled.fixed], list(group)).any((1, 2, 3))

    def touches(frames: slice) -> int:
        found = touching(sampled, frames)
        return max(
            (count for pair, count in found.items() if pair & group and pair & other), default=0
        )

    return bool(
        touches(slice(0, 1))
        and touches(slice(-1, None))
        and touches(slice(None)) >= OFTEN * shown.sum()
    )


def _row(
    scene: Scene, sampled: SampledFrames, still: frozenset[int], moved: frozenset[int]
) -> tuple[LocatedInstance, ...]:
    """The moved part and those like it, as they stood when it was shut, each with the small things on it."""
    ends = {h: stands(scene, sampled, h, (0, -1)) for h in sorted(still | moved)}
    ends = {h: both for h, both in ends.items() if len(both[0])}
    own = moved & ends.keys()
    if not own:
        return ()
    base = np.concatenate([ends[h][0] for h in still & ends.keys()])
    seed = max(own, key=lambda h: (float(_size(ends[h][0]).max()), h))
    away = [np.linalg.norm((end.mean(0) - np.median(base, 0))[:2]) for end in ends[seed]]
    shut = 0 if away[0] <= away[1] else 1
    seen = {h: both[shut if h in own else 0] for h, both in ends.items()}
    turn = np.deg2rad(cv2.minAreaRect(base[:, :2].astype(np.float32))[2])
    upright = geometry.rigid(np.array([0, 0, -turn]), np.zeros(3))
    size = {h: _size(geometry.transform(upright, points)) for h, points in seen.items()}
    # Of a drawer that is pulled out one sees more than of those that are shut, along its way.
    way = np.abs(upright[:3, :3] @ (ends[seed][1] - ends[seed][0]).mean(0))
    along = np.eye(3, dtype=bool)[way.argmax()]
    alike = [seed, *(h for h in sorted(still & seen.keys()) if _alike(size[h], size[seed], along))]
    frame = robot_frame(scene, sampled)
    located = {h: LocatedInstance(frozenset([h]), geometry.transform(frame, seen[h])) for h in seen}
    members = []
    for h in alike:
        small = {k for k in seen if k not in alike and _lies_on(located[k], located[h])}
        ids = moved if h == seed else small | {h}
        members.append(LocatedInstance(frozenset(ids), located[h].points))
    return tuple(members)


def _size(points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "3"]:
    low, high = np.percentile(points, [OUTER, 100 - OUTER], axis=0)
    return high - low


def _alike(
    size: Float64[np.ndarray, "3"], other: Float64[np.ndarray, "3"], along: Bool[np.ndarray, "3"]
) -> bool:
    """Are they as large, and along the other's way no larger?"""
    more = size - other
    slack = np.maximum(ALIKE * np.maximum(size, other), SPREAD)
    return bool((more < slack).all() and (more > -slack)[~along].all())


def _lies_on(small: LocatedInstance, part: LocatedInstance) -> bool:
    """Is it a handle or a knob: smaller, within the part's height and width, and against it?"""
    inside = (small.middle > part.low - 2 * RESTS) & (small.middle < part.high + 2 * RESTS)
    fits = small.size[2] < part.size[2] and np.sort(small.size)[-1] < np.sort(part.size)[-1]
    return bool(fits and inside.all() and gap(small, part) < RESTS)
