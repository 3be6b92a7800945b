"""Reads the public sample of a real RLBench recording, for tests that need one."""

import pickle
from functools import lru_cache, partial
from pathlib import Path

import cv2
import numpy as np

from rpaug.types import Camera, CameraView, Episode, Robot

CAMERAS = ("front", "left_shoulder", "right_shoulder", "overhead", "wrist")
FLIP = np.diag([-1.0, -1.0, 1.0, 1.0])  # CoppeliaSim looks along z with x left and y up


class _Plain:
    """Stands in for RLBench's own classes."""


class _Unpickler(pickle.Unpickler):
    allowed = ("numpy.ndarray", "numpy.dtype", "numpy.core.multiarray._reconstruct")

    def find_class(self, module: str, name: str) -> object:
        if module.startswith("rlbench."):
            return _Plain
        if f"{module}.{name}" not in self.allowed:
            raise pickle.UnpicklingError(f"{module}.{name} is not expected in an episode")
        return super().find_class(module.replace("numpy.core", "numpy._core"), name)


def _rgb(folder: Path, camera: str, t: int) -> np.ndarray:
    return cv2.imread(str(folder / f"{camera}_rgb/{t}.png"))[..., ::-1].copy()


def _coded(folder: Path, kind: str, t: int) -> np.ndarray:
    return cv2.imread(str(folder / f"{kind}/{t}.png"))[..., ::-1].astype(np.int64)


def _depth(folder: Path, camera: str, near: float, far: float, t: int) -> np.ndarray:
    code = _coded(folder, f"{camera}_depth", t) @ np.array([65536, 256, 1])
    return (near + code / (2**24 - 1) * (far - near)).astype(np.float32)


def _ids(folder: Path, camera: str, t: int) -> np.ndarray:
    return (_coded(folder, f"{camera}_mask", t) @ np.array([1, 256, 65536])).astype(np.int32)


@lru_cache(maxsize=4)
def read(folder: Path) -> Episode:
    """The RLBench episode in `folder`."""
    with (folder / "low_dim_obs.pkl").open("rb") as stream:
        steps = _Unpickler(stream).load()._observations
    views = {}
    for name in CAMERAS:
        first = steps[0].misc
        K = np.array(first[f"{name}_camera_intrinsics"], float)
        K[[0, 1], [0, 1]] = np.abs(K[[0, 1], [0, 1]])
        poses = np.stack([step.misc[f"{name}_camera_extrinsics"] for step in steps]) @ FLIP
        near, far = first[f"{name}_camera_near"], first[f"{name}_camera_far"]
        height, width = _rgb(folder, name, 0).shape[:2]
        views[name] = CameraView(
            Camera(K, poses, width, height),
            partial(_rgb, folder, name),
            partial(_depth, folder, name, near, far),
            partial(_ids, folder, name),
        )
    robot = Robot(
        np.stack([step.joint_positions for step in steps]),
        np.stack([step.joint_velocities for step in steps]),
        np.stack([step.gripper_matrix for step in steps]),
        np.array([float(step.gripper_open) for step in steps]),
    )
    with (folder / "variation_descriptions.pkl").open("rb") as stream:
        words = tuple(_Unpickler(stream).load())
    return Episode(folder.name, views, robot, words, len(steps))
