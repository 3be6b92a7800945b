"""What a dry run says, and what the run takes: seconds and megabytes, for tiny, shipped and real episodes.

    python tools/bench/dry_run.py [--recordings FOLDER] [--episodes 200] [--copies 1 4] [--only tiny] [--json FILE]

Tiny: so many episodes of four frames of one camera of 16x16 pixels, in RLBench's layout. Sample: the one that ships.
Real: one episode of FOLDER's `rlbench_open_drawer`, 128x128 pixels, five cameras. Bridge: the episodes of its
`rlds_bridge`, images of colors alone, 64x64 pixels. Each row is `rpaug augment` in a
process of its own, start included; kernels were compiled beforehand. Processor seconds are compared, since other work
on the machine lengthens wall seconds much and these a little.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from rpaug.core import registry
from rpaug.core.types import Episode
from tools.bench.harness import filmed

SAMPLE = Path(__file__).parents[2] / "rpaug/sample"
SIDE, FRAMES = 16, 4  # pixels and frames of a tiny episode
EDITS: dict[str, dict[str, Any]] = {
    "light_color": {"op": "light_color"},
    "recolor": {"op": "recolor", "color": "blue"},
    "camera_pose": {"op": "camera_pose", "camera": "front"},
    "distractors": {"op": "distractors", "count": 1},
    "table_color": {"op": "table_color"},
}
BRIDGE = "bridge"  # colors alone, whose edits need what colors tell
TARGETED, BALL = "recolor", {"handle": 2}  # what is recolored: the tiny episode has no roles


def tiny() -> Episode:
    """One camera, few frames, few pixels."""
    return filmed.recording(FRAMES, SIDE, SIDE)


def datasets(root: Path, episodes: int, recordings: Path | None) -> Iterator[tuple[str, Path]]:
    """Names and roots."""
    made, layout = tiny(), registry.adapter("rlbench")
    for number in range(episodes):
        key = layout.key_at(made.key, number)
        layout.write(replace(made, key=key), root / "tiny", key, dict)
    yield "tiny", root / "tiny"
    yield "sample", SAMPLE
    if recordings:
        yield "real", recordings / "rlbench_open_drawer"
        yield BRIDGE, recordings / "rlds_bridge"


def recipe(name: str, edit: str, copies: int) -> dict[str, Any]:
    """The edit of a dataset; of a real one its first episode alone."""
    step = EDITS[edit] | (
        {"target": BALL if name == "tiny" else "manipulated"} if edit == TARGETED else {}
    )
    limit = {"select": {"limit": 1}} if name == "real" else {}
    return {"version": 1, "copies": copies, "edits": [step], **limit}


def measured(source: Path, wanted: dict[str, Any]) -> dict[str, float]:
    """What the dry run says and what the run takes."""
    with tempfile.TemporaryDirectory() as folder:
        given, out = Path(folder, "recipe.json"), Path(folder, "out")
        given.write_text(json.dumps(wanted))
        command = [sys.executable, "-m", "rpaug", "augment", str(source), "--recipe", str(given)]
        command += ["--out", str(out), "--json"]
        said = json.loads(_ran([*command, "--dry-run"]))["estimate"]
        before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        copies = json.loads(_ran(command))["copies"]
        wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        size = sum(path.stat().st_size for path in out.rglob("*") if path.is_file()) / 1e6
    return {
        "copies": copies,
        "said_s": said["seconds"],
        "processor_s": round(spent, 1),
        "wall_s": round(wall, 1),
        "ratio": round(said["seconds"] / spent, 2),
        "said_mb": said["megabytes"],
        "mb": round(size, 1),
        "mb_ratio": round(said["megabytes"] / size, 2),
    }


def _ran(command: list[str]) -> str:
    env = os.environ | {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    return subprocess.run(command, env=env, check=True, capture_output=True, text=True).stdout


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--recordings", type=Path)
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--copies", type=int, nargs="+", default=[1, 4])
    parser.add_argument("--only", nargs="+", help="tiny, sample, real, bridge")
    parser.add_argument("--edit", nargs="+", choices=EDITS, default=list(EDITS))
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, source in datasets(Path(folder), given.episodes, given.recordings):
            if given.only and name not in given.only:
                continue
            for edit in given.edit:
                if edit == "distractors" and name == "tiny":
                    continue  # its table is too coarse to put anything on
                if (edit == "table_color") != (name == BRIDGE) and edit != "light_color":
                    continue
                measured(SAMPLE, recipe("sample", edit, 1))  # kernels are compiled and kept
                for copies in given.copies:
                    row = f"{name}, {edit}, {copies}"
                    found[row] = measured(source, recipe(name, edit, copies))
                    print(row, found[row], flush=True)
    if given.json:
        given.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
