"""Seconds of edits on a large recording: one camera, 1920x1080, 121 frames, read to written.

    python -m tools.bench.large [--frames 121] [--width 1920] [--height 1080] [--edit color] [--json] [--record]

The recording is made once: a table seen by one fixed camera, a ball that rolls over it and one that lies beside, depth
and masks, in RLBench's format. Each edit is then a process of its own (`rpaug augment`), so start-up counts; kernels
are compiled beforehand. `--record` writes the table on the benchmarks' page.
"""

import argparse
import json
import os
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from tools.bench.harness import filmed, pages

EDITS: dict[str, dict[str, Any]] = {
    "color": {"op": "recolor", "target": {"handle": 2}, "color": "blue"},
    "texture": {"op": "retexture", "target": {"handle": 2}, "texture": "oak"},
    "table's texture": {"op": "retexture", "target": {"handle": 1}, "texture": "oak"},
    "light": {"op": "light_color"},
    "remove": {"op": "remove", "target": {"handle": 3}},
    "distractors": {"op": "distractors", "count": 2},
}
# Processor seconds at most, and the minutes that RoboPearls (ICCV 2025) reports of its edits.
AIMED = {"color": (8, 1), "texture": (12, 5), "distractors": (25, 6), "remove": (25, 6)}


def seconds(dataset: Path, edit: dict[str, Any], folder: Path, most: int = 0) -> dict[str, float]:
    """Wall and processor seconds of one run of the command, and its stages. Raises RuntimeError where its exit code is
    more than `most`: 1 says that the edit is in no copy."""
    recipe = folder / "recipe.yaml"
    given = {
        "version": 1,
        "edits": [edit],
        "gates": {"self_check": False},
    }  # the gripper is nowhere near
    recipe.write_text(json.dumps(given))
    before, start = os.times(), time.perf_counter()
    command = [sys.executable, "-m", "rpaug", "augment", str(dataset), "--json"]
    done = subprocess.run(
        [*command, "--recipe", str(recipe), "--out", str(folder / "out")],
        check=False,
        capture_output=True,
        text=True,
    )
    if done.returncode > most:
        raise RuntimeError(f"{edit}: exit code {done.returncode}: {done.stderr[-400:]}")
    wall, after = time.perf_counter() - start, os.times()
    spent = (
        after.children_user + after.children_system - before.children_user - before.children_system
    )
    stages = json.loads(done.stdout)["seconds"]
    return {"wall": wall, "processor": spent, **stages}


def recorded(table: dict[str, dict[str, float]], size: tuple[int, int, int]) -> pages.Table:
    """The page's table of edits of so many frames of so many pixels, wide and high."""
    rows: list[list[pages.Cell]] = []
    for edit, row in table.items():
        most, minutes = AIMED.get(edit, (None, None))
        spent: pages.Cell = round(row["processor"], 1)
        if most is not None:
            spent = {"value": spent, "target": f"<= {most}"}
        rows.append([edit, spent, round(row["wall"], 1), "-" if minutes is None else 60 * minutes])
    return pages.Table(
        id="large",
        title=f"{size[0]} frames of {size[1]}x{size[2]}, one camera, s",
        command="python -m tools.bench.large "
        + " ".join(f"--edit {shlex.quote(edit)}" for edit in table),
        seeds=f"one run each; load {os.getloadavg()[0]:.1f} at the end",
        columns=["edit", "processor", "wall", "RoboPearls reports, on a GPU"],
        rows=rows,
        **pages.stamp(),
    )


def main() -> None:
    """Record, measure, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=121)
    parser.add_argument("--width", type=int, default=1920)
    parser.add_argument("--height", type=int, default=1080)
    parser.add_argument("--edit", action="append", choices=list(EDITS))
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--record", action="store_true")
    arguments = parser.parse_args()
    table = {}
    with tempfile.TemporaryDirectory() as name:
        size = (arguments.frames, arguments.width, arguments.height)
        dataset = filmed.written(Path(name) / "large", *size)
        warm = filmed.written(Path(name) / "warm", 4, 64, 48)
        for edit in arguments.edit or EDITS:
            for root, most in ((warm, 1), (dataset, 0)):
                with tempfile.TemporaryDirectory() as folder:
                    table[edit] = seconds(root, EDITS[edit], Path(folder), most)
    table = {edit: {k: round(v, 2) for k, v in row.items()} for edit, row in table.items()}
    if arguments.record:
        pages.record("main_job", recorded(table, size))
    if arguments.json:
        sys.stdout.write(json.dumps(table) + "\n")
        return
    for edit, row in table.items():
        sys.stdout.write(f"{edit:16}{'  '.join(f'{k} {v}' for k, v in row.items())}\n")


if __name__ == "__main__":
    main()
