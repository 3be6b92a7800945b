"""What every foreign world gives: tasks with true roles, and rollouts of an expert."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import mujoco
import numpy as np

from tools.bench.foreign.simulated import Eye


@dataclass(frozen=True, kw_only=True)
class Task:
    """A task and which bodies truly are what in it.

    `may` are bodies that a role can hold or leave out without being wrong (the rim of a table); a role that truly does
    not exist is empty. `moved` is what the expert moves, `onto` what it is brought to, or what it is hinged to.
    """

    instruction: str
    moved: tuple[str, ...]
    onto: tuple[str, ...] = ()
    may: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    table: tuple[str, ...] = ()  # where it is not the world's


@dataclass
class Rollout:
    """An expert's run: the simulator's model and its states, and what a robot would have recorded."""

    model: mujoco.MjModel
    source: str  # the model's file, or its XML
    states: list[dict[str, np.ndarray]] = field(default_factory=list)
    gripper: list[np.ndarray] = field(default_factory=list)  # (4, 4), z along the approach
    open: list[float] = field(default_factory=list)  # 1 where the gripper is told to open
    joints: list[np.ndarray] = field(default_factory=list)
    actions: list[np.ndarray] = field(default_factory=list)
    success: bool = False


class World(Protocol):
    """One simulator."""

    tasks: Mapping[str, Task]
    cameras: Mapping[str, Eye]
    groups: tuple[int, ...]  # of geoms that are drawn
    hidden: tuple[str, ...]  # what names of bodies begin with that are no things but marks
    robot: tuple[str, ...]  # the roots of the robot's bodies
    table: tuple[str, ...]
    may: Mapping[str, tuple[str, ...]]

    def rollout(self, task: str, seed: int) -> Rollout:
        """The expert's run."""
        ...


def rigid(rotation: Any, position: Any) -> np.ndarray:
    """A pose of (3, 3) and (3,)."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = np.reshape(rotation, (3, 3)), position
    return out


def above(point: np.ndarray, height: float) -> np.ndarray:
    """The point so many metres higher."""
    return point + np.array([0.0, 0.0, height])
