"""Where an arm's links are, from the joints it recorded: only for arms whose measures are known."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float64

from rpaug import geometry
from rpaug.types import Robot

GOOD_FIT = 0.006  # metres and radians / LEVER, rms: simulated arms give way by a few millimetres
LEVER = 0.3  # metres: how far off a radian of gripper error is felt


@dataclass(frozen=True)
class Arm:
    """Modified Denavit-Hartenberg measures (Craig 1986), one entry a joint, in metres and radians."""

    a: tuple[float, ...]
    d: tuple[float, ...]
    alpha: tuple[float, ...]


HALF = np.pi / 2
PANDA = Arm(  # Franka Emika, "Robot and interface specifications"
    a=(0.0, 0.0, 0.0, 0.0825, -0.0825, 0.0, 0.088),
    d=(0.333, 0.0, 0.316, 0.0, 0.384, 0.0, 0.0),
    alpha=(0.0, -HALF, HALF, HALF, -HALF, HALF, HALF),
)
KNOWN = (PANDA,)


def forward(arm: Arm, joints: Float64[np.ndarray, "t j"]) -> Float64[np.ndarray, "j t 4 4"]:
    """Pose of every link in the arm's base, over time."""
    at = np.tile(np.eye(4), (len(joints), 1, 1))
    links = []
    for i, (a, d, alpha) in enumerate(zip(arm.a, arm.d, arm.alpha, strict=True)):
        c, s = np.cos(joints[:, i]), np.sin(joints[:, i])
        ca, sa = np.cos(alpha), np.sin(alpha)
        step = np.zeros((len(joints), 4, 4))
        step[:, 0, :2] = np.stack([c, -s], -1)
        step[:, 1, :2] = np.stack([s * ca, c * ca], -1)
        step[:, 2, :2] = np.stack([s * sa, c * sa], -1)
        step[:, 1:3, 2] = -sa, ca
        step[:, :, 3] = a, -d * sa, d * ca, 1.0
        at = at @ step
        links.append(at)
    return np.stack(links)


def link_tracks(robot: Robot) -> Float64[np.ndarray, "j t 4 4"] | None:
    """World poses of the links if a known arm explains how the gripper moved with the joints, else None.

    Base and tool are found from the recording itself (hand-eye calibration, closed form after Park and
    Martin 1994, then Gauss-Newton); an arm counts as known when it predicts the gripper to GOOD_FIT.
    """
    for arm in KNOWN:
        if robot.joint_positions.shape[1] != len(arm.a) or len(robot.joint_positions) < 10:
            continue
        links = forward(arm, robot.joint_positions)
        base = _base(links[-1], robot.gripper_to_world)
        if base is not None:
            return base @ links
    return None


def _base(
    hand: Float64[np.ndarray, "t 4 4"], gripper: Float64[np.ndarray, "t 4 4"]
) -> Float64[np.ndarray, "4 4"] | None:
    """The arm's base in the world such that base @ hand @ tool is the gripper for a fixed tool."""
    moved, swung = gripper @ geometry.inverse(gripper[:1]), hand @ geometry.inverse(hand[:1])
    left, _, right = np.linalg.svd(_turns(moved).T @ _turns(swung))
    base = np.eye(4)
    base[:3, :3] = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    lever = (moved[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    offset = (swung[:, :3, 3] @ base[:3, :3].T - moved[:, :3, 3]).reshape(-1)
    base[:3, 3] = np.linalg.lstsq(lever, offset, rcond=None)[0]
    tool = geometry.inverse(base @ hand[0]) @ gripper[0]
    for _ in range(12):
        now = _errors(base, hand, tool, gripper)
        columns = []
        for k in range(12):
            nudge = np.zeros(6)
            nudge[k % 6] = 1e-6
            by = geometry.rigid(nudge[:3], nudge[3:])
            then = (by @ base, tool) if k < 6 else (base, tool @ by)
            columns.append((_errors(then[0], hand, then[1], gripper) - now) / 1e-6)
        step = np.linalg.lstsq(np.stack(columns, 1), -now, rcond=1e-9)[0]
        base = geometry.rigid(step[:3], step[3:6]) @ base
        tool = tool @ geometry.rigid(step[6:9], step[9:])
    rms = float(np.sqrt(np.mean(_errors(base, hand, tool, gripper) ** 2)))
    return base if rms < GOOD_FIT else None


def _turns(poses: Float64[np.ndarray, "t 4 4"]) -> Float64[np.ndarray, "t 3"]:
    return np.stack([cv2.Rodrigues(pose[:3, :3])[0][:, 0] for pose in poses])


def _errors(
    base: Float64[np.ndarray, "4 4"],
    hand: Float64[np.ndarray, "t 4 4"],
    tool: Float64[np.ndarray, "4 4"],
    gripper: Float64[np.ndarray, "t 4 4"],
) -> Float64[np.ndarray, "e"]:
    off = geometry.inverse(base @ hand @ tool) @ gripper
    skew = [off[:, 2, 1] - off[:, 1, 2], off[:, 0, 2] - off[:, 2, 0], off[:, 1, 0] - off[:, 0, 1]]
    return np.concatenate([off[:, :3, 3].ravel(), LEVER / 2 * np.concatenate(skew)])
