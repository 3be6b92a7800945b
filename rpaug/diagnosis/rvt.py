"""RVT's evaluation folder: `eval_results.csv` and, where it ran with --save-video, `videos/TASK_{success,fail}_N.mp4`.

As NVlabs/RVT's eval.py writes it (commit 367995a1). Traps:

- the table holds one row a task, its rate in per cent, and grows when an evaluation runs again: the last row counts;
- rollouts are told apart by the videos' names alone; ten frames are cut off each video's end;
- no instruction is kept: the task's name stands in;
- the videos show RVT's own recording camera, not one of the policy's, unless it was set up otherwise.
"""

import csv
import math
import re
from pathlib import Path

from rpaug.core.errors import BadInput
from rpaug.core.files import read_bytes
from rpaug.diagnosis.evaluation import Evaluation, Rollout, checked, filmed

TABLE, VIDEOS = "eval_results.csv", "videos"
MOST_BYTES = 2**22
UNNAMED = "video"  # the camera's name where none is given
NAMED = re.compile(r"(?P<task>.+)_(?P<how>success|fail)_(?P<number>\d{1,6})\.mp4")
OFF = 0.5  # per cent by which the videos' rate may miss the table's


def found(folder: Path) -> bool:
    """Whether this is such a folder."""
    return (folder / TABLE).is_file()


def read(folder: Path, camera: str | None = None) -> Evaluation:
    """All rollouts that have a video. Raises BadInput."""
    rates = _rates(folder / TABLE)
    rollouts, notes = [], []
    for task, rate in rates.items():
        films = _films(folder / VIDEOS, task)
        if not films:
            notes.append(f"{task}: {rate:g} % succeeded, but no video shows any of it")
            continue
        won = 100 * sum(success for success, _ in films) / len(films)
        if abs(won - rate) > OFF:
            notes.append(
                f"{task}: {TABLE} says {rate:g} %, its {len(films)} videos {won:g} %: "
                "some are missing, or of another run"
            )
        rollouts += [
            Rollout(
                f"{task}/{path.stem.removeprefix(task + '_')}",
                success,
                task.replace("_", " "),
                {camera or UNNAMED: filmed(path)},
            )
            for success, path in films
        ]
    if not rollouts:
        raise BadInput(
            folder / VIDEOS,
            "videos",
            found="none of the tasks in the table",
            expected="TASK_success_N.mp4 or TASK_fail_N.mp4, from RVT's --save-video",
        )
    return checked(folder, Evaluation(tuple(rollouts), tuple(notes)))


def _rates(path: Path) -> dict[str, float]:
    data = read_bytes(path)
    if len(data) > MOST_BYTES:
        raise BadInput(path, "size", found=f"{len(data)} bytes", expected=f"at most {MOST_BYTES}")
    rows = csv.DictReader(data.decode("utf-8", "replace").splitlines())
    out = {}
    try:
        for row in rows:
            task, rate = row.get("task") or "", row.get("success rate")
            where = f"{path}:{rows.line_num}"
            if not re.fullmatch(r"[\w-]{1,100}", task):
                raise BadInput(where, "task", found=f"{task!r:.80}", expected="a task's name")
            out[task] = _per_cent(rate, where)
    except csv.Error as error:
        raise BadInput(path, "table", found=str(error), expected="a CSV file") from None
    if not out:
        raise BadInput(path, "rows", found="none", expected="columns task and success rate")
    return out


def _per_cent(text: str | None, where: str) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not 0 <= value <= 100:
        raise BadInput(where, "success rate", found=f"{text!r:.80}", expected="0 to 100")
    return value


def _films(folder: Path, task: str) -> list[tuple[bool, Path]]:
    """Success and file of every video of a task, in order."""
    named = [(NAMED.fullmatch(path.name), path) for path in sorted(folder.glob("*.mp4"))]
    films = [(m["how"], int(m["number"]), path) for m, path in named if m and m["task"] == task]
    return [(how == "success", path) for how, _, path in sorted(films)]
