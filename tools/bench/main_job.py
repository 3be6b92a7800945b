"""Seconds and memory of `rpaug augment` on one episode, read to written, split by stage.

    python tools/bench/main_job.py [--dataset FOLDER] [--repeat 5] [--json]

The recipe has two tier-0 edits: the manipulated object's color and the light. Each run is a process of its own, so
start-up and kernel loading count; the first run is left out, since it may compile kernels. Peak memory is the largest
resident set of the process (getrusage). Without --dataset the embedded sample is used.
"""

import argparse
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import rpaug

RECIPE = {
    "version": 1,
    "seed": 7,
    "copies": 1,
    "select": {"limit": 1},
    "edits": [
        {"op": "recolor", "target": {"role": "manipulated"}, "color": "blue"},
        {"op": "light_color", "range": [[0.3, 0.3, 0.3], [0.5, 0.5, 0.5]]},
    ],
}


def once(dataset: Path, recipe: Path, out: Path) -> dict[str, Any]:
    """One run of the command: wall seconds, seconds by stage, peak megabytes."""
    command = [
        sys.executable,
        "-m",
        "rpaug",
        "augment",
        str(dataset),
        "--recipe",
        str(recipe),
        "--out",
        str(out),
    ]
    start = time.perf_counter()
    done = subprocess.run([*command, "--json"], check=True, capture_output=True, text=True)
    wall = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    return {"wall": wall, "peak_mb": peak, **json.loads(done.stdout)["seconds"]}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--dataset", type=Path, default=Path(rpaug.__file__).parent / "sample")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    runs = []
    with tempfile.TemporaryDirectory() as folder:
        recipe = Path(folder) / "recipe.yaml"
        recipe.write_text(json.dumps(RECIPE))
        for _ in range(arguments.repeat + 1):
            out = Path(folder) / "out"
            runs.append(once(arguments.dataset, recipe, out))
            shutil.rmtree(out)
    runs = runs[1:]
    median = {name: round(statistics.median(run[name] for run in runs), 2) for name in runs[0]}
    worst = {name: round(max(run[name] for run in runs), 2) for name in runs[0]}
    if arguments.json:
        sys.stdout.write(
            json.dumps({"cores": os.cpu_count(), "median": median, "worst": worst}) + "\n"
        )
        return
    sys.stdout.write(f"{'':12}{'median':>10}{'worst':>10}\n")
    for name in median:
        unit = "MB" if name == "peak_mb" else "s"
        sys.stdout.write(f"{name:12}{median[name]:>10}{worst[name]:>10} {unit}\n")


if __name__ == "__main__":
    main()
