"""`cameras.yaml`: what records say nothing about, cameras and the robot's own numbers, said beside them.

It lies beside the dataset's files or above them, up to the root (for all episodes), or in an episode's own folder (for
that one, as rpaug writes it where a camera was moved). Keys are the names of an episode's features, as the adapter
calls them.
"""

from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
import yaml
from jaxtyping import Float64
from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, model_validator
from rpaug_adapters.shared.texts import read_yaml, stamp

from rpaug import BadInput, Camera, CameraView, Episode, Robot, files, geometry

NAME = "cameras.yaml"
FOCAL = 1.2  # longest sides: what COLMAP assumes of an unknown camera
MOST = 10**6  # values in the file
LARGEST = 2**22  # bytes: a track of ten thousand poses is smaller
Name = Annotated[str, Field(min_length=1)]
Named = TypeVar("Named")
Row = Annotated[list[float], Field(min_length=3, max_length=4)]


class StrictModel(BaseModel):
    """Strict: a misspelt key is an error."""

    model_config = ConfigDict(extra="forbid")


class Calibration(StrictModel):
    """One camera. `K` is in pixels, centres at integer coordinates; poses are camera to world, OpenCV axes, metres."""

    K: list[Row] | None = None
    field_of_view: float | None = Field(
        default=None, gt=0, lt=180, description="horizontal, degrees"
    )
    cam_to_world: list[Any] | None = None
    pose_key: Name | None = None
    depth: Name | None = None
    ids: Name | None = Field(default=None, description="instance handles, a whole number a pixel")
    metres: float = Field(
        default=1.0, gt=0, allow_inf_nan=False, description="of one unit of depth"
    )

    @model_validator(mode="after")
    def _once(self) -> "Calibration":
        if (self.K is None) == (self.field_of_view is None):
            raise ValueError("give one of K and field_of_view")
        if self.cam_to_world is not None and self.pose_key is not None:
            raise ValueError("give one of cam_to_world and pose_key")
        if self.K is not None and not _pinhole(self.K):
            raise ValueError("K is 3 rows of 3 finite numbers, focal lengths above 0")
        return self

    def intrinsics(self, width: int, height: int) -> Float64[np.ndarray, "3 3"]:
        """K in pixels; with a field of view the axis goes through the middle of the image."""
        if self.K is not None:
            return np.array(self.K, float)
        assert self.field_of_view is not None
        focal = width / 2 / np.tan(np.radians(self.field_of_view) / 2)
        return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])


def _pinhole(rows: list[Row]) -> bool:
    if [len(row) for row in rows] != [3, 3, 3]:
        return False
    K = np.array(rows, float)
    return bool(np.isfinite(K).all() and K[0, 0] > 0 and K[1, 1] > 0 and K[2, 2] == 1)


class Gripper(StrictModel):
    """Which numbers are the gripper's pose and opening. Euler angles turn about the fixed x, then y, then z."""

    key: str
    position: tuple[int, int, int] = (0, 1, 2)
    rotation: tuple[int, ...] = (3, 4, 5)
    convention: Literal["euler_xyz", "quaternion_xyzw", "quaternion_wxyz"] = "euler_xyz"
    opening: int | None = 6


class Beside(StrictModel):
    """All of the file."""

    version: Literal[1] = 1
    cameras: dict[str, Calibration] = {}
    gripper: Gripper | None = None
    joints: Name | None = None
    joint_velocities: Name | None = None
    language: Name | list[Name] | None = None
    rate: float | None = Field(
        default=None, gt=0, lt=100_000, allow_inf_nan=False, description="frames a second"
    )
    images: dict[Name, Name] = Field(default={}, description="features of color, by their views")
    views: list[str] | None = None
    _where: Path = PrivateAttr(Path(NAME))

    @property
    def where(self) -> Path:
        """The file that says all this."""
        return self._where


_NOTHING = Beside()


def load(root: Path, folders: tuple[Path, ...]) -> Beside:
    """The first `cameras.yaml` in these folders, else in those above the last one, up to the dataset's root, or an
    empty one; some layouts look above the root too. Raises BadInput."""
    above = nearest(root, folders[-1])
    for path in (*(folder / NAME for folder in folders), *([above] if above else [])):
        if any(at := stamp(path)):
            if path.is_relative_to(root):
                files.see_inside(root, path)
            return _parsed(path, *at)
    return _NOTHING


