"""Reads an evaluation in any layout: rpaug's own JSONL, or the folder of RVT's or LeRobot's evaluation."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from rpaug.core.errors import BadInput
from rpaug.diagnosis import jsonl, lerobot, rvt
from rpaug.diagnosis.evaluation import CameraShot, Evaluation, Rollout, checked, filmed


def read(path: Path, camera: str | None = None) -> Evaluation:
    """The evaluation in a JSONL file, or in the folder of RVT's or LeRobot's evaluation. Raises BadInput.

    `camera` says which of the training recordings' cameras the videos of a folder show.
    """
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
