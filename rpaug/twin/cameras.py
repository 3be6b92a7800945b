"""RLBench's five cameras.

Poses and intrinsics are those stored in the demonstrations of RLBench `open_drawer` (PerAct's data
set), in OpenCV axes: x right, y down, z forward. All are square, look with a field of view of 40
degrees (wrist: 60) across `size` pixels, and state their principal point at size / 2 while their
pixel centres lie at integer coordinates.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from rpaug.core import geometry
from rpaug.core.types import Camera
from rpaug.twin.look import Bump

NAMES = ("front", "left_shoulder", "right_shoulder", "overhead", "wrist")
BUMPED = ("front", "left_shoulder", "right_shoulder")

# Metres. The demonstrations' own values, at which depth images are also quantised.
NEAR = 0.009999999776482582
FAR = {
    "front": 4.5,
    "left_shoulder": 3.200000047683716,
    "right_shoulder": 3.200000047683716,
    "overhead": 3.299999952316284,
    "wrist": 3.5,
}
_FIELD = {name: np.deg2rad(60.0 if name == "wrist" else 40.0) for name in NAMES}  # of view


def _looking(
    position: tuple[float, float, float], heading: float, down: float
) -> Float[np.ndarray, "4 4"]:
    """A level camera that looks `heading` degrees from the world's x axis and `down` degrees below the horizon."""
    a, b = np.deg2rad(heading), np.deg2rad(down)
    pose = np.eye(4)
    pose[:3, 0] = np.sin(a), -np.cos(a), 0
    pose[:3, 2] = np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), -np.sin(b)
    pose[:3, 1] = np.cross(pose[:3, 2], pose[:3, 0])
    pose[:3, 3] = position
    return pose


FIXED = {
    "front": _looking((1.35, 0.0, 1.58), 180, 25),
    "left_shoulder": _looking((-0.175, 0.2, 1.98), -10, 65),
    "right_shoulder": _looking((-0.175, -0.2, 1.98), 10, 65),
    "overhead": _looking((-0.175, 0.0, 2.43), 0, 65),
}

# The wrist camera in the gripper's frame: behind the fingers, tilted by 5 degrees towards them.
_TILT = np.deg2rad(5.0)
WRIST = np.array(
    [
        [0.0, np.cos(_TILT), np.sin(_TILT), -0.050009],
        [-1.0, 0.0, 0.0, 0.002],
        [0.0, -np.sin(_TILT), np.cos(_TILT), -0.092072],
        [0.0, 0.0, 0.0, 1.0],
    ]
)


def intrinsics(name: str, size: int) -> Float[np.ndarray, "3 3"]:
    """K of the camera `name` for images of `size` x `size` pixels."""
    focal = size / 2 / np.tan(_FIELD[name] / 2)
    return np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1]])


def rig(
    gripper_to_world: Float[np.ndarray, "t 4 4"], size: int, bumps: Mapping[str, Bump]
) -> dict[str, Camera]:
    """All five cameras over a motion of the gripper, the wrist's rigid to it, each moved by its bump if it has one."""
    out = {}
    for name in NAMES:
        poses = gripper_to_world @ WRIST if name == "wrist" else FIXED[name]
        if name in bumps:
            bump = bumps[name]
            poses = poses @ geometry.rigid(np.asarray(bump.turn), np.asarray(bump.shift))
        track = np.broadcast_to(poses, gripper_to_world.shape).copy()
        out[name] = Camera(intrinsics(name, size), track, size, size)
    return out
