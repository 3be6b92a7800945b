"""Seconds on a GPU: the fit of a large recording from one moving camera, edits of it, and the rasteriser alone.

    python -m tools.bench.gpu [--part fit --part edits --part raster] [--device cuda] [--json]

The recording (120 frames of 1918x1237, depth and masks, in RLBench's layout) is made first, by all cores, and not
counted; `--dataset` keeps it for the next run. `fit` is `rpaug fit` as a process of its own, start-up and reading
included; `edits` are `rpaug augment` each. Both are run on a tiny recording before, so that nothing is compiled
meanwhile. `raster` is one step of a fit: a view drawn, and its loss's gradients brought back, transfers included.
RoboPearls reports 70 minutes for the fit, and 1, 5, 6, 6 and 7 minutes for a color, a texture, an insertion, a
removal and physics.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from rpaug.core import devices
from rpaug.render.splat import SplatEngine, cores, engine
from tools.bench import large
from tools.bench.harness import filmed
from tools.bench.raster import scene

EDITS: dict[str, dict[str, Any]] = {
    **{name: large.EDITS[name] for name in ("color", "texture", "remove")},
    "insert": {"op": "distractors", "count": 1},
    "physics": {
        "op": "physics",
        "target": {"handle": 3},
        "material": "rubber",
        "height": [0.1, 0.1],
    },
}
SIZES = [(640, 480, 50_000), (640, 480, 200_000), (1918, 1237, 300_000), (1918, 1237, 1_000_000)]
TIMES = 5  # of each step, after one that is not counted
Rows = dict[str, dict[str, Any]]


def fit(dataset: Path, device: str, steps: int | None) -> dict[str, Any]:
    """Seconds of the command on the wall, and what it says of the fit."""
    with tempfile.TemporaryDirectory() as store:
        command = [sys.executable, "-m", "rpaug", "fit", str(dataset), "--out", f"{store}/scenes"]
        command += ["--device", device, "--json"] + (["--steps", str(steps)] if steps else [])
        start = time.perf_counter()
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
        wall = time.perf_counter() - start
    told = json.loads(done.stdout)
    names = ("train_db", "held_out_db", "depth_error_mm", "gaussians", "steps")
    return {"wall": wall, "fit alone": told["seconds"], **{name: told[name] for name in names}}


def edits(dataset: Path, device: str, names: list[str]) -> Rows:
    """Each edit, read to written: seconds on the wall and of the processor, and of each stage."""
    found: Rows = {}
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            try:
                found[name] = large.seconds(dataset, EDITS[name], Path(folder), "--device", device)
            except subprocess.CalledProcessError as failed:
                found[name] = {"failed": (failed.stdout + failed.stderr)[-300:]}
    return found


def raster(device: str) -> Rows:
    """Milliseconds of one view of a fit, drawn and pulled back, on the device and on the CPU kernels."""
    rows = {}
    for width, height, count in SIZES:
        splats, view = scene(width, height, count)
        target = np.full((height, width, 3), 0.5, np.float32)
        depth = np.full((height, width), 2.0, np.float32)
        row = {}
        for name in dict.fromkeys((devices.backend(device), "auto")):
            eye = engine(name, threads=cores())
            row[_words(name, "draw")] = _milliseconds(partial(_drawn, eye, splats, view))
            pulled = partial(eye.backward_squared_error, target, None, depth, 3.0)
            row[_words(name, "step")] = _milliseconds(partial(_step, eye, splats, view, pulled))
        rows[f"{width}x{height}, {count}"] = row
    return rows


def _words(backend: str, what: str) -> str:
    return f"{'cpu' if backend == 'auto' else backend} {what}, ms"


def _drawn(eye: SplatEngine, splats: Any, view: Any) -> None:
    eye.forward(splats, view, surface=False)


def _step(eye: SplatEngine, splats: Any, view: Any, pulled: Callable[[], Any]) -> None:
    eye.prepare(splats, view)
    pulled()


def _milliseconds(job: Callable[[], None]) -> float:
    """The median; images and gradients come back as numpy, so that a GPU has finished."""
    job()
    found = []
    for _ in range(TIMES):
        start = time.perf_counter()
        job()
        found.append(1e3 * (time.perf_counter() - start))
    return median(found)


def measured(asked: argparse.Namespace, device: str, folder: Path) -> dict[str, Rows]:
    """The parts that are asked for."""
    found: dict[str, Rows] = {}
    if "raster" in asked.part:
        found["raster"] = raster(device)
    if not {"fit", "edits"} & set(asked.part):
        return found
    dataset, size = asked.dataset or folder / "large", (asked.frames, asked.width, asked.height)
    start = time.perf_counter()
    if not dataset.exists():
        filmed.written(dataset, *size, moves=True, processes=cores())
    found["recording"] = {"made": {"wall": time.perf_counter() - start}}
    warm = filmed.written(folder / "warm", 12, 240, 160, moves=True)
    if "fit" in asked.part:
        fit(warm, device, 4)
        found["fit"] = {device: fit(dataset, device, asked.steps)}
    if "edits" in asked.part:
        edits(warm, device, asked.edit)
        found["edits"] = edits(dataset, device, asked.edit)
    return found


def main() -> None:
    """Record, measure, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parts = ("raster", "fit", "edits")
    parser.add_argument("--part", action="append", choices=parts, help="All if none is given.")
    parser.add_argument("--device", default="auto", choices=("auto", "cpu", "cuda"))
    parser.add_argument("--edit", action="append", choices=list(EDITS))
    parser.add_argument("--steps", type=int, help="Of the fit, at most.")
    parser.add_argument("--dataset", type=Path, help="Where the recording is, or is to be kept.")
    parser.add_argument("--frames", type=int, default=120)
    parser.add_argument("--width", type=int, default=1918)
    parser.add_argument("--height", type=int, default=1237)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    asked.part, asked.edit = asked.part or parts, asked.edit or list(EDITS)
    used = devices.chosen(asked.device)
    with tempfile.TemporaryDirectory() as name:
        found = measured(asked, used.name, Path(name))
    told = {"device": used.name, "which": used.why, "cores": cores(), **found}
    if asked.json:
        sys.stdout.write(json.dumps(told) + "\n")
        return
    sys.stdout.write(f"{used.name}: {used.why}; {cores()} cores\n")
    for part, rows in found.items():
        for row, values in rows.items():
            listed = "  ".join(
                f"{k} {v:.2f}" if isinstance(v, float) else f"{k} {v}" for k, v in values.items()
            )
            sys.stdout.write(f"{part:10}{row:24}{listed}\n")


if __name__ == "__main__":
    main()
