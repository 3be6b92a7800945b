"""Key frames as PerAct and RVT pick them: where the gripper acts, or where the arm has come to rest.

The rule is that of Shridhar et al. 2022 (PerAct, arXiv 2209.05451, section 3.2).
"""

import numpy as np

from rpaug.core.types import Robot

STILL = 0.1  # radians per second: every joint slower than this counts as stopped
REST = 4  # frames after a stop before another may count


def find(robot: Robot) -> list[int]:
    """Frames, ascending, the last one always among them; none where the gripper's opening is unknown.

    A frame counts when the gripper is not as it was one frame before, when the arm stops while the gripper
    has been the same for three frames, or when it is the last. A second key frame right before the last one
    is the same stop seen twice and is dropped.
    """
    if robot.gripper_open is None:
        return []
    length = len(robot.gripper_open)
    found: list[int] = []
    rest = 0
    for t in range(length):
        stopped = rest <= 0 and _stopped(robot, t)
        rest = REST if stopped else rest - 1
        acts = bool(robot.gripper_open[t] != robot.gripper_open[t - 1])
        if t > 0 and (acts or stopped or t == length - 1):
            found.append(t)
    if len(found) > 1 and found[-2] == found[-1] - 1:
        del found[-2]
    return found


def _stopped(robot: Robot, t: int) -> bool:
    """Joints known to be at rest, not near the end, gripper the same from two frames before to one after.

    The two first frames look back around the end of the recording, as the readers' own rule does.
    """
    assert robot.gripper_open is not None
    if not robot.joint_velocities.shape[1]:
        return False
    if t >= len(robot.gripper_open) - 2:
        return False
    steady = len({float(robot.gripper_open[t + k]) for k in (-2, -1, 0, 1)}) == 1
    return steady and bool(np.all(np.abs(robot.joint_velocities[t]) <= STILL))
