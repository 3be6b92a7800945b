"""Fingers of a gripper: parts that hang on it and slide by its recorded opening."""

import numpy as np
from jaxtyping import Float64, Int

from rpaug.core import geometry
from rpaug.core.types import Robot
from rpaug.scene.tracking.motion import GRIPPER, TrackedInstance

TRAVEL = 1e-3  # metres: an opening that changes by less shows nothing
SLIDES = 5e-4  # metres a finger slides in an interval, from which that interval tells something
WIN = 0.5  # millimetres an interval that the opening must explain more than the gripper alone does
GAIN = 0.7  # and the share of the gripper's cost that it may leave
ALONG = 1  # the gripper's axis along which its fingers slide: y, as CoppeliaSim's and Franka's hands have it


def fingers(robot: Robot) -> Float64[np.ndarray, "f t 4 4"]:
    """World poses of both fingers by the recorded opening of each; none if it is not recorded or stays."""
    gripper, openings = robot.gripper_to_world, robot.extra.get("gripper_joint_positions")
    if gripper is None or openings is None or openings.shape != (len(gripper), 2):
        return np.zeros((0, 0 if gripper is None else len(gripper), 4, 4))
    if not np.isfinite(openings).all() or np.ptp(openings) < TRAVEL:
        return np.zeros((0, len(gripper), 4, 4))
    aside = np.tile(np.eye(4), (2, len(gripper), 1, 1))
    aside[:, :, ALONG, 3] = openings.T * np.array([[1.0], [-1.0]])
    return gripper @ aside


def sliding(
    case: TrackedInstance,
    labels: Int[np.ndarray, "i"],
    representations: Float64[np.ndarray, "f t 4 4"],
) -> Float64[np.ndarray, "t 4 4"] | None:
    """The track of the finger that explains better than the gripper what is seen of an instance that hangs on it.

    Only intervals in which fingers slide are asked. None if the gripper explains them as well, or shows nothing.
    """
    if not len(representations) or not (labels == GRIPPER).all():
        return None
    left = np.zeros(1 + len(representations))
    asked = 0
    for a, b in zip(case.seen[:-1].tolist(), case.seen[1:].tolist(), strict=True):
        first, last = case.sampled.frames[[a, b]]
        ways = np.stack([case.representations[GRIPPER], *representations])
        motions = ways[:, last] @ geometry.inverse(ways[:, first])
        middle = np.median(case.points(a)[0], 0)
        apart = geometry.transform(motions[1], middle) - geometry.transform(motions[0], middle)
        if np.linalg.norm(apart) < SLIDES:
            continue
        average, count = case.judge(a, b, motions)
        if count.min() > 0:
            left += 1e3 * average
            asked += 1
    best = 1 + int(left[1:].argmin())
    if not asked or left[best] > min(GAIN * left[0], left[0] - WIN * asked):
        return None
    track = representations[best - 1]
    return track @ geometry.inverse(track[0])
