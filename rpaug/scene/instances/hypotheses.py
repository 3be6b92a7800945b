"""The motions that a point of an unmasked episode may follow."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from rpaug.core import geometry
from rpaug.core.types import Robot
from rpaug.scene.sampled_frames import events
from rpaug.scene.tracking.arms import link_tracks
from rpaug.scene.tracking.jaws import fingers

STATIC = 0


@dataclass(frozen=True)
class MotionHypothesis:
    """A named track: `to_world[t]` carries points of the moving thing's own frame to the world."""

    name: str
    to_world: Float64[np.ndarray, "t 4 4"]


def known(robot: Robot, length: int) -> tuple[MotionHypothesis, ...]:
    """Standing still first; then the gripper, its two fingers, a known arm's links, and what is held between the
    gripper's closing and its opening."""
    still = np.tile(np.eye(4), (length, 1, 1))
    found = [MotionHypothesis("static", still)]
    if robot.gripper_to_world is None:
        return tuple(found)
    gripper = robot.gripper_to_world
    found.append(MotionHypothesis("gripper", gripper))
    both = zip(("finger", "other finger"), fingers(robot), strict=False)
    found += [MotionHypothesis(name, track) for name, track in both]
    links = link_tracks(robot)
    if links is not None:
        found += [MotionHypothesis(f"link {k + 1}", track) for k, track in enumerate(links[:-1])]
    found += held(robot, length)
    return tuple(found)


def held(robot: Robot, length: int) -> list[MotionHypothesis]:
    """What rests, is carried from a closing of the gripper to its next opening (or the end), and rests again."""
    if robot.gripper_open is None or robot.gripper_to_world is None:
        return []
    out = []
    happens = events(robot.gripper_open)
    for start in happens[robot.gripper_open[happens] > 0.5].tolist():
        later = happens[(happens > start) & (robot.gripper_open[happens] <= 0.5)]
        stop = int(later[0]) if len(later) else length - 1
        out.append(
            MotionHypothesis(f"held from {start}", carried(robot.gripper_to_world, start, stop))
        )
    return out


def carried(
    gripper: Float64[np.ndarray, "t 4 4"], start: int, stop: int
) -> Float64[np.ndarray, "t 4 4"]:
    """At rest, then rigid to the gripper from frame `start` to frame `stop`, then at rest."""
    when = np.clip(np.arange(len(gripper)), start, stop)
    return gripper[when] @ geometry.inverse(gripper[start])
