"""How a task is set on the tabletop: what a drawn instance of one holds, where things stand, how the gripper goes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float

from rpaug.twin.motion import Key, Motion
from rpaug.twin.panda import OPEN
from rpaug.twin.tabletop import resting_height, upright
from rpaug.twin.world import Flex

Pose = Float[np.ndarray, "4 4"]

REACH = 0.09  # metres before and above its target at which the gripper lines up
DOWN = np.array([0.0, 0.0, -1.0])
LOOSE = ("block_plain", "block_two_coloured", "block_textured", "block_small", "cylinder", "pad")


@dataclass(frozen=True)
class StagedTask:
    """One drawn instance of a task.

    `manipulated` is the part that moves (its name is also the default target of a change),
    `receiver` the one it is brought to. `descriptions` are RLBench's kind of instructions, the first
    one the main one. `soft` is what bends in it, if anything does.
    """

    placing: Mapping[str, Pose]
    script: tuple[Key, ...]
    manipulated: str
    descriptions: tuple[str, ...]
    variation: int
    receiver: str | None = None
    soft: "SoftPart | None" = None


@dataclass(frozen=True)
class SoftPart:
    """The part of a job that bends, and how: its vertices over time, worked out from the robot's motion."""

    name: str
    flex: Flex
    track: Callable[[Motion], Float[np.ndarray, "t v 3"]]


def carry(name: str, grasp: Pose, place: Pose, opening: float) -> tuple[Key, ...]:
    """Take `name` at `grasp`, lift it, and set it down where the gripper is at `place`."""
    over = np.array([0, 0, REACH])
    held = partial(Key, straight=True, opening=opening, holds=name)
    return (
        Key(share=0.34, tip=moved(grasp, over)),
        Key(share=0.10, tip=grasp, straight=True),
        Key(share=0.05, opening=opening),
        held(share=0.11, tip=moved(grasp, over)),
        held(share=0.16, tip=moved(place, over)),
        held(share=0.10, tip=place),
        Key(share=0.05, opening=OPEN),
        Key(share=0.09, tip=moved(place, over), straight=True),
    )


def scattered(
    names: tuple[str, ...], spots: list[tuple[float, float]], rng: np.random.Generator
) -> dict[str, Pose]:
    """One thing a spot, in drawn order, each a little off and turned."""
    order = rng.permutation(len(spots))[: len(names)]
    places = {}
    for name, spot in zip(names, order, strict=True):
        x, y = np.array(spots[spot]) + rng.uniform(-0.01, 0.01, 2)
        places[name] = upright(x, y, resting_height(name), rng.uniform(-0.5, 0.5))
    return places


def gripper_pose(
    at: Float[np.ndarray, "3"],
    approach: Float[np.ndarray, "3"],
    opens_along: Float[np.ndarray, "3"],
) -> Pose:
    """The gripper's pose between its finger tips, turned the way that leaves joint 7 nearer to home."""
    pose = np.eye(4)
    y = opens_along - (opens_along @ approach) * approach
    y *= (1.0 if y[1] >= 0 else -1.0) / np.linalg.norm(y)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = np.cross(y, approach), y, approach, at
    return pose


def moved(pose: Pose, shift: Float[np.ndarray, "3"]) -> Pose:
    """The pose shifted by metres along the world's axes."""
    out = pose.copy()
    out[:3, 3] += shift
    return out
