"""The Franka Panda arm: its true kinematics, in shapes of our own."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rpaug.core import geometry
from rpaug.twin.world import Geom, Part, TwinBody, Vector

# Craig's modified Denavit-Hartenberg parameters a, d (metres), alpha (radians) of joints 1 to 7,
# the flange's distance, the hand's turn and the tip's distance: Franka Control Interface
# documentation, "Robot and interface specifications". RLBench's tip frame is turned by another pi
# about the approach axis (fitted to recorded demos).
DH = (
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -np.pi / 2),
    (0.0, 0.316, np.pi / 2),
    (0.0825, 0.0, np.pi / 2),
    (-0.0825, 0.384, -np.pi / 2),
    (0.0, 0.0, np.pi / 2),
    (0.088, 0.0, np.pi / 2),
)
FLANGE = 0.107
TIP = 0.1034
HAND_TURN = 3 * np.pi / 4
LOWEST = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])
HIGHEST = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])
HOME = np.array([0.0, 0.1751, 0.0, -0.8732, 0.0, 1.2215, np.pi / 4])
OPEN = 0.04  # metres each finger stands from the middle when the gripper is open

FINGER_END, FINGER_HALF = (
    0.009,
    0.010,
)  # metres: the finger ends below the tip, half a finger's width

_SHELL: Vector = (0.88, 0.88, 0.9)
_JOINT: Vector = (0.32, 0.33, 0.36)
_RUBBER: Vector = (0.16, 0.16, 0.18)


@dataclass(frozen=True)
class Panda:
    """A Panda whose base stands at `base` (4 x 4, to the world)."""

    base: Float[np.ndarray, "4 4"]

    def links(self, q: Float[np.ndarray, "7"]) -> Float[np.ndarray, "7 4 4"]:
        """Where the frames of links 1 to 7 are in the world."""
        pose, poses = self.base, []
        for origin, angle in zip(_ORIGINS, q, strict=True):
            pose = pose @ origin @ _turn(angle)
            poses.append(pose)
        return np.array(poses)

    def tip(self, q: Float[np.ndarray, "7"]) -> Float[np.ndarray, "4 4"]:
        """RLBench's gripper pose: between the finger tips, z the approach, y the way the fingers open."""
        return self.links(q)[-1] @ HAND @ _lift(TIP)

    def jacobian(self, q: Float[np.ndarray, "7"]) -> Float[np.ndarray, "6 7"]:
        """Velocity and turning rate of the tip, in the world, per joint rate."""
        links, tip = self.links(q), self.tip(q)
        axes = links[:, :3, 2]
        return np.vstack([np.cross(axes, tip[:3, 3] - links[:, :3, 3]).T, axes.T])

    def solve(
        self, target: Float[np.ndarray, "4 4"], start: Float[np.ndarray, "7"]
    ) -> Float[np.ndarray, "7"]:
        """Joint angles that put the tip at `target` to 1e-9, near `start`: damped least squares.

        While far off, the spare joint is drawn towards the home posture. Raises ValueError out of
        reach.
        """
        q = start.copy()
        for _ in range(300):
            error = _difference(self.tip(q), target)
            far = float(np.linalg.norm(error))
            if far < 1e-10:
                break
            jacobian = self.jacobian(q)
            damped = jacobian @ jacobian.T + min(1e-3, far**2) * np.eye(6)
            back = np.linalg.solve(damped, jacobian).T
            pull = min(0.05, far) * (HOME - q)
            step = back @ error + pull - back @ (jacobian @ pull)
            q = np.clip(q + step * min(1.0, 0.2 / np.abs(step).max()), LOWEST, HIGHEST)
        if np.linalg.norm(_difference(self.tip(q), target)) > 1e-9:
            raise ValueError(f"the arm cannot reach {target[:3, 3].round(3).tolist()}")
        return q