def nearest(root: Path, folder: Path) -> Path | None:
    """The `cameras.yaml` in a folder, or in the nearest above it up to the dataset's root; None where there is none."""
    above = (one for one in (folder, *folder.parents) if one.is_relative_to(root))
    return next((one / NAME for one in above if any(stamp(one / NAME))), None)


def brought(beside: Beside) -> dict[str, bytes]:
    """The side file as it is, to be laid with a copy; nothing where there is none."""
    return {} if beside is _NOTHING else {NAME: files.read_bytes(beside.where)}


@lru_cache(16)
def _parsed(path: Path, _modified: int, size: int) -> Beside:
    if size > LARGEST:
        raise BadInput(path, "size", found="more than 4 MiB", expected="a list of cameras")
    given = read_yaml(path, Beside, MOST)
    given._where = path
    return given


def known(beside: Beside, field: str, name: str, among: Iterable[str]) -> None:
    """See that a name in the side file is one of the episode's. Raises BadInput."""
    if name not in (held := sorted(among)):
        raise BadInput(beside.where, field, found=name, expected=f"one of: {', '.join(held)}")


def chosen(
    beside: Beside, found: Mapping[str, Named], among: Mapping[str, Named]
) -> dict[str, Named]:
    """Features of color by view: those `found`, as the side file names and picks them `among` all. Raises BadInput."""
    views = dict(found)
    for name, key in beside.images.items():
        known(beside, f"images.{name}", key, among)
        views = {n: one for n, one in views.items() if one != among[key]} | {name: among[key]}
    if beside.views is not None:
        for name in beside.views:
            known(beside, f"views, {name}", name, views)
        views = {name: views[name] for name in beside.views}
    for name in beside.cameras:
        known(beside, f"cameras.{name}", name, views)
    return dict(sorted(views.items()))


def camera(
    beside: Beside,
    name: str,
    size: tuple[int, int],
    length: int,
    tracks: Mapping[str, Float64[np.ndarray, "t k"]],
) -> Camera:
    """A view's camera as told, its poses from the file or one of the `tracks`; else a stand-in. Raises BadInput."""
    width, height = size
    given = beside.cameras.get(name)
    if given is None:
        focal = FOCAL * max(size)
        K = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
        return Camera(K, np.tile(np.eye(4), (length, 1, 1)), width, height, assumed=True)
    values: Any = given.cam_to_world
    if given.pose_key is not None:
        known(beside, f"cameras.{name}.pose_key", given.pose_key, tracks)
        values = tracks[given.pose_key]
    track = _poses(beside.where, f"cameras.{name}", values, length)
    return Camera(given.intrinsics(width, height), track, width, height, unplaced=values is None)


def _poses(where: Path, field: str, values: Any, length: int) -> Float64[np.ndarray, "t 4 4"]:
    if values is None:
        return np.tile(np.eye(4), (length, 1, 1))
    try:
        track = np.asarray(values, float)
        if track.shape[1:] == (6,):  # as DROID gives them
            track = euler_pose(track[:, :3], track[:, 3:])
        track = track.reshape((-1, 4, 4) if track.size % 16 == 0 else (-1, 3, 4))
    except (TypeError, ValueError, OverflowError):
        raise BadInput(where, field, found="no matrices", expected="4x4 or 3x4") from None
    if track.shape[1] == 3:
        last = np.broadcast_to([[[0.0, 0, 0, 1]]], (len(track), 1, 4))
        track = np.concatenate([track, last], 1)
    if len(track) not in (1, length):
        raise BadInput(where, field, found=f"{len(track)} poses", expected=f"1 or {length}")
    turn = track[:, :3, :3]
    finite = bool(np.isfinite(track).all()) and np.abs(turn).max() < 2
    proper = finite and np.abs(turn @ turn.swapaxes(1, 2) - np.eye(3)).max() < 1e-3
    if not (proper and (np.linalg.det(turn) > 0).all()):
        raise BadInput(where, field, found="no rigid motion", expected="a rotation, metres")
    return np.repeat(track, length, 0) if len(track) == 1 else track


