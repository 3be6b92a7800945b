"""Tasks with things that bend: a towel that is pushed and swings, a soft hand on a post that waves."""

from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float

from rpaug.core import geometry
from rpaug.twin import flex
from rpaug.twin.flex import FABRIC, RUBBER
from rpaug.twin.motion import STEP, Key, Motion
from rpaug.twin.panda import FINGER_END, FINGER_HALF
from rpaug.twin.staging import LOOSE, SoftPart, StagedTask, gripper_pose, moved, scattered
from rpaug.twin.tabletop import POST, RACK, TABLE, upright
from rpaug.twin.world import Print

LEAN = np.deg2rad(35.0)  # of the fingers from the vertical, away from the robot
TOWEL = (0.22, 0.24)  # metres wide and long
GUST = 3e-4  # newtons on each of the towel's vertices
CELL = np.array([0.022, 0.017, 0.020])  # of the soft hand: depth, width, height
CURL = 0.015  # newtons that bend a finger, on each vertex of its tip


def push_towel(rng: np.random.Generator) -> StagedTask:
    """Push a hanging towel away with closed fingers and let go of it at once; a draught stirs it all the while."""
    x, y = np.array([0.36, 0.0]) + rng.uniform(-0.02, 0.02, 2)
    rack = upright(x, y)
    corner = rack[:3, 3] + [0, TOWEL[0] / 2, RACK[2]]
    towel = flex.sheet(
        corner,
        np.array([0, -TOWEL[0], 0]),
        np.array([0, 0, -TOWEL[1]]),
        (11, 12),
        _print(rng, 0.11),
    )
    draught = np.random.default_rng(rng.integers(2**32))

    def swing(motion: Motion) -> Float[np.ndarray, "t v 3"]:
        forces = flex.gusts(towel.points, motion.length, np.array([1.0, 0, 0]), GUST, draught)
        approach = motion.gripper_to_world[:, :3, 2]
        end = motion.gripper_to_world[:, :3, 3] + (FINGER_END - FINGER_HALF) * approach
        rod = np.stack([end, end - 0.05 * approach], 1)
        pinned = towel.points[:, 2] > corner[2] - 1e-6
        return flex.simulate(
            towel, FABRIC, length=motion.length, pinned=pinned, forces=forces, rod=rod,
            radius=FINGER_HALF,
        )  # fmt: skip

    approach = np.array([np.sin(LEAN), 0, -np.cos(LEAN)])
    touch = gripper_pose(
        corner + np.array([-0.03, -TOWEL[0] / 2 + rng.uniform(-0.03, 0.03), -0.18]),
        approach,
        np.array([0, 1.0, 0]),
    )
    script = (
        Key(share=0.22, tip=moved(touch, np.array([-0.06, 0, 0])), opening=0.0),
        Key(share=0.06, tip=touch, opening=0.0, straight=True),
        Key(share=0.20, tip=moved(touch, np.array([0.10, 0, 0])), opening=0.0, straight=True),
        Key(share=0.10, tip=moved(touch, np.array([-0.08, 0, 0])), opening=0.0, straight=True),
        Key(share=0.42, opening=0.0),
    )
    spots = [(0.05, -0.33), (0.22, -0.38), (0.42, -0.30), (0.08, 0.36), (0.44, 0.30), (0.20, 0.34)]
    return StagedTask(
        {"rack": rack, **scattered(LOOSE, spots, rng)},
        script,
        "towel",
        ("push the towel", "give the hanging towel a push"),
        0,
        "rack",
        SoftPart("towel", towel, swing),
    )


def wave_glove(rng: np.random.Generator) -> StagedTask:
    """A soft hand on a post turns to and fro and beckons with its fingers while the gripper presses a button."""
    x, y = np.array([0.30, 0.10]) + rng.uniform(-0.03, 0.03, 2)
    post = upright(x, y)
    glove = flex.hand(post[:3, 3] + [0, 0, POST[1]], CELL, _print(rng, 0.06))
    foot = glove.points[:, 2] < TABLE + POST[1] + 1.2 * CELL[2]
    tips = glove.points[:, 2] > TABLE + POST[1] + 7.5 * CELL[2]
    period, phase = rng.uniform(1.8, 2.6), rng.uniform(0, 2 * np.pi)

    def wave(motion: Motion) -> Float[np.ndarray, "t v 3"]:
        seconds = STEP * np.arange(motion.length)
        turns = 0.3 * (np.sin(2 * np.pi * seconds / period + phase) - np.sin(phase))
        around = glove.points - post[:3, 3]
        driven = np.stack(
            [around @ geometry.rotation(np.array([0, 0, turn])).T + post[:3, 3] for turn in turns]
        )
        beat = 2 * np.pi * seconds[:, None] / 1.3 + 50.0 * glove.points[:, 1]
        forces = np.zeros((motion.length, len(glove.points), 3))
        forces[:, tips, 0] = CURL * np.sin(beat)[:, tips]
        return flex.simulate(
            glove, RUBBER, length=motion.length, pinned=foot, forces=forces, driven=driven
        )

    above = gripper_pose(
        post[:3, 3] + [-0.10, -0.24, 0.16], np.array([0, 0, -1.0]), np.array([0, 1.0, 0])
    )
    script = (
        Key(share=0.5, tip=above, opening=0.0),
        Key(share=0.25, tip=moved(above, np.array([0, 0, -0.1])), opening=0.0, straight=True),
        Key(share=0.25, tip=above, opening=0.0, straight=True),
    )
    spots = [(0.03, -0.33), (0.22, -0.38), (0.42, -0.30), (0.04, 0.36), (0.24, 0.38), (0.46, 0.30)]
    return StagedTask(
        {"post": post, **scattered(LOOSE, spots, rng)},
        script,
        "glove",
        ("wave back at the soft hand",),
        0,
        None,
        SoftPart("glove", glove, wave),
    )


SOFT_TASKS: Mapping[str, Callable[[np.random.Generator], StagedTask]] = {
    "push_towel": push_towel,
    "wave_glove": wave_glove,
}


def _print(rng: np.random.Generator, side: float) -> Print:
    return Print(
        kind=str(rng.choice(("checks", "marble", "spots"))),
        seed=int(rng.integers(2**32)),
        side=side,
    )
