"""What a dry run says, and what the run takes: seconds and megabytes, for tiny, shipped and real episodes.

    python tools/bench/dry_run.py [--recordings FOLDER] [--episodes 60] [--copies 1 4] [--only tiny] [--runs 2]
        [--json FILE] [--taken FILE] [--record]

Tiny: so many episodes of four frames of one camera of 16x16 pixels, in RLBench's layout. Sample: the one that ships.
Real: one episode of FOLDER's `rlbench_open_drawer`, 128x128 pixels, five cameras. Bridge: the episodes of its
`rlds_bridge`, images of colors alone. Each row is `rpaug augment` in a process of its own, start included, the least of
some runs; kernels were compiled beforehand. Processor seconds are compared, since other work on the machine lengthens
wall seconds much and these a little. The model was set on half of the rows, a checkerboard of data, edits and copies,
and is judged on the others. `--taken` compares what is said now with what an earlier `--json` says was taken.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from rpaug.core import registry
from rpaug.core.types import Episode
from tools.bench.harness import filmed, pages

SAMPLE = Path(__file__).parents[2] / "rpaug/sample"
SIDE, FRAMES = 16, 4  # pixels and frames of a tiny episode
EPISODES = 60  # tiny ones
DATA = ("tiny", "sample", "real", "bridge")
RECOLOR = {"op": "recolor", "target": "manipulated", "color": "blue"}
EDITS: dict[str, list[dict[str, Any]]] = {
    "light_color": [{"op": "light_color"}],
    "recolor": [RECOLOR],
    "camera_pose": [{"op": "camera_pose", "camera": "front"}],
    "distractors": [{"op": "distractors", "count": 1}],
    "four": [{"op": "table_texture"}, RECOLOR, {"op": "distractors"}, {"op": "light_color"}],
}
STANDING = ("distractors", "four")  # the tiny episode's table is too coarse to put anything on
MOST = 30, 20  # percent that seconds and megabytes may be off by
BRIDGE = "bridge"  # colors alone, where no table is told
BALL = {"handle": 2}  # what is recolored: the tiny episode has no roles


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
    """The edits of a dataset; of a real one its first episode alone."""
    ball = {"target": BALL} if name == "tiny" else {}
    steps = [step | (ball if step is RECOLOR else {}) for step in EDITS[edit]]
    limit = {"select": {"limit": 1}} if name == "real" else {}
    return {"version": 1, "copies": copies, "edits": steps, **limit}


def taken(source: Path, wanted: dict[str, Any], runs: int) -> dict[str, float]:
    """What the run takes: processor seconds, of several runs the least, and megabytes."""
    found = []
    for _ in range(runs):
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder, "out")
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            _augmented(source, wanted, "--out", str(out))
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            files = (path for path in out.rglob("*") if path.is_file())
            size = sum(path.stat().st_size for path in files) / 1e6
        found.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return {"processor_s": round(min(found), 2), "mb": round(size, 2)}


def said(source: Path, wanted: dict[str, Any]) -> dict[str, float]:
    """What the dry run says."""
    estimate = _augmented(source, wanted, "--out", "/nonexistent/out", "--dry-run")["estimate"]
    return {"said_s": estimate["seconds"], "said_mb": estimate["megabytes"]}


def beside(spent: dict[str, float], told: dict[str, float]) -> dict[str, float]:
    """A row: what was said, what was taken, and the ratios."""
    seconds, size = told["said_s"] / spent["processor_s"], told["said_mb"] / spent["mb"]
    return {**told, **spent, "ratio": round(seconds, 2), "mb_ratio": round(size, 2)}


def is_set(name: str, edit: str, copies: int) -> bool:
    """Whether the model was set on a row."""
    return (DATA.index(name) + list(EDITS).index(edit) + (copies > 1)) % 2 == 0


def table(found: dict[str, dict[str, float]], runs: int) -> pages.Table:
    """The rows for the page."""
    rows: list[list[pages.Cell]] = []
    worst = [0, 0]
    for row, one in found.items():
        name, edit, copies = row.split(", ")
        far = [round(100 * abs(one[of] - 1)) for of in ("ratio", "mb_ratio")]
        worst = [max(pair) for pair in zip(worst, far, strict=True)]
        use = "set" if is_set(name, edit, int(copies)) else "judged"
        stated = [one["said_s"], one["processor_s"], far[0], one["said_mb"], one["mb"], far[1]]
        rows.append([row.replace(", ", "/"), use, *stated])
    seconds, size = (
        {"value": str(off), "target": f"<= {most}"} for off, most in zip(worst, MOST, strict=True)
    )
    rows.append(["worst", "", "", "", seconds, "", "", size])
    return pages.Table(
        id="dry_run",
        title="What `--dry-run` says, and what the run took",
        command="python tools/bench/dry_run.py --recordings RECORDINGS",
        seeds=f"least of {runs} runs each, start included",
        columns=[
            "episodes/edit/copies", "model", "said, s", "taken, processor s", "s off, %",
            "said, MB", "taken, MB", "MB off, %",
        ],
        rows=rows,
        **pages.stamp(),
    )  # fmt: skip


def _augmented(source: Path, wanted: dict[str, Any], *how: str) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        given = Path(folder, "recipe.json")
        given.write_text(json.dumps(wanted))
        command = [sys.executable, "-m", "rpaug", "augment", str(source), "--recipe", str(given)]
        return dict(json.loads(_ran([*command, *how, "--json"])))


def _ran(command: list[str]) -> str:
    env = os.environ | {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    return subprocess.run(command, env=env, check=True, capture_output=True, text=True).stdout


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--recordings", type=Path)
    parser.add_argument("--episodes", type=int, default=EPISODES)
    parser.add_argument("--copies", type=int, nargs="+", default=[1, 4])
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("--only", nargs="+", choices=DATA, default=DATA)
    parser.add_argument("--edit", nargs="+", choices=EDITS, default=list(EDITS))
    parser.add_argument("--json", type=Path)
    parser.add_argument("--taken", type=Path, help="an earlier --json")
    parser.add_argument("--record", action="store_true", help="into docs/benchmarks/scale.md")
    given = parser.parse_args()
    known = json.loads(given.taken.read_text()) if given.taken else {}
    found = {}
    for edit in given.edit if not known else ():
        _ = taken(SAMPLE, recipe("sample", edit, 1), 1)  # kernels are compiled and kept
    with tempfile.TemporaryDirectory() as folder:
        for name, source in datasets(Path(folder), given.episodes, given.recordings):
            if name not in given.only:
                continue
            for edit in given.edit:
                if (name == "tiny" and edit in STANDING) or (
                    name == BRIDGE and edit != "light_color"
                ):
                    continue
                for copies in given.copies:
                    row, wanted = f"{name}, {edit}, {copies}", recipe(name, edit, copies)
                    spent = known.get(row) or taken(source, wanted, given.runs)
                    found[row] = beside(spent, said(source, wanted))
                    print(
                        row,
                        "set" if is_set(name, edit, copies) else "judged",
                        found[row],
                        flush=True,
                    )
    if given.json:
        given.json.write_text(json.dumps(found, indent=1) + "\n")
    if given.record:
        pages.record("scale", table(found, given.runs))


if __name__ == "__main__":
    main()
