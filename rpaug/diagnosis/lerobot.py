"""LeRobot's evaluation folder: `eval_info.json` and `videos/`, from one environment or from several tasks.

As huggingface/lerobot's lerobot_eval.py writes it, and as it did before there were several tasks. Traps:

- fewer videos than rollouts are made: those without are counted and not looked at;
- paths of videos are those of the machine it ran on: the files are looked for in the folder by their last parts;
- neither camera nor instruction is named.
"""

import json
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rpaug.core.errors import BadInput
from rpaug.core.files import read_bytes
from rpaug.diagnosis.evaluation import Evaluation, Rollout, checked, filmed
from rpaug.pipeline.recipe_errors import dotted

INFO = "eval_info.json"
MOST_BYTES = 2**26
UNNAMED = "video"


class _Open(BaseModel):
    model_config = ConfigDict(extra="ignore")


class _One(_Open):
    success: bool | None


class _Metrics(_Open):
    successes: list[bool | None]
    video_paths: list[str] = []


class _Task(_Open):
    task_group: str = Field(max_length=200)
    task_id: int
    metrics: _Metrics


class _EvaluationInfo(_Open):
    """Either of the two forms."""

    per_episode: list[_One] = []
    video_paths: list[str] = []
    per_task: list[_Task] = []


def found(folder: Path) -> bool:
    """Whether this is such a folder."""
    return (folder / INFO).is_file()


def read(folder: Path, camera: str | None = None) -> Evaluation:
    """All rollouts that have a video. Raises BadInput."""
    info = _info(folder / INFO)
    rollouts: list[Rollout] = []
    unseen = 0
    groups: list[tuple[str, Sequence[bool | None], Sequence[str]]] = [
        (f"{one.task_group}_{one.task_id}", one.metrics.successes, one.metrics.video_paths)
        for one in info.per_task
    ]
    if info.per_episode:
        groups.append(("", [one.success for one in info.per_episode], info.video_paths))
    for name, successes, paths in groups:
        unseen += max(0, len(successes) - len(paths))
        for number, (success, file) in enumerate(zip(successes, paths, strict=False)):
            label = f"{name}/{number}" if name else str(number)
            video = _inside(folder, file, f"video_paths[{number}]")
            shots = {camera or UNNAMED: filmed(video)}
            rollouts.append(Rollout(label, bool(success), "", shots))
    notes = (f"{unseen} rollouts have no video and were not looked at",) if unseen else ()
    return checked(folder / INFO, Evaluation(tuple(rollouts), notes))


def _info(path: Path) -> _EvaluationInfo:
    data = read_bytes(path)
    if len(data) > MOST_BYTES:
        raise BadInput(path, "size", found=f"{len(data)} bytes", expected=f"at most {MOST_BYTES}")
    try:
        value: Any = json.loads(data)
        info = _EvaluationInfo.model_validate(value)
    except (RecursionError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise BadInput(path, "file", found=str(error)[:120], expected="JSON") from None
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        raise BadInput(
            path,
            dotted(fault["loc"]) or "file",
            found=f"{fault['input']!r:.80}",
            expected=fault["msg"],
        ) from None
    if not info.per_episode and not info.per_task:
        raise BadInput(path, "rollouts", found="none", expected="per_episode or per_task")
    return info


def _inside(folder: Path, file: str, field: str) -> Path:
    """The video by its last one to three parts, in the folder alone. Raises BadInput."""
    parts = [part for part in PurePosixPath(file).parts if part not in ("..", "/", ".")]
    for count in (3, 2, 1):
        path = folder.joinpath(*parts[-count:])
        if parts and path.is_file() and path.resolve().is_relative_to(folder.resolve()):
            return path
    raise BadInput(
        folder / INFO, field, found=f"{file!r:.80}, which is not there", expected="a video"
    )
