"""What a run costs beside its episodes: scheduling, journal, summary, memory, and a finished one gone on with.

    python tools/bench/scale.py [--episodes 100000] [--copies 1] [--json FILE]

Makes that many folders with the layout of RLBench, each an empty observation file, and runs the pipeline over them with
workers that are played in its process: a copy is a folder with a report and nothing else, noted in the journal. The
seconds in which those folders are written are taken off. Then a process of its own goes on with the finished output.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

GROUP = "task/all_variations/episodes"
RECIPE = {"version": 1, "edits": [{"op": "recolor", "target": {"handle": 3}, "color": "red"}]}
FIGURES = {
    "synthetic": True,
    "plan": {"tier": 0},
    "changed_share": {"front": 0.01, "wrist": 0.02},
    "roles": {"manipulated": {"believed": True, "longest_cm": 12.0}},
    "seconds": {"read": 0.1, "render": 0.2, "write": 0.1},
}


def memory(line: str) -> int:
    """Megabytes that this process has (VmRSS), or had at most (VmHWM)."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(one for one in lines if line in one).split()[1]) // 1000


def dataset(root: Path, count: int) -> None:
    """So many episodes that hold nothing."""
    for number in range(count):
        folder = root / GROUP / f"episode{number}"
        folder.mkdir(parents=True)
        (folder / "low_dim_obs.pkl").touch()


class Played:
    """Workers that write reports alone; how long that took, and the process's megabytes at first, half and last."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self.megabytes: list[int] = []

    def __call__(self, jobs: Sequence[Any]) -> Iterator[Any]:
        from rpaug.pipeline import journal, recipe, report, totals
        from rpaug.pipeline.workers import Outcome

        wanted = recipe.build(RECIPE)
        (option,) = wanted.steps[0].options
        draw = {"step": 0, "op": option.name, "fields": option.fields, "edit": {"surfaces": []}}
        for number, job in enumerate(jobs):
            if number in (0, len(jobs) // 2, len(jobs) - 1):
                self.megabytes.append(memory("VmRSS"))
            for copy, key in job.copies:
                start = time.perf_counter()
                folder = job.target / key
                folder.mkdir(parents=True)
                (folder / "low_dim_obs.pkl").touch()
                described = {**FIGURES, "source": job.key, "copy": copy, "draws": [draw]}
                (folder / report.NAME).write_bytes(report.encode(described))
                self.seconds += time.perf_counter() - start
                facts = totals.facts(described, wanted)
                journal.made(job.target, ("", key), described, facts)
            yield Outcome(job, len(job.copies))


def gone_through(root: Path, out: Path, resume: bool, copies: int) -> dict[str, Any]:
    """Run over all episodes."""
    from rpaug.pipeline import augment, recipe
    from rpaug.pipeline.run import Run

    played, start = Played(), time.perf_counter()
    summary = augment._executed(
        Run(root, recipe.build(RECIPE | {"copies": copies}), out), played, resume, lambda *_: None
    )
    seconds = time.perf_counter() - start - played.seconds
    return {
        "episodes": summary.copies,
        "resumed": summary.resumed,
        "seconds": round(seconds, 2),
        "milliseconds_each": round(1000 * seconds / summary.copies, 3),
        "megabytes": played.megabytes,
        "megabytes_most": memory("VmHWM"),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--episodes", type=int, default=100_000)
    parser.add_argument("--copies", type=int, default=1)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--once", nargs=4, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.once:
        root, out, resume, copies = given.once
        print(json.dumps(gone_through(Path(root), Path(out), resume == "resume", int(copies))))
        return
    figures = {}
    with tempfile.TemporaryDirectory() as folder:
        root, out = Path(folder, "in"), Path(folder, "out")
        dataset(root, given.episodes)
        for name in ("fresh", "resume"):
            told = [str(root), str(out), name, str(given.copies)]
            command = [sys.executable, __file__, "--once", *told]
            env = os.environ | {"OMP_NUM_THREADS": "1"}
            ran = subprocess.run(command, env=env, check=True, capture_output=True, text=True)
            figures[name] = json.loads(ran.stdout)
            print(name, figures[name], flush=True)
    if given.json:
        given.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
