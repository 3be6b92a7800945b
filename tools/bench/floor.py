"""Processor seconds and memory of the command on one real episode: with its first copy, and for each further one.

    python -m tools.bench.floor RECORDINGS/rlbench_open_drawer [--case recolor] [--repeats 3] [--record]

Each run is a process of its own, from start to contact sheet, with one worker; user and system time of all that it
started, the median of the repeats, a warm-up apart. A further copy is a quarter of what five take more than one. The
last row is of eight of the sample's episodes: wall seconds of one worker by those of two, pairs by turns.
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


def run(source: Path, recipe: Any, copies: int, *options: str) -> tuple[float, float, float]:
    """Processor seconds, megabytes at most, and wall seconds of one run. Raises RuntimeError if it fails."""
    with tempfile.TemporaryDirectory() as folder:
        named = recipe
        if isinstance(recipe, dict):
            named = str(Path(folder, "recipe.yaml"))
            Path(named).write_text(json.dumps({"version": 1, "seed": 3, **recipe}))
        command = [sys.executable, "-m", "rpaug", "augment", str(source), "--recipe", named]
        command += [
            "--set",
            f"copies={copies}",
            "--out",
            str(Path(folder, "out")),
            "--keep-invalid",
        ]
        begun = time.monotonic()
        with open(os.devnull, "wb") as nothing:
            pid = os.posix_spawn(
                sys.executable, [*command, *options], os.environ | {"OMP_NUM_THREADS": "1"},
                file_actions=[(os.POSIX_SPAWN_DUP2, nothing.fileno(), 1)],
            )  # fmt: skip
            _, status, usage = os.wait4(pid, 0)
        if (code := os.waitstatus_to_exitcode(status)) not in (0, 1):  # 1: a gate rejected a copy
            raise RuntimeError(f"{recipe}: exit code {code}")
        wall = time.monotonic() - begun
        return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e3, wall


def copied(source: Path, case: str, repeats: int) -> tuple[float, float, float]:
    """Processor seconds with one copy and of a further one, and the largest process's megabytes with five."""
    recipe, options, _ = CASES[case]
    one, five = COPIES
    options = [*options, *ONE]
    run(source, recipe, one, *options)
    first = [run(source, recipe, one, *options) for _ in range(repeats)]
    more = [run(source, recipe, five, *options) for _ in range(repeats)]
    seconds = [statistics.median(taken for taken, _, _ in runs) for runs in (first, more)]
    peak = statistics.median(megabytes for _, megabytes, _ in more)
    return seconds[0], (seconds[1] - seconds[0]) / (five - one), peak


def shared(repeats: int, copies: int = 20) -> list[float]:
    """Wall seconds by one worker over those by two."""
    with tempfile.TemporaryDirectory() as folder:
        source = dataset(Path(folder), 8)
        recipe = {"edits": [{"op": "light_color"}]}
        alone = [
            [run(source, recipe, copies, "--workers", n)[2] for n in "12"] for _ in range(repeats)
        ]
    return [one / two for one, two in alone]


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
    rows: list[list[pages.Cell]] = []
    for case in given.case or [*CASES, SHARED]:
        if case == SHARED:
            ratios = shared(given.repeats)
            print(case, ratios, flush=True)
            ratio: pages.Cell = {"value": f"{statistics.median(ratios):.2f}", "target": ">= 1.85"}
            rows.append([f"{case}: one worker's seconds by theirs", ratio, "-", "-"])
            continue
        found = copied(given.dataset, case, given.repeats)
        print(case, found, flush=True)
        told = [f"{value:.{digits}f}" for value, digits in zip(found, (1, 2, 0), strict=True)]
        most = CASES[case][2]
        cells = zip(told, most, strict=True)
        rows.append([case, *({"value": value, "target": t} if t else value for value, t in cells)])
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
