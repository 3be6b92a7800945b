"""What an episode of any source holds, by the names that layouts with named features give it."""

from collections.abc import Callable
from typing import Any

import numpy as np
import yaml
from rpaug_adapters.shared import cameras

from rpaug import Episode, geometry

STATE = "observation/state"


def tracks(episode: Episode) -> dict[str, np.ndarray]:
    """All numbers of the robot, one row a step. The action is where the gripper, or else each joint, is in the next
    step: position, quaternion (x, y, z, w), opening."""
    robot, found = episode.robot, {}
    following = np.minimum(np.arange(episode.length) + 1, episode.length - 1)
    if robot.joint_positions.shape[1]:
        found["observation/joint_positions"] = robot.joint_positions
        still = np.zeros_like(robot.joint_positions)
        found["observation/joint_velocities"] = (
            robot.joint_velocities if robot.joint_velocities.shape[1] else still
        )
    if robot.gripper_to_world is not None:
        pose = robot.gripper_to_world
        parts = [pose[:, :3, 3], geometry.quaternion_of(pose)]
        if robot.gripper_open is not None:
            parts.append(robot.gripper_open[:, None])
        found[STATE] = np.concatenate(parts, 1)
        found["action"] = found[STATE][following]
    for name, track in robot.extra.items():
        rows = np.asarray(track).reshape(episode.length, -1)
        if rows.shape[1]:
            found.setdefault(
                name if name == "action" else f"observation/{name.rpartition('/')[2]}", rows
            )
    return found


def beside(episode: Episode, named: Callable[[str], str], images: Callable[[str], str]) -> bytes:
    """What `cameras.yaml` says of the episode: `named` turns a name of `tracks`, `images` one of a camera and `depth`
    or `mask`, into the layout's own."""
    given: dict[str, Any] = {"version": 1, "cameras": {}}
    for name, view in episode.views.items():
        camera = view.camera
        if camera.assumed:
            continue
        entry = cameras.stated_camera(camera)
        if view.depth is not None:
            entry["depth"] = images(f"{name}_depth")
        if view.ids is not None:
            entry["ids"] = images(f"{name}_mask")
        given["cameras"][name] = entry
    robot = episode.robot
    if robot.gripper_to_world is not None:
        given["gripper"] = cameras.stated_gripper(robot, named(STATE))
    if robot.joint_positions.shape[1]:
        given["joints"] = named("observation/joint_positions")
        given["joint_velocities"] = named("observation/joint_velocities")
    cameras.Beside.model_validate(given)
    return yaml.safe_dump(given, sort_keys=False).encode()