def robot(beside: Beside, tracks: Mapping[str, Float64[np.ndarray, "t k"]], length: int) -> Robot:
    """What is told of the robot, and all numbers of the episode by their names. Raises BadInput."""
    joints, velocities = np.zeros((length, 0)), np.zeros((length, 0))
    if beside.joints is not None:
        known(beside, "joints", beside.joints, tracks)
        joints = tracks[beside.joints]
    if beside.joint_velocities is not None:
        known(beside, "joint_velocities", beside.joint_velocities, tracks)
        velocities = tracks[beside.joint_velocities]
    pose, opening = None, None
    if beside.gripper is not None:
        known(beside, "gripper.key", beside.gripper.key, tracks)
        pose, opening = _gripper(beside, beside.gripper, tracks[beside.gripper.key])
    return Robot(joints, velocities, pose, opening, tracks)


def _gripper(
    beside: Beside, given: Gripper, state: Float64[np.ndarray, "t k"]
) -> tuple[Float64[np.ndarray, "t 4 4"], Float64[np.ndarray, "t"] | None]:
    columns = [
        *given.position,
        *given.rotation,
        *([] if given.opening is None else [given.opening]),
    ]
    wanted = 3 if given.convention == "euler_xyz" else 4
    if not all(0 <= c < state.shape[1] for c in columns) or len(given.rotation) != wanted:
        found = f"columns {columns} of {state.shape[1]}, {len(given.rotation)} for the rotation"
        expected = f"columns that are there, {wanted} for the rotation"
        raise BadInput(beside.where, "gripper", found=found, expected=expected)
    position, turn = state[:, given.position], state[:, given.rotation]
    if given.convention == "euler_xyz":
        pose = euler_pose(position, turn)
    else:
        order = [0, 1, 2, 3] if given.convention == "quaternion_xyzw" else [1, 2, 3, 0]
        turn = turn[:, order]
        none = np.flatnonzero(~(np.linalg.norm(turn, axis=1) > 0))
        if len(none):
            found, expected = f"no rotation in step {none[0]}", "quaternions"
            raise BadInput(beside.where, f"gripper.key {given.key}", found=found, expected=expected)
        pose = geometry.pose_of(position, turn)
    return pose, None if given.opening is None else state[:, given.opening]


def euler_pose(
    position: Float64[np.ndarray, "t 3"], angles: Float64[np.ndarray, "t 3"]
) -> Float64[np.ndarray, "t 4 4"]:
    """Poses of positions in metres and angles in radians about the fixed x, then y, then z axis."""
    x, y, z = (
        np.stack([geometry.rotation(angle * axis) for angle in about])
        for about, axis in zip(angles.T, np.eye(3), strict=True)
    )
    pose = np.tile(np.eye(4), (len(position), 1, 1))
    pose[:, :3, :3], pose[:, :3, 3] = z @ y @ x, position
    return pose


def stated_camera(camera: Camera) -> dict[str, Any]:
    """Intrinsics and poses of a camera as the file has them; one pose where it stands still."""
    track = camera.cam_to_world[:1] if camera.fixed else camera.cam_to_world
    return {"K": camera.K.tolist(), "cam_to_world": track.tolist()}


def stated_gripper(robot: Robot, key: str) -> dict[str, Any]:
    """Where `key` holds the gripper, as the file has it: position, quaternion (x, y, z, w), opening if there is one."""
    return {
        "key": key,
        "rotation": [3, 4, 5, 6],
        "convention": "quaternion_xyzw",
        "opening": None if robot.gripper_open is None else 7,
    }


def moved(
    episode: Episode, recorded: Mapping[str, CameraView], beside: Beside, own: Path | None = None
) -> dict[str, bytes]:
    """The side file of this episode alone, where an edit moved a camera, or where it has one in its `own` folder."""
    changed = {
        name: view.camera
        for name, view in episode.views.items()
        if view.camera is not recorded[name].camera
    }
    if not changed:
        kept = None if own is None else own / NAME
        return {NAME: files.read_bytes(kept)} if kept is not None and kept.is_file() else {}
    given = beside.model_dump(mode="json", exclude_none=True)
    if beside.gripper is not None and beside.gripper.opening is None:
        given["gripper"]["opening"] = None  # left out, it would be taken to be the usual number
    for name, camera in changed.items():
        old = given["cameras"].get(name, {})
        old = {key: old[key] for key in ("depth", "metres", "ids") if key in old}
        given["cameras"][name] = old | stated_camera(camera)
    return {NAME: yaml.safe_dump(given, sort_keys=False).encode()}
