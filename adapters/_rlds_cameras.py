"""`cameras.yaml`: what no Open X-Embodiment record says about its cameras and its robot, said beside the records.

It lies beside `features.json` (for all episodes) or in an episode's own folder (for that one, as rpaug writes it where
a camera was moved). Keys are paths in the Example without `steps/`.
"""

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from jaxtyping import Float64
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from rpaug import BadInput
from rpaug.files import read_bytes

NAME = "cameras.yaml"
LARGEST = 2**22  # bytes: a track of ten thousand poses is smaller
Row = Annotated[list[float], Field(min_length=3, max_length=4)]


class Model(BaseModel):
    """Strict: a misspelt key is an error."""

    model_config = ConfigDict(extra="forbid")


class Calibration(Model):
    """One camera. `K` is in pixels, centres at integer coordinates; poses are camera to world, OpenCV axes, metres."""

    K: list[Row] | None = None
    field_of_view: float | None = Field(
        default=None, gt=0, lt=180, description="horizontal, degrees"
    )
    cam_to_world: list[Any] | None = None
    pose_key: str | None = None
    depth: str | None = None
    metres: float = Field(default=1.0, gt=0, description="of one unit of depth")

    @model_validator(mode="after")
    def _once(self) -> "Calibration":
        if (self.K is None) == (self.field_of_view is None):
            raise ValueError("give one of K and field_of_view")
        if self.cam_to_world is not None and self.pose_key is not None:
            raise ValueError("give one of cam_to_world and pose_key")
        return self

    def intrinsics(self, width: int, height: int) -> Float64[np.ndarray, "3 3"]:
        """K in pixels; with a field of view the axis goes through the middle of the image."""
        if self.K is not None:
            return np.array(self.K, float)
        assert self.field_of_view is not None
        focal = width / 2 / np.tan(np.radians(self.field_of_view) / 2)
        return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])


class Gripper(Model):
    """Which numbers of the record are the gripper's pose and its opening."""

    key: str
    position: tuple[int, int, int] = (0, 1, 2)
    rotation: tuple[int, ...] = (3, 4, 5)
    convention: Literal["euler_xyz", "quaternion_xyzw", "quaternion_wxyz"] = "euler_xyz"
    opening: int | None = 6


class Beside(Model):
    """All of the file."""

    version: Literal[1] = 1
    cameras: dict[str, Calibration] = {}
    gripper: Gripper | None = None
    joints: str | None = None
    language: str | None = None
    views: list[str] | None = None


def load(folders: tuple[Path, ...]) -> Beside:
    """The first `cameras.yaml` there is, or an empty one. Raises BadInput."""
    for path in (folder / NAME for folder in folders):
        if path.is_file():
            return parse(path)
    return Beside()


def parse(path: Path) -> Beside:
    """One file. Raises BadInput, naming the key."""
    if path.stat().st_size > LARGEST:
        raise BadInput(path, "size", found="more than 4 MiB", expected="a list of cameras")
    try:
        told = yaml.safe_load(read_bytes(path))
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError, ValueError) as error:
        raise BadInput(path, "YAML", found=str(error).split("\n")[0], expected="YAML") from None
    try:
        return Beside.model_validate(told)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "file"
        found = str(first["input"])[:60]
        raise BadInput(path, where, found=found, expected=first["msg"]) from None


def poses(
    where: Path | str, calibration: Calibration, numbers: np.ndarray | None, length: int
) -> Float64[np.ndarray, "t 4 4"]:
    """The camera's pose in every frame, from the file or, with `numbers`, from the record. Raises BadInput."""
    told = numbers if numbers is not None else calibration.cam_to_world
    if told is None:
        return np.tile(np.eye(4), (length, 1, 1))
    try:
        track = np.asarray(told, float)
        track = track.reshape((-1, 4, 4) if track.size % 16 == 0 else (-1, 3, 4))
    except (TypeError, ValueError):
        raise BadInput(where, "cam_to_world", found="no matrices", expected="4x4 or 3x4") from None
    if track.shape[1] == 3:
        last = np.broadcast_to([[[0.0, 0, 0, 1]]], (len(track), 1, 4))
        track = np.concatenate([track, last], 1)
    if len(track) not in (1, length):
        raise BadInput(
            where, "cam_to_world", found=f"{len(track)} poses", expected=f"1 or {length}"
        )
    turn = track[:, :3, :3]
    proper = np.abs(turn @ turn.swapaxes(1, 2) - np.eye(3)).max() < 1e-3
    if not (proper and (np.linalg.det(turn) > 0).all()):
        raise BadInput(
            where, "cam_to_world", found="no rigid motion", expected="a rotation, metres"
        )
    return np.repeat(track, length, 0) if len(track) == 1 else track
