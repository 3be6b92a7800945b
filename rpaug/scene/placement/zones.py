"""Which parts of the free space matter to a policy: by the target, by the gripper's low path, inside its workspace."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from rpaug.core import geometry, sampling
from rpaug.core.errors import TargetError
from rpaug.core.types import Scene
from rpaug.scene.placement.free_space import CELL, FreeSpace
from rpaug.scene.placement.placing import points_by_instance_id

LOW = 0.3  # metres over the support: a gripper that goes higher passes over what stands there
HIGH = 0.6  # metres over the support: a robot that works on it, or on what stands on it, gets lower at times
MOMENTS = 24  # over an episode, at which a target that moves is looked up
REACH = 0.2  # metres around where the gripper went: the policy's workspace
ACTED_ON = ("manipulated", "receiver")  # the first that a scene has is the target

Box = tuple[tuple[float, float], tuple[float, float]]
"""(x, y) of the lowest and of the highest corner, world metres."""


@dataclass(frozen=True)
class Zones:
    """Cells of a free space, by where their middles lie: `path` and `target` near the one and the other, `beyond` near
    neither, all inside the workspace; `outside` of it the rest."""

    path: Bool[np.ndarray, "r c"]
    target: Bool[np.ndarray, "r c"]
    beyond: Bool[np.ndarray, "r c"]
    outside: Bool[np.ndarray, "r c"]
    known: frozenset[str]  # of path and target those that the recording shows

    def __getitem__(self, name: str) -> Bool[np.ndarray, "r c"]:
        """One of the zones, or `anywhere` for all of the workspace."""
        return ~self.outside if name == "anywhere" else getattr(self, name)


def find(scene: Scene, room: FreeSpace, within: float, box: Box | None) -> Zones:
    """The zones of a free space; `box` is the workspace, None for that of `workspace`.

    Near is at most `within` metres from the target's recorded surface, wherever it comes to be, or from where the
    gripper's tip went no higher than `LOW`; both seen from above. Raises TargetError where the tip never
    came down to `HIGH`: such a support is a floor, and not where the robot works.
    """
    box = box or workspace(scene)
    path = low_path(scene, room.level)
    target = target_places(scene)
    lowest = _tips(scene)[:, 2].min(initial=np.inf) - room.level
    if HIGH < lowest < np.inf:
        raise TargetError(
            f"what was taken for the table lies {100 * lowest:.0f} cm below wherever the gripper went, so it is not "
            "where the robot works"
        )
    inside: Bool[np.ndarray, "r c"] = np.ones(room.seen.shape, bool)
    if box is not None:
        at = room.at(np.argwhere(inside)).reshape(*inside.shape, 2)
        inside &= ((at >= np.array(box[0])) & (at <= np.array(box[1]))).all(-1)
    # A cell's middle may be half a cell from the point that it holds.
    by_path, by_target = (room.near(points, within - CELL) for points in (path, target))
    beyond = ~room.near(np.concatenate([path, target]), within + CELL)
    known = frozenset(name for name, at in (("path", path), ("target", target)) if len(at))
    return Zones(by_path & inside, by_target & inside, beyond & inside, ~inside, known)


def acted_on(scene: Scene) -> frozenset[int]:
    """The target: what the robot manipulates, else what it acts on; empty where neither is known."""
    return next((ids for role in ACTED_ON if (ids := scene.roles.get(role))), frozenset())


def target_places(scene: Scene) -> Float64[np.ndarray, "n 3"]:
    """The target's recorded surface wherever it comes to be over the episode."""
    poses = {id_: body.to_world for body in scene.tracked for id_ in body.instance_ids}
    found = [np.zeros((0, 3))]
    for instance_id, points in points_by_instance_id(scene, acted_on(scene)).items():
        frames = sampling.frames(scene.episode.length, MOMENTS)
        moved = poses[instance_id][frames] @ geometry.inverse(poses[instance_id][0])
        # A pose that comes again adds nothing.
        found += [geometry.transform(pose, points) for pose in np.unique(moved.round(4), axis=0)]
    return np.concatenate(found)


def low_path(scene: Scene, level: float) -> Float64[np.ndarray, "n 3"]:
    """Where the gripper's tip went low over the support, in steps of a cell at most."""
    tips = _tips(scene)
    steps = np.ceil(np.linalg.norm(np.diff(tips, axis=0), axis=1) / CELL).astype(int).clip(1)
    between = [
        np.linspace(start, end, count, endpoint=False)
        for start, end, count in zip(tips[:-1], tips[1:], steps.tolist(), strict=True)
    ]
    path = np.concatenate([*between, tips[-1:]])
    return path[path[:, 2] < level + LOW]


def workspace(scene: Scene) -> Box | None:
    """The upright box around all that the gripper's tip reached and `REACH` more; None without its poses."""
    tips = _tips(scene)[:, :2]
    if not len(tips):
        return None
    low, high = tips.min(0) - REACH, tips.max(0) + REACH
    return (float(low[0]), float(low[1])), (float(high[0]), float(high[1]))


def _tips(scene: Scene) -> Float64[np.ndarray, "n 3"]:
    """Where the gripper's tip is at each frame; nothing where a source does not say."""
    poses = scene.episode.robot.gripper_to_world
    return np.zeros((0, 3)) if poses is None else poses[:, :3, 3]
