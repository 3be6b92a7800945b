"""Reading a demonstration: images lazy, a camera's whole dataset decoded once."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import h5py
import numpy as np
from rpaug_adapters.hdf5_sim import layouts, places
from rpaug_adapters.hdf5_sim.layouts import ARM, Demonstration, StoredCamera
from rpaug_adapters.hdf5_sim.places import Place
from rpaug_adapters.shared import cameras, episodes
from rpaug_adapters.shared.cameras import Beside
from rpaug_adapters.shared.hdf5 import dataset, opened
from rpaug_adapters.shared.images import lazy_depth

from rpaug import BadInput, Camera, CameraView, Episode, Robot, geometry

# Names of the robot's numbers: robosuite's, LIBERO's, ManiSkill's.
JOINTS = ("robot0_joint_pos", "joint_states", "agent/qpos")
VELOCITIES = ("robot0_joint_vel", "agent/qvel")
ROUNDING = 0.75  # levels: half a one of the dimmed image, and a part of one of the color
SECOND = "observation/robot1_joint_pos"


@dataclass(frozen=True)
class SimSource:
    """What a demonstration was read from: its datasets, by view, its views, and what lies beside it."""

    demo: Demonstration
    stored: dict[str, StoredCamera]
    views: dict[str, CameraView]
    beside: Beside


def read_episode(root: Path, key: str) -> Episode:
    """The demonstration of a key. Raises BadInput."""
    place, own = places.find(root, key), root / key
    beside = cameras.load(root, (own, own.parent, own.parent.parent))
    with opened(place.path, place.within) as file:
        demo = layouts.demo(place, file)
        stored = {
            name: _beside(place, file, beside, name, one)
            for name, one in cameras.chosen(beside, demo.stored, demo.stored).items()
        }
        sizes = {}
        for name, one in stored.items():
            _, height, width, _ = file[place.group][one.color].shape
            sizes[name] = width, height

    def view(name: str, camera: Camera) -> CameraView:
        if name not in beside.cameras and (own_name := stored[name].camera) in demo.own.cameras:
            camera = cameras.camera(demo.own, own_name, sizes[name], demo.length, demo.tracks)
        return _view(demo, stored[name], camera)

    made = episodes.episode(
        key, beside, sizes, demo.tracks, demo.length, demo.words, view,
        lambda views: SimSource(demo, stored, views, beside),
    )  # fmt: skip
    rate = made.rate if made.rate is not None else demo.rate
    return replace(made, robot=_robot(made.robot, demo), rate=rate, unread=demo.unread)


def _beside(
    place: Place, file: h5py.File, beside: Beside, name: str, found: StoredCamera
) -> StoredCamera:
    """A camera's datasets with those of depth and ids that the side file names. Raises BadInput."""
    given = beside.cameras.get(name)
    named = {} if given is None else {"depth": given.depth, "ids": given.ids}
    named = {which: one for which, one in named.items() if one is not None}
    held = {one: dataset(place.path, file, f"{place.group}/{one}") for one in named.values()}
    for which, one in named.items():
        color, kinds = file[place.group][found.color], "iu" if which == "ids" else "iuf"
        if not layouts.like(held, one, color, kinds):
            expected = f"one number a pixel of {found.color}"
            raise BadInput(beside.where, f"cameras.{name}.{which}", found=one, expected=expected)
    if given is not None and "depth" in named:
        found = replace(found, metres=given.metres)
    return replace(found, **named)


def frames(demo: Demonstration, name: str) -> Callable[[int], np.ndarray]:
    """The images of a dataset, upright, those that have one value a pixel without a third axis."""

    @cache
    def whole() -> np.ndarray:
        with opened(demo.place.path, demo.place.within) as file:
            held = dataset(demo.place.path, file, f"{demo.place.group}/{name}")[()]
            if demo.following:
                later = dataset(demo.place.path, file, f"{demo.place.group}/next_{name}")
                held = np.concatenate([held, later[-1:]])
        held = held[:, ::-1] if demo.flipped else held
        return held[..., 0] if held.shape[3:] == (1,) else held

    return lambda t: np.ascontiguousarray(whole()[t])


