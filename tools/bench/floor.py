"""Processor seconds and memory of the command on one real episode: with its first copy, and for each further one.

    python -m tools.bench.floor RECORDINGS/rlbench_open_drawer [--case recolor] [--repeats 3] [--record]

Each run is a process of its own, from start to contact sheet, with one worker; user and system time of all that it
started, the median of the repeats, a warm-up apart, with byte code kept as Python keeps it unasked. A further copy is a
quarter of what five take more than one. The last row is of eight of the sample's episodes: wall seconds of one worker
by those of two, pairs by turns.
"""

import argparse
import json
import os
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from tools.bench.cost import dataset
from tools.bench.harness import pages

COPIES = 1, 5
CAMERAS = ["front", "left_shoulder", "right_shoulder", "overhead"]
RECOLOR = {"op": "recolor", "target": {"role": "manipulated"}, "color": {"sample": "colosseum"}}
MOVED = {"op": "camera_pose", "camera": CAMERAS, "shift": 0.05, "turn": 0.03}
ONE = ["--set", "select.limit=1", "--keep-invalid"]
# Recipe, options, and the most: processor seconds with one copy, of a further one, and megabytes.
CASES: dict[str, tuple[Any, list[str], tuple[str, str, str]]] = {
    "recolor": ({"edits": [RECOLOR]}, [], ("<= 3.0", "<= 0.8", "<= 300")),
    "four cameras moved": (
        {"edits": [MOVED], "gates": {"tries": 1, "torn": 1.0, "moving": 1.0}},
        [],
        ("", "<= 4.0", ""),
    ),
    "robust": ("robust", ["--models", "inpaint=telea"], ("", "<= 2.5", "")),
}
SHARED = "eight episodes, two workers"


def run(
    source: Path, folder: Path, recipe: Any, copies: int, *options: str
) -> tuple[float, float, float]:
    """Processor seconds, megabytes at most, and wall seconds of one run. Raises RuntimeError if it fails.

    What it wrote stays in `folder`: file systems make new files slowly for a while after many were removed.
    """
    folder = Path(tempfile.mkdtemp(dir=folder))
    named = recipe
    if isinstance(recipe, dict):
        named = str(folder / "recipe.yaml")
        Path(named).write_text(json.dumps({"version": 1, "seed": 3, **recipe}))
    command = [sys.executable, "-m", "rpaug", "augment", str(source), "--recipe", named]
    command += ["--set", f"copies={copies}", "--out", str(folder / "out"), "--keep-invalid"]
    around = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": ""}
    begun = time.monotonic()
    with open(os.devnull, "wb") as nothing:
        pid = os.posix_spawn(
            sys.executable, [*command, *options], around,
            file_actions=[(os.POSIX_SPAWN_DUP2, nothing.fileno(), 1)],
        )  # fmt: skip
        _, status, usage = os.wait4(pid, 0)
    if (code := os.waitstatus_to_exitcode(status)) not in (0, 1):  # 1: a gate rejected a copy
        raise RuntimeError(f"{recipe}: exit code {code}")
    wall = time.monotonic() - begun
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e3, wall


def copied(source: Path, folder: Path, case: str, repeats: int) -> tuple[float, float, float]:
    """Processor seconds with one copy and of a further one, and the largest process's megabytes with five."""
    recipe, options, _ = CASES[case]
    one, five = COPIES
    options = [*options, *ONE]
    run(source, folder, recipe, one, *options)
    first = [run(source, folder, recipe, one, *options) for _ in range(repeats)]
    more = [run(source, folder, recipe, five, *options) for _ in range(repeats)]
    seconds = [statistics.median(taken for taken, _, _ in runs) for runs in (first, more)]
    peak = statistics.median(megabytes for _, megabytes, _ in more)
    return seconds[0], (seconds[1] - seconds[0]) / (five - one), peak


def shared(folder: Path, repeats: int, copies: int = 20) -> list[float]:
    """Wall seconds by one worker over those by two."""
    source = dataset(folder / "eight", 8)
    recipe = {"edits": [{"op": "light_color"}]}
    alone = [
        [run(source, folder, recipe, copies, "--workers", n)[2] for n in "12"]
        for _ in range(repeats)
    ]
    return [one / two for one, two in alone]


def _row(case: str, source: Path, folder: Path, repeats: int) -> list[pages.Cell]:
    if case == SHARED:
        ratios = shared(folder, repeats)
        print(case, ratios, flush=True)
        ratio: pages.Cell = {"value": f"{statistics.median(ratios):.2f}", "target": ">= 1.85"}
        return [f"{case}: one worker's seconds by theirs", ratio, "-", "-"]
    found = copied(source, folder, case, repeats)
    print(case, found, flush=True)
    told = [f"{value:.{digits}f}" for value, digits in zip(found, (1, 2, 0), strict=True)]
    cells = zip(told, CASES[case][2], strict=True)
    return [case, *({"value": value, "target": t} if t else value for value, t in cells)]


def main() -> None:
    """Measure, print, and record."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--case", action="append", choices=[*CASES, SHARED], default=[])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument(
        "--record", action="store_true", help="write the table on the benchmarks' page"
    )
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = [
            _row(case, given.dataset, Path(folder), given.repeats)
            for case in given.case or [*CASES, SHARED]
        ]
    if given.record:
        chosen = "".join(f" --case '{case}'" for case in given.case)
        table = pages.Table(
            id="copies",
            title="One real episode, start to end",
            command=f"python -m tools.bench.floor RECORDINGS/rlbench_open_drawer --repeats {given.repeats}{chosen}",
            seeds=f"medians of {given.repeats}; load {os.getloadavg()[0]:.1f} at the end",
            columns=["recipe", "with one copy, processor s", "each further copy", "peak with five, MB"],
            rows=rows,
            **pages.stamp(),
        )  # fmt: skip
        pages.record("cost", table)


if __name__ == "__main__":
    main()
