"""The evaluation format: one JSON value a line, one line a rollout, images in files beside it (docs/diagnose.md)."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, StrictBool, ValidationError, field_validator

from rpaug.core.errors import BadInput
from rpaug.core.files import decode_image, write_atomic
from rpaug.language.messages import Message
from rpaug.pipeline.recipe_errors import dotted

MOST_BYTES = 2**26  # of the file
MOST_LINE = 2**20  # bytes of one line
MOST_ROLLOUTS = 10_000

Name = Annotated[str, Field(min_length=1, max_length=200)]
Frame = Annotated[int, Field(ge=0, lt=2**31)]


class FrameImages(Message):
    """The images of one frame by camera; paths are relative to the file. Masks hold ids as R + 256 G + 65536 B.

    `poses` are camera-to-world matrices (x right, y down, z ahead).
    """

    t: Frame
    images: dict[Name, str] = Field(min_length=1, max_length=16)
    masks: dict[Name, str] = {}
    poses: dict[Name, list[list[float]]] = {}


class Line(Message):
    """One rollout of a policy. Either `frames` or `video` (a file by camera) shows it.

    `failed_at` is the frame at which it went wrong, if that is known. `roles` says which ids of the masks the robot
    acts on and which are table, background and robot. `factor` says what was perturbed: it is reported and never
    looked at.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    version: Literal[1] = 1
    episode: Name
    success: StrictBool
    instruction: str = Field(default="", max_length=2000)
    frames: tuple[FrameImages, ...] = Field(default=(), max_length=256)
    video: dict[Name, str] = Field(default={}, max_length=16)
    roles: dict[Name, tuple[int, ...]] = {}
    failed_at: Frame | None = None
    factor: str | None = Field(default=None, max_length=200)
    metadata: dict[str, Any] = {}

    @field_validator("frames")
    @classmethod
    def _in_order(cls, frames: tuple[FrameImages, ...]) -> tuple[FrameImages, ...]:
        times = [moment.t for moment in frames]
        if times != sorted(set(times)):
            raise ValueError(f"t is {times[:10]}; expected rising numbers")
        return frames


def read(path: Path) -> Iterator[tuple[str, Line]]:
    """Every rollout and where it stands (`file:line`). Raises BadInput with line and field."""
    try:
        size = path.stat().st_size
    except OSError as error:
        raise BadInput(path, "file", found=error.strerror, expected="a JSONL file") from None
    if size > MOST_BYTES:
        raise BadInput(path, "size", found=f"{size} bytes", expected=f"at most {MOST_BYTES}")
    seen: dict[str, int] = {}
    with path.open("rb") as stream:
        number = 0
        while data := stream.readline(MOST_LINE + 1):
            number += 1
            where = f"{path}:{number}"
            if len(data) > MOST_LINE:
                raise BadInput(
                    where, "line", found="a longer one", expected=f"at most {MOST_LINE} bytes"
                )
            if not data.strip():
                continue
            line = parse(data, where)
            if line.episode in seen:
                raise BadInput(
                    where,
                    "episode",
                    found=f"{line.episode!r}, which line {seen[line.episode]} has too",
                    expected="a name of its own",
                )
            seen[line.episode] = number
            if len(seen) > MOST_ROLLOUTS:
                raise BadInput(where, "rollouts", found="more", expected=f"at most {MOST_ROLLOUTS}")
            yield where, line


def parse(data: bytes, where: str) -> Line:
    """One line. Raises BadInput."""
    try:
        value = json.loads(data.decode())
    except RecursionError:
        raise BadInput(
            where, "line", found="values nested too deeply", expected="one JSON value"
        ) from None
    except ValueError as error:
        raise BadInput(where, "line", found=str(error)[:120], expected="one JSON value") from None
    if not isinstance(value, dict):
        raise BadInput(where, "line", found=type(value).__name__, expected="a JSON object")
    try:
        line = Line.model_validate(value)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        found = "nothing" if fault["type"] == "missing" else f"{fault['input']!r:.80}"
        message = fault["msg"].removeprefix("Value error, ")
        raise BadInput(
            where, dotted(fault["loc"]) or "line", found=found, expected=message
        ) from None
    if bool(line.frames) == bool(line.video):
        both = "both" if line.frames else "neither"
        raise BadInput(where, "frames, video", found=both, expected="one of them")
    return line


def write(path: Path, lines: Sequence[Line]) -> None:
    """The file of these rollouts, whole or not at all."""
    rows = [line.model_dump_json(exclude_defaults=True, exclude={"version"}) for line in lines]
    rows = ['{"version":1,' + row[1:] for row in rows]
    write_atomic(path, "".join(row + "\n" for row in rows).encode())


def inside(folder: Path, name: str, where: str, field: str) -> Path:
    """The file called `name` in a folder, never one outside of it. Raises BadInput."""
    parts = PurePosixPath(name).parts
    path = folder / name
    if (
        not parts
        or PurePosixPath(name).is_absolute()
        or ".." in parts
        or "\0" in name
        or len(name) > 1000
        or not path.resolve().is_relative_to(folder.resolve())
    ):
        raise BadInput(where, field, found=f"{name!r:.80}", expected="a path inside the folder")
    if not path.is_file():
        raise BadInput(where, field, found=f"no file {name!r:.80}", expected="a file")
    return path


def image(path: Path) -> np.ndarray:
    """A PNG or JPEG as (h, w, 3) uint8 RGB. Raises BadInput."""
    found = decode_image(path)
    return found if found.ndim == 3 else np.repeat(found[..., None], 3, 2)


def ids(path: Path) -> np.ndarray:
    """A mask as (h, w) int32 ids. Raises BadInput."""
    found = decode_image(path).astype(np.int32)
    return found if found.ndim == 2 else found @ np.array([1, 1 << 8, 1 << 16], np.int32)