def bodies(base: Float[np.ndarray, "4 4"]) -> tuple[TwinBody, ...]:
    """The base, seven links, the hand and two fingers; one part, hence one handle, each."""
    out = [TwinBody("link0", (Part("link0", _BASE),), base)]
    for number, (origin, geoms) in enumerate(zip(_ORIGINS, _LINKS, strict=True), start=1):
        part = Part(f"link{number}", geoms)
        out.append(TwinBody(part.name, (part,), origin, f"link{number - 1}", ("hinge", (0, 0, 1))))
    out.append(TwinBody("hand", (Part("hand", _HAND),), HAND, "link7"))
    for name, side in (("finger_left", 1.0), ("finger_right", -1.0)):
        finger = (
            Geom("box", (0.010, 0.006, 0.016), (0, side * 0.009, 0.016), color=_SHELL),
            Geom("box", (0.009, 0.006, 0.014), (0, side * 0.006, 0.040), color=_RUBBER),
        )
        out.append(
            TwinBody(name, (Part(name, finger),), _lift(0.0584), "hand", ("slide", (0, side, 0)))
        )
    return tuple(out)


def _joint_origin(a: float, d: float, alpha: float) -> Float[np.ndarray, "4 4"]:
    """The frame of a joint at angle 0 in the frame of the one before."""
    return geometry.rigid(np.array([alpha, 0, 0]), np.array([a, 0, 0])) @ _lift(d)


def _turn(angle: float) -> Float[np.ndarray, "4 4"]:
    pose, sine, cosine = np.eye(4), np.sin(angle), np.cos(angle)
    pose[:2, :2] = (cosine, -sine), (sine, cosine)
    return pose


def _lift(distance: float) -> Float[np.ndarray, "4 4"]:
    return geometry.rigid(np.zeros(3), np.array([0, 0, distance]))


def _difference(
    pose: Float[np.ndarray, "4 4"], target: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "6"]:
    """Shift and rotation vector, in the world, that carry `pose` onto `target`."""
    turn = target[:3, :3] @ pose[:3, :3].T
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    sine, cosine = np.linalg.norm(axis) / 2, (np.trace(turn) - 1) / 2
    scale = np.arctan2(sine, cosine) / (2 * sine) if sine > 1e-9 else 0.5
    return np.concatenate([target[:3, 3] - pose[:3, 3], scale * axis])


_ORIGINS = tuple(_joint_origin(*step) for step in DH)
HAND = _lift(FLANGE) @ _turn(HAND_TURN)


def _tube(radius: float, start: Vector, end: Vector, color: Vector = _SHELL) -> Geom:
    return Geom("capsule", (radius,), start, end, color)


def _drum(radius: float, start: Vector, end: Vector, color: Vector = _JOINT) -> Geom:
    return Geom("cylinder", (radius,), start, end, color)


_BASE = (
    _drum(0.095, (-0.02, 0, 0), (-0.02, 0, 0.05)),
    _drum(0.078, (0, 0, 0.05), (0, 0, 0.14), _SHELL),
)
_LINKS = (
    (_tube(0.066, (0, 0, -0.15), (0, 0, -0.02)), _drum(0.067, (0, -0.07, 0), (0, 0.07, 0))),
    (_tube(0.060, (0, -0.02, 0), (0, -0.19, 0)),),
    (
        _drum(0.058, (0, 0, -0.125), (0, 0, -0.095)),
        _tube(0.054, (0, 0, -0.08), (0.0825, 0, 0)),
        _drum(0.056, (0.0825, -0.06, 0), (0.0825, 0.06, 0)),
    ),
    (_tube(0.052, (0, 0, 0), (-0.0825, 0.10, 0)),),
    (
        _drum(0.053, (0, 0, -0.28), (0, 0, -0.25)),
        _tube(0.046, (0, 0, -0.24), (0, 0.02, -0.06)),
        _drum(0.048, (0, -0.055, 0), (0, 0.055, 0)),
    ),
    (_tube(0.046, (0, 0, 0), (0.07, 0, 0)),),
    (
        _drum(0.050, (0, 0, -0.055), (0, 0, 0.055)),
        _drum(0.040, (0, 0, 0.055), (0, 0, FLANGE), _SHELL),
    ),
)
_HAND = (
    Geom("box", (0.020, 0.095, 0.024), (0, 0, 0.028), color=_SHELL),
    Geom("box", (0.016, 0.085, 0.006), (0, 0, 0.054), color=_JOINT),
)
