"""An evaluation: rollouts of a policy that succeeded or failed, and what cameras saw of them, read when asked for."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Int32, UInt8

from rpaug.core import registry
from rpaug.core.errors import BadInput
from rpaug.core.types import CameraView
from rpaug.diagnosis import jsonl

Image = Callable[[], UInt8[np.ndarray, "h w 3"]]


@dataclass(frozen=True)
class CameraShot:
    """What one camera saw at one frame. `ids` and `pose` (camera to world) are None where the evaluation lacks them."""

    image: Image
    ids: Callable[[], Int32[np.ndarray, "h w"]] | None = None
    pose: Float64[np.ndarray, "4 4"] | None = None


@dataclass(frozen=True)
class Rollout:
    """One rollout. `shots[camera][t]` are its images, `roles` ids of masks by what they do (see `jsonl.Line`)."""

    name: str
    success: bool
    instruction: str
    shots: Mapping[str, Mapping[int, CameraShot]]
    roles: Mapping[str, frozenset[int]] = field(default_factory=dict)
    failed_at: int | None = None
    factor: str | None = None
    metadata: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Evaluation:
    """All rollouts, and in sentences what the source does not say."""

    rollouts: tuple[Rollout, ...]
    notes: tuple[str, ...] = ()

    @property
    def failures(self) -> tuple[Rollout, ...]:
        """Those that failed."""
        return tuple(one for one in self.rollouts if not one.success)


def read(path: Path, camera: str | None = None) -> Evaluation:
    """The evaluation in a JSONL file, or in the folder of RVT's or LeRobot's evaluation. Raises BadInput.

    `camera` says which of the training recordings' cameras the videos of a folder show.
    """
    from rpaug.diagnosis import lerobot, rvt

    path = Path(path)
    if path.is_file():
        return from_jsonl(path)
    if not path.exists():
        raise BadInput(path, "evaluation", found="nothing", expected="a JSONL file, or a folder")
    for kind in (rvt, lerobot):
        if kind.found(path):
            return kind.read(path, camera)
    inner = sorted(path.glob("*.jsonl"))
    if len(inner) == 1:
        return from_jsonl(inner[0])
    raise BadInput(
        path,
        "evaluation",
        found="none" if not inner else f"{len(inner)} JSONL files",
        expected=f"one JSONL file, {rvt.TABLE} (RVT) or {lerobot.INFO} (LeRobot)",
    )


def from_jsonl(path: Path) -> Evaluation:
    """The rollouts of a file in rpaug's own format. Raises BadInput."""
    rollouts = tuple(_rollout(where, line, path.parent) for where, line in jsonl.read(path))
    return checked(path, Evaluation(rollouts))


def checked(path: Path, evaluation: Evaluation) -> Evaluation:
    """The evaluation, if there is any rollout in it. Raises BadInput."""
    if not evaluation.rollouts:
        raise BadInput(path, "rollouts", found="none", expected="one or more")
    return evaluation


def filmed(path: Path) -> Mapping[int, CameraShot]:
    """The frames of a video, decoded when asked for. Raises BadInput."""
    episode = registry.adapter("video").read(path.parent, path.stem)
    view: CameraView = next(iter(episode.views.values()))
    return {t: CameraShot(partial(view.rgb, t)) for t in range(episode.length)}


def _rollout(where: str, line: jsonl.Line, folder: Path) -> Rollout:
    shots: dict[str, dict[int, CameraShot]] = {}
    for number, moment in enumerate(line.frames):
        for name, file in moment.images.items():
            at = f"frames[{number}]"
            mask, pose = moment.masks.get(name), moment.poses.get(name)
            seen = jsonl.inside(folder, file, where, f"{at}.images.{name}")
            shots.setdefault(name, {})[moment.t] = CameraShot(
                partial(jsonl.image, seen),
                partial(jsonl.ids, jsonl.inside(folder, mask, where, f"{at}.masks.{name}"))
                if mask is not None
                else None,
                _pose(pose, where, f"{at}.poses.{name}") if pose is not None else None,
            )
    films = {
        name: filmed(jsonl.inside(folder, file, where, f"video.{name}"))
        for name, file in line.video.items()
    }
    return Rollout(
        line.episode,
        line.success,
        line.instruction,
        shots or films,
        {role: frozenset(found) for role, found in line.roles.items()},
        line.failed_at,
        line.factor,
        line.metadata,
    )


def _pose(rows: Sequence[Sequence[float]], where: str, field: str) -> Float64[np.ndarray, "4 4"]:
    try:
        pose = np.array(rows, np.float64)
    except (ValueError, OverflowError):
        pose = np.empty(0)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise BadInput(where, field, found="another shape", expected="4 x 4 finite numbers")
    return pose
