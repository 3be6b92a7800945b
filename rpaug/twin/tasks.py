"""What is done on the tabletop: where things stand for a task, and the gripper's key poses."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float

from rpaug import geometry
from rpaug.twin.motion import Key
from rpaug.twin.panda import OPEN
from rpaug.twin.tabletop import BLOCK, GRIP, GRIP_RADIUS, resting_height, upright

Pose = Float[np.ndarray, "4 4"]

PULL = 0.15  # metres the drawer is opened by
_REACH = 0.09  # metres before and above its target at which the gripper lines up
_LEAN = np.deg2rad(40.0)  # how far the approach to the grip leans from the vertical into the drawer


@dataclass(frozen=True)
class Job:
    """One drawn instance of a task.

    `manipulated` is the part that moves (its name is also the default target of a change).
    `descriptions` are RLBench's kind of instructions, the first one the main one.
    """

    placing: Mapping[str, Pose]
    script: tuple[Key, ...]
    manipulated: str
    descriptions: tuple[str, ...]
    variation: int


def open_drawer(rng: np.random.Generator) -> Job:
    """Take the drawer's grip and pull it open by 15 cm."""
    x, y = np.array([0.22, 0.16]) + rng.uniform(-0.02, 0.02, 2)
    cabinet = upright(x, y, 0.0, np.deg2rad(-80.0) + rng.uniform(-0.12, 0.12))
    spots = [
        (0.05, -0.33),
        (0.22, -0.38),
        (0.40, -0.33),
        (0.08, 0.36),
        (-0.02, -0.14),
        (0.46, 0.08),
    ]
    out = cabinet[:3, 0]
    approach = -np.sin(_LEAN) * out - np.array([0, 0, np.cos(_LEAN)])
    grasp = _gripper(geometry.transform(cabinet, GRIP), approach, opens_along=out)
    script = (
        Key(share=0.36, tip=_moved(grasp, -_REACH * approach)),
        Key(share=0.16, tip=grasp, straight=True),
        Key(share=0.08, opening=GRIP_RADIUS),
        Key(
            share=0.34,
            tip=_moved(grasp, PULL * out),
            opening=GRIP_RADIUS,
            straight=True,
            holds="drawer",
        ),
        Key(share=0.06, opening=GRIP_RADIUS, holds="drawer"),
    )
    return Job(
        {"cabinet": cabinet, "drawer": cabinet, **_scatter(_LOOSE, spots, rng)},
        script,
        "drawer",
        ("open the drawer", "grip the handle and pull the drawer open", "slide the drawer open"),
        0,
    )


def pick_block(rng: np.random.Generator) -> Job:
    """Take a block, lift it and set it down on the pad."""
    variation = int(rng.integers(2))
    name, colour = (("block_plain", "red"), ("block_two_coloured", "red and yellow"))[variation]
    cabinet = upright(
        0.34 + rng.uniform(-0.02, 0.02), 0.26, 0.0, np.deg2rad(-75.0) + rng.uniform(-0.1, 0.1)
    )
    pad = upright(
        0.33 + rng.uniform(-0.03, 0.03), -0.10 + rng.uniform(-0.02, 0.02), resting_height("pad")
    )
    block = upright(
        0.10 + rng.uniform(-0.03, 0.03),
        -0.10 + rng.uniform(-0.04, 0.04),
        BLOCK[2],
        rng.uniform(-0.6, 0.6),
    )
    down = np.array([0.0, 0.0, -1.0])
    grasp = _gripper(block[:3, 3] + [0, 0, 0.015], down, opens_along=block[:3, 0])
    pad_top = pad[2, 3] + resting_height("pad")
    place = _gripper(
        np.array([pad[0, 3], pad[1, 3], pad_top + BLOCK[2] + 0.015]), down, opens_along=block[:3, 0]
    )
    over = np.array([0, 0, _REACH])
    carry = partial(Key, straight=True, opening=BLOCK[0], holds=name)
    script = (
        Key(share=0.34, tip=_moved(grasp, over)),
        Key(share=0.10, tip=grasp, straight=True),
        Key(share=0.05, opening=BLOCK[0]),
        carry(share=0.11, tip=_moved(grasp, over)),
        carry(share=0.16, tip=_moved(place, over)),
        carry(share=0.10, tip=place),
        Key(share=0.05, opening=OPEN),
        Key(share=0.09, tip=_moved(place, over), straight=True),
    )
    spots = [(0.06, -0.35), (0.23, -0.38), (0.41, -0.33), (0.08, 0.25)]
    others = tuple(thing for thing in _LOOSE if thing not in (name, "pad"))
    return Job(
        {
            "cabinet": cabinet,
            "drawer": cabinet,
            "pad": pad,
            name: block,
            **_scatter(others, spots, rng),
        },
        script,
        name,
        (
            f"put the {colour} block on the pad",
            f"pick up the {colour} block and set it down on the pad",
        ),
        variation,
    )


TASKS: Mapping[str, Callable[[np.random.Generator], Job]] = {
    "open_drawer": open_drawer,
    "pick_block": pick_block,
}

_LOOSE = ("block_plain", "block_two_coloured", "block_textured", "block_small", "cylinder", "pad")


def _scatter(
    names: tuple[str, ...], spots: list[tuple[float, float]], rng: np.random.Generator
) -> dict[str, Pose]:
    """One thing a spot, in drawn order, each a little off and turned."""
    order = rng.permutation(len(spots))[: len(names)]
    places = {}
    for name, spot in zip(names, order, strict=True):
        x, y = np.array(spots[spot]) + rng.uniform(-0.01, 0.01, 2)
        places[name] = upright(x, y, resting_height(name), rng.uniform(-0.5, 0.5))
    return places


def _gripper(
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


def _moved(pose: Pose, shift: Float[np.ndarray, "3"]) -> Pose:
    out = pose.copy()
    out[:3, 3] += shift
    return out
