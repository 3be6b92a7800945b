"""Where an arm's links are, from the joints it recorded: of arms whose measures are known, or that a file describes."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol
from xml.etree import ElementTree

import cv2
import numpy as np
from jaxtyping import Float64

from rpaug.core import geometry, simulation
from rpaug.core.errors import BadInput
from rpaug.core.files import read_bytes
from rpaug.core.types import Robot
from rpaug.scene.tracking import urdf

GOOD_FIT = 0.004  # metres, rms: simulated arms give way by half a millimetre
HELD = 0.01  # metres per radian: how firmly the joints' zeros are kept where the motion does not tell them
ROUNDS = 20
LEAST_FRAMES = 10  # fewer do not tell where an arm stands
LEVER = 0.3  # metres: how far off a radian of gripper error is felt


class Kinematics(Protocol):
    """Anything that says where links are: `forward` gives each link's pose in the arm's base, over time.

    The last of the `joints` links is the one that the gripper hangs on.
    """

    @property
    def joints(self) -> int: ...

    def forward(self, joints: Float64[np.ndarray, "t j"]) -> Float64[np.ndarray, "j t 4 4"]: ...


@dataclass(frozen=True)
class Arm:
    """Modified Denavit-Hartenberg measures (Craig 1986), one entry a joint, in metres and radians."""

    a: tuple[float, ...]
    d: tuple[float, ...]
    alpha: tuple[float, ...]

    @property
    def joints(self) -> int:
        return len(self.a)

    def forward(self, joints: Float64[np.ndarray, "t j"]) -> Float64[np.ndarray, "j t 4 4"]:
        """Pose of every link in the arm's base, over time."""
        at = np.tile(np.eye(4), (len(joints), 1, 1))
        links = []
        for i, (a, d, alpha) in enumerate(zip(self.a, self.d, self.alpha, strict=True)):
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


@dataclass(frozen=True)
class Modelled:
    """An arm as MuJoCo reads it from an MJCF file: its first `joints` joints, in the file's order."""

    model: Any
    joints: int

    def forward(self, joints: Float64[np.ndarray, "t j"]) -> Float64[np.ndarray, "j t 4 4"]:
        """Pose of the body that each joint moves, in the model's world, over time."""
        mujoco = simulation.mujoco()

        data, out = mujoco.MjData(self.model), np.tile(np.eye(4), (self.joints, len(joints), 1, 1))
        address, body = (
            array[: self.joints] for array in (self.model.jnt_qposadr, self.model.jnt_bodyid)
        )
        for t, values in enumerate(joints):
            data.qpos[address] = values
            mujoco.mj_kinematics(self.model, data)
            out[:, t, :3, :3] = data.xmat[body].reshape(-1, 3, 3)
            out[:, t, :3, 3] = data.xpos[body]
        return out


def read(path: Path, joints: int) -> Kinematics:
    """The arm of a URDF or MJCF file, whose first `joints` joints are the recorded ones.

    Of a URDF only joints are read: its meshes and masses may be missing. Raises BadInput for what is no such file or
    has too few joints, or ones that neither turn nor slide.
    """
    data = read_bytes(path)
    try:
        root = ElementTree.fromstring(data)  # resolves no external entities
    except ElementTree.ParseError as error:
        given = f"no XML: {error}"
        raise BadInput(path, "arm", found=given, expected="a URDF or MJCF file") from None
    if root.tag == "robot":
        return urdf.read(path, root, joints)
    if root.tag != "mujoco":
        raise BadInput(path, "arm", found=f"<{root.tag}>", expected="a URDF or MJCF file")
    return _modelled(path, joints)


def _modelled(path: Path, joints: int) -> Modelled:
    mujoco = simulation.mujoco()

    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        given = " ".join(str(error).split())
        raise BadInput(
            path, "arm", found=given, expected="an MJCF file that MuJoCo opens"
        ) from None
    simple = [int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)]
    if model.njnt < joints or not np.isin(model.jnt_type[:joints], simple).all():
        found = f"{model.njnt} joints, types {model.jnt_type.tolist()}"
        raise BadInput(path, "arm", found=found, expected=f"{joints} that turn or slide, first")
    return Modelled(model, joints)


HALF = np.pi / 2
PANDA = Arm(  # Franka Emika, "Robot and interface specifications"
    a=(0.0, 0.0, 0.0, 0.0825, -0.0825, 0.0, 0.088),
    d=(0.333, 0.0, 0.316, 0.0, 0.384, 0.0, 0.0),
    alpha=(0.0, -HALF, HALF, HALF, -HALF, HALF, HALF),
)
KNOWN = (PANDA,)