def _view(demo: Demonstration, stored: StoredCamera, camera: Camera) -> CameraView:
    depth = stored.depth and lazy_depth(frames(demo, stored.depth), stored.metres)
    ids = stored.ids and _ids(frames(demo, stored.ids))
    color = frames(demo, stored.color)
    radiance = stored.dimmed and _radiance(color, frames(demo, stored.dimmed), stored.light)
    return CameraView(camera, color, depth or None, ids or None, radiance=radiance or None)


def _radiance(
    color: Callable[[int], np.ndarray], dimmed: Callable[[int], np.ndarray], light: float
) -> Callable[[int], np.ndarray]:
    """The color, and what the dimmed one tells where it tells of more than its own rounding."""

    def at(t: int) -> np.ndarray:
        plain, told = color(t) / np.float32(255), dimmed(t) / np.float32(255 * light)
        return np.where(told > plain + ROUNDING / np.float32(255 * light), told, plain)

    return at


def _ids(stored: Callable[[int], np.ndarray]) -> Callable[[int], np.ndarray]:
    return lambda t: stored(t).astype(np.int32)


def _robot(given: Robot, demo: Demonstration) -> Robot:
    """The robot by the names that the projects give its numbers; of two arms the joints alone."""
    tracks, made = demo.tracks, given
    joints, speeds = _among(tracks, JOINTS), _among(tracks, VELOCITIES)
    if SECOND in tracks and joints is not None:
        joints, speeds = np.concatenate([joints, tracks[SECOND]], 1), None
    if not given.joint_positions.shape[1] and joints is not None:
        made = replace(made, joint_positions=joints)
    if not given.joint_velocities.shape[1] and speeds is not None:
        made = replace(made, joint_velocities=speeds)
    if given.gripper_to_world is None and SECOND not in tracks:
        made = replace(made, gripper_to_world=_gripper(tracks), gripper_open=_opening(tracks))
    return made


def _among(tracks: Mapping[str, np.ndarray], names: tuple[str, ...]) -> np.ndarray | None:
    return next(
        (tracks[f"observation/{name}"] for name in names if f"observation/{name}" in tracks), None
    )


def _gripper(tracks: Mapping[str, np.ndarray]) -> np.ndarray | None:
    def parts(*names: str) -> list[np.ndarray] | None:
        held = [tracks.get(f"observation/{name}") for name in names]
        return None if any(one is None for one in held) else held  # type: ignore[return-value]

    if held := parts("robot0_eef_pos", "robot0_eef_quat"):
        return _pose(held[0], held[1])
    if (held := parts("extra/tcp_pose")) and held[0].shape[1:] == (7,):  # ManiSkill: w first
        return _pose(held[0][:, :3], np.roll(held[0][:, 3:], -1, 1))
    if (held := parts("ee_pos", "ee_ori")) and held[0].shape[1:] == held[1].shape[1:] == (3,):
        return np.stack([_turned(*row) for row in zip(*held, strict=True)])
    return None


def _pose(position: np.ndarray, quaternion: np.ndarray) -> np.ndarray | None:
    """Poses, None where these are no positions and rotations."""
    shapes = position.shape[1:] == (3,) and quaternion.shape[1:] == (4,)
    if not shapes or not (np.linalg.norm(quaternion, axis=1) > 0).all():
        return None
    return geometry.pose_of(position, quaternion)


def _turned(position: np.ndarray, turn: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = geometry.rotation(turn), position
    return pose


def _opening(tracks: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Whether the gripper was told to be open, 1, or shut, 0, as robosuite's single arms are told."""
    action = tracks.get("action")
    jaws = _among(tracks, ("robot0_gripper_qpos", "gripper_states"))
    if action is None or jaws is None or action.shape[1:] != (ARM,):
        return None
    return (action[:, -1] <= 0).astype(np.float64)
