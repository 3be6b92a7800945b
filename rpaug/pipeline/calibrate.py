"""`rpaug calibrate`: where fixed cameras stand, by the robot itself: no board, no depth.

The robot's file says where each part of it is at each frame, masks say which pixels show it: recorded ones, or those
that a model finds by words. What comes of it is written as `cameras.yaml`, which adapters read beside a dataset.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jaxtyping import Int32

from rpaug.core import progress
from rpaug.core.errors import BadInput, RpaugError, SourceLacks
from rpaug.core.types import CameraView, Episode
from rpaug.pipeline import prepare
from rpaug.providers.models_settings import Models
from rpaug.scene.instances import by_models
from rpaug.scene.tracking import arms, outline_starts, robot_model
from rpaug.scene.tracking.outline_calibration import CalibratedCamera, calibrate
from rpaug.scene.tracking.outline_pose import OutlinedFrame, OutlineLens


@dataclass(frozen=True)
class CalibratedEpisode:
    """Cameras of an episode that the robot tells, and why others are not told. Poses are in the world that its gripper
    poses are in, or the robot's base where there are none."""

    episode: Episode
    cameras: Mapping[str, CalibratedCamera]
    refused: Mapping[str, str]

    def describe(self) -> dict[str, Any]:
        """Plain values: metres, degrees, pixels."""
        return {
            "episode": self.episode.key,
            "cameras": {name: self._described(name) for name in self.cameras},
            "refused": dict(self.refused),
        }

    def _described(self, name: str) -> dict[str, Any]:
        one, view = self.cameras[name], self.episode.views[name]
        facts: dict[str, Any] = {
            "K": one.lens.K.tolist(),
            "cam_to_world": one.cam_to_world.tolist(),
            "may_be_off": {"metres": one.place, "degrees": float(np.degrees(one.direction))},
            "overlap": one.overlap,
            "frames": one.frames,
            "focal_length_known": one.lens.known,
        }
        if view.camera.placed:
            stated = view.camera.cam_to_world[0]
            facts["from_the_stated"] = {
                "metres": float(np.linalg.norm(stated[:3, 3] - one.cam_to_world[:3, 3])),
                "degrees": float(np.degrees(outline_starts.turn(stated, one.cam_to_world))),
            }
        return facts

    def yaml(self, support: float = 0.0) -> bytes:
        """A `cameras.yaml`, whose world has the support, so many metres up here, at z = 0.

        Raises SourceLacks where the support is elsewhere and gripper poses were recorded: they would stay behind.
        """
        if support and self.episode.robot.gripper_to_world is not None:
            raise SourceLacks(
                f"{self.episode.key}: --support {support:g} would shift the cameras and leave the recorded gripper "
                "poses where they are; expected gripper poses in a world whose support is at z = 0"
            )
        lines, cameras = [], {}
        for name, one in self.cameras.items():
            lines.append(f"# {sentence(name, self._described(name))}")
            pose = one.cam_to_world.copy()
            pose[2, 3] -= support
            cameras[name] = {"K": one.lens.K.tolist(), "cam_to_world": pose.tolist()}
        body = yaml.safe_dump(
            {"version": 1, "cameras": cameras}, default_flow_style=None, width=120
        )
        return ("\n".join(lines) + "\n" + body).encode()


def of_episode(
    episode: Episode, arm: Path, models: Models, words: str = "robot"
) -> CalibratedEpisode:
    """The fixed cameras of an episode, by the arm of a URDF or MJCF file. Raises BadInput, SourceLacks, RpaugError."""
    parts = _posed(episode, arm)
    views = _outlined(episode, arm, models, words)
    cameras, refused = dict[str, CalibratedCamera](), dict[str, str]()
    for name, view in views.items():
        if not view.camera.fixed:
            refused[name] = "it moves"
            continue
        assert view.ids is not None
        masks = [view.ids(t) > 0 for t in range(episode.length)]
        frames = [OutlinedFrame(parts[t], mask) for t, mask in enumerate(masks)]
        lens = OutlineLens(view.camera.K, known=not view.camera.assumed)

        def share(done: float, name: str = name) -> None:
            progress.told(episode.key, f"calibrating {name}, percent", round(100 * done), 100)

        found = calibrate(frames, lens, share)
        if isinstance(found, str):
            refused[name] = found
        else:
            cameras[name] = found
    return CalibratedEpisode(episode, cameras, refused)


def sentence(name: str, facts: Mapping[str, Any]) -> str:
    """What is known of a calibrated camera, for people."""
    off = facts["may_be_off"]
    words = (
        f"{name}: within {1e3 * off['metres']:.1f} mm and {off['degrees']:.2f} degrees ("
        f"{facts['frames']} frames, outlines overlap by {facts['overlap']:.2f})"
    )
    if not facts["focal_length_known"]:
        words += f"; focal length worked out: {facts['K'][0][0]:.0f} px"
    if stated := facts.get("from_the_stated"):
        words += f"; {1e3 * stated['metres']:.1f} mm and {stated['degrees']:.2f} degrees from where the source has it"
    return words


def _posed(episode: Episode, arm: Path) -> list[tuple[tuple[Any, Any], ...]]:
    """By frame the robot's meshes, each with its pose. Raises BadInput, SourceLacks."""
    robot = episode.robot
    joints = robot.joint_positions
    if not joints.shape[1]:
        raise SourceLacks(f"{episode.key}: no recorded joints to move the robot's file by")
    shape = robot_model.read(arm, joints.shape[1])
    if isinstance(shape, str):
        raise BadInput(arm, "arm", found=shape or "no meshes", expected="a file with meshes")
    base, zeros = np.eye(4), np.zeros(joints.shape[1])
    if robot.gripper_to_world is not None:
        if wrong := arms.misfits([arm], robot):
            raise RpaugError(wrong[0])
        base, zeros, _ = arms.calibrated(arms.read(arm, joints.shape[1]), robot)
    poses = base @ shape.forward(joints + zeros)
    return [tuple(zip(shape.meshes, poses[:, t], strict=True)) for t in range(episode.length)]


def _outlined(episode: Episode, arm: Path, models: Models, words: str) -> dict[str, CameraView]:
    """The views with ids that are above 0 where the robot shows. Raises SourceLacks, Unsupported."""
    if models.finds:
        known = by_models.AskedModels(models, (words,)).outlined(episode)
        wanted = frozenset() if known is None else known.names.get(words, frozenset())
        if known is None or not wanted:
            raise SourceLacks(
                f"{episode.key}: the models found no {words!r}; --words names it otherwise"
            )
        return {
            name: _only(view, partial(known.at, name), wanted)
            for name, view in episode.views.items()
        }
    masked = {name: view for name, view in episode.views.items() if view.ids}
    robot = prepare.found_instances(episode, [arm]).roles.get("robot") if masked else None
    if not robot:
        raise SourceLacks(
            f"{episode.key}: nothing outlines the robot: record masks, or name a detector and a segmenter by --models "
            "text=NAME instances=NAME"
        )
    return {name: _only(view, view.ids, robot) for name, view in masked.items() if view.ids}


def _only(
    view: CameraView, ids: Callable[[int], Int32[np.ndarray, "h w"]], wanted: frozenset[int]
) -> CameraView:
    """The view with 1 where these instances are, 0 elsewhere."""
    return replace(view, ids=lambda t: np.isin(ids(t), sorted(wanted)).astype(np.int32))