def for_robot(paths: Sequence[Path], robot: Robot) -> tuple[Kinematics, ...]:
    """The arms whose links are looked for: those of the files, then those whose measures are known.

    Raises BadInput for a file that is wrong, and for one given where no joints were recorded to move it by.
    """
    joints = robot.joint_positions.shape[1]
    if paths and not joints:
        raise BadInput(
            paths[0], "arm", found="no recorded joints", expected="an episode with joints"
        )
    return (*(read(path, joints) for path in paths), *KNOWN)


def misfits(paths: Sequence[Path], robot: Robot) -> tuple[str, ...]:
    """What is to be said of the files whose arms do not explain how the gripper moved: their links are not used."""
    given = []
    for path, arm in zip(paths, for_robot(paths, robot), strict=False):
        if robot.gripper_to_world is None or len(robot.joint_positions) < LEAST_FRAMES:
            why = f"there are no gripper poses, or fewer than {LEAST_FRAMES} frames, to check it by"
        else:
            off = calibrated(arm, robot)[2]
            if off < GOOD_FIT:
                continue
            why = f"its gripper is {1e3 * off:.0f} mm off (at most {1e3 * GOOD_FIT:.0f})"
        given.append(f"{path.name}: this arm is not used: {why}")
    return tuple(given)


def link_tracks(
    robot: Robot, known: Sequence[Kinematics] = KNOWN
) -> Float64[np.ndarray, "j t 4 4"] | None:
    """World poses of the links if a known arm explains how the gripper moved with the joints, else None.

    Base, tool and the joints' zeros are found from the recording itself (hand-eye calibration, closed form
    after Park and Martin 1994, then Gauss-Newton); an arm counts as known when it predicts the gripper to
    GOOD_FIT.
    """
    if robot.gripper_to_world is None:
        return None
    for arm in known:
        if robot.joint_positions.shape[1] != arm.joints:
            continue
        if len(robot.joint_positions) < LEAST_FRAMES:
            continue
        base, zeros, rms = calibrated(arm, robot)
        if rms < GOOD_FIT:
            return base @ arm.forward(robot.joint_positions + zeros)
    return None


def calibrated(
    arm: Kinematics, robot: Robot
) -> tuple[Float64[np.ndarray, "4 4"], Float64[np.ndarray, "j"], float]:
    """The arm's base, what to add to its joint readings, and how far the gripper is then off (rms, metres)."""
    joints, gripper = robot.joint_positions, robot.gripper_to_world
    assert gripper is not None
    zeros = np.zeros(arm.joints)
    base = _first_base(arm.forward(joints)[-1], gripper)
    tool = geometry.inverse(base @ arm.forward(joints[:1])[-1][0]) @ gripper[0]

    def errors(x: Float64[np.ndarray, "p"]) -> Float64[np.ndarray, "e"]:
        at, grip = geometry.rigid(x[:3], x[3:6]) @ base, tool @ geometry.rigid(x[6:9], x[9:12])
        held = HELD * (zeros + x[12:])
        return np.concatenate(
            [_errors(at, arm.forward(joints + zeros + x[12:])[-1], grip, gripper), held]
        )

    still = np.zeros(12 + arm.joints)
    for _ in range(ROUNDS):
        now = errors(still)
        nudges = 1e-6 * np.eye(len(still))
        J = np.stack([(errors(nudge) - now) / 1e-6 for nudge in nudges], 1)
        step = np.linalg.lstsq(J, -now, rcond=1e-9)[0]
        base, tool = (
            geometry.rigid(step[:3], step[3:6]) @ base,
            tool @ geometry.rigid(step[6:9], step[9:12]),
        )
        zeros = zeros + step[12:]
        if np.abs(step).max() < 1e-6:
            break
    rms = float(np.sqrt(np.mean(errors(still)[: -len(zeros)] ** 2)))
    return base, zeros, rms


def _first_base(
    hand: Float64[np.ndarray, "t 4 4"], gripper: Float64[np.ndarray, "t 4 4"]
) -> Float64[np.ndarray, "4 4"]:
    """About where the base is, such that base @ hand @ tool is the gripper for a fixed tool."""
    moved, swung = gripper @ geometry.inverse(gripper[:1]), hand @ geometry.inverse(hand[:1])
    left, _, right = np.linalg.svd(_turns(moved).T @ _turns(swung))
    base = np.eye(4)
    base[:3, :3] = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    lever = (moved[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    offset = (swung[:, :3, 3] @ base[:3, :3].T - moved[:, :3, 3]).reshape(-1)
    base[:3, 3] = np.linalg.lstsq(lever, offset, rcond=None)[0]
    return base


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
