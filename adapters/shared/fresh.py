"""What an episode of any source holds, by the names that layouts with named features give it."""

from collections.abc import Callable, Mapping
from itertools import chain, count
from typing import Any

import numpy as np
import yaml
from rpaug_adapters.shared import cameras

from rpaug import Episode, geometry

STATE, ACTION = "observation/state", "action"
JOINTS, VELOCITIES = "observation/joint_positions", "observation/joint_velocities"
RECORDED = "recorded/"  # where a layout with numbers of its own keeps the recorded ones
NEAR = 1e-6  # numbers were float32 on their way
# What RLBench calls numbers that were observed: its names are bare.
OBSERVED = frozenset(
    {"joint_forces", "gripper_joint_positions", "gripper_touch_forces", "task_low_dim_state"}
    | {"ignore_collisions"}
)


def tracks(episode: Episode) -> dict[str, np.ndarray]:
    """All numbers of the robot, one row a step: those that were recorded, by their own names, and what is known beside
    them. Without a recorded action it is where the gripper, or else each joint, is in the next step: position,
    quaternion (x, y, z, w), opening."""
    found = recorded(episode)
    following = np.minimum(np.arange(episode.length) + 1, episode.length - 1)
    known = _known(episode)
    for usual, rows in known.items():
        found.setdefault(_held(found, usual, rows), rows)
    if not any(name.split("/")[0] == ACTION for name in found) and known:
        moving = known.get(STATE, known.get(JOINTS))
        if moving is not None:
            found[ACTION] = moving[following]
    return found


def recorded(episode: Episode) -> dict[str, np.ndarray]:
    """The recorded numbers by names that all layouts share: `observation/` before what was observed, the rest bare."""
    extra = episode.robot.extra
    ours = {name: track for name, track in extra.items() if name.startswith(RECORDED)}
    found = {}
    for name, track in (ours or extra).items():
        rows = np.asarray(track).reshape(episode.length, -1)
        if rows.shape[1]:
            found[_shared(name)] = rows
    return found


def _shared(name: str) -> str:
    name = name.removeprefix(RECORDED)
    for prefix in ("observation.", "observations/", "action."):
        if name.startswith(prefix):
            return f"{prefix[:-1].rstrip('s')}/{name.removeprefix(prefix)}"
    return f"observation/{name}" if name in OBSERVED else name


def _known(episode: Episode) -> dict[str, np.ndarray]:
    """What the episode knows of its robot, by the names it has where no recorded numbers are the same."""
    robot, found = episode.robot, {}
    if robot.joint_positions.shape[1]:
        found[JOINTS] = robot.joint_positions
    if robot.joint_velocities.shape[1]:
        found[VELOCITIES] = robot.joint_velocities
    if robot.gripper_to_world is not None:
        pose = robot.gripper_to_world
        parts = [pose[:, :3, 3], geometry.quaternion_of(pose)]
        if robot.gripper_open is not None:
            parts.append(robot.gripper_open[:, None])
        found[STATE] = np.concatenate(parts, 1)
    return found


def _held(found: Mapping[str, np.ndarray], usual: str, rows: np.ndarray) -> str:
    """The name of the recorded numbers that these are, or a free one like the usual."""
    for name, other in found.items():
        if other.shape == rows.shape:
            if usual == STATE:  # a quaternion and its negative turn alike
                turn = (other[:, 3:7] * rows[:, 3:7]).sum(1, keepdims=True)
                other = np.concatenate(
                    [other[:, :3], other[:, 3:7] * np.sign(turn), other[:, 7:]], 1
                )
            if np.allclose(other, rows, atol=NEAR):
                return name
    names = chain([usual], (f"{usual}_{n}" for n in count(2)))
    return next(name for name in names if name not in found)


def beside(
    episode: Episode,
    named: Callable[[str], str],
    images: Callable[[str], str],
    more: Mapping[str, Any] | None = None,
) -> bytes:
    """What `cameras.yaml` says of the episode: `named` turns a name of `tracks`, `images` one of a camera and `depth`
    or `mask`, into the layout's own. `more` are further keys."""
    given: dict[str, Any] = {"version": 1, "cameras": {}, **(more or {})}
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
    names = {usual: _held(tracks(episode), usual, rows) for usual, rows in _known(episode).items()}
    if STATE in names:
        given["gripper"] = cameras.stated_gripper(episode.robot, named(names[STATE]))
    given |= {
        key: named(names[usual])
        for key, usual in (("joints", JOINTS), ("joint_velocities", VELOCITIES))
        if usual in names
    }
    if episode.rate is not None:
        given["rate"] = episode.rate
    cameras.Beside.model_validate(given)
    return yaml.safe_dump(given, sort_keys=False).encode()
