"""Fit Gaussians to one frame of a recording: decibels against seconds.

    python tools/bench/raster_fit.py DATASET [--episode episode0] [--frame 0] [--stride 2] [--iterations 160]
        [--stop iterations] [--target 40.6] [--hold-out 0.1] [--json FILE] [--png FILE]

Every `stride`-th recorded pixel of every camera becomes a Gaussian on its depth; a share of the pixels is held
out, from the start and from the fit. Decibels are PSNR over all cameras' pixels together: fitted ones, and held-out
ones that another camera sees. Seconds exclude compiling and reading and include the checks: on the wall, and as
processor time of all threads (halve it for two idle cores).
"""

import argparse
import dataclasses
import json
import sys
from pathlib import Path

import cv2
import numpy as np

from rpaug.core.registry import adapter
from rpaug.gaussians.densify import Densify
from rpaug.gaussians.frame_fit import Checkpoint, FrameFitSettings, fit_views
from rpaug.gaussians.shots import shots_at
from rpaug.render.splat import Rasteriser


def show(point: Checkpoint) -> None:
    """One line of the trace."""
    unseen = "" if point.held_out_db is None else f"{point.held_out_db:6.2f}"
    print(
        f"{point.iteration:5d} {point.seconds:7.2f} {point.processor_seconds:7.2f} {point.gaussians:7d}"
        f" {point.recorded_db:6.2f} {unseen}",
        flush=True,
    )


def main() -> None:
    """Print a line at each checkpoint."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--episode", default="episode0")
    parser.add_argument("--frame", type=int, default=0)
    parser.add_argument("--stride", type=int, default=2)
    parser.add_argument("--iterations", type=int, default=160)
    parser.add_argument("--batch", type=int, default=2)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--stop", default="iterations")
    parser.add_argument("--target", type=float, default=40.6, help="dB, of --stop fidelity")
    parser.add_argument("--hold-out", type=float, default=0.1)
    parser.add_argument("--keep-order", type=int, default=1)
    parser.add_argument("--no-densify", action="store_true")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--png", type=Path)
    given = parser.parse_args()
    reader = adapter("rlbench")
    keys = [key for key in reader.episodes(given.dataset) if key.endswith(given.episode)]
    if not keys:
        sys.exit(f"{given.dataset} holds no {given.episode}")
    episode = reader.read(given.dataset, keys[0])
    splats, shots = shots_at(episode, given.frame, stride=given.stride, hold_out=given.hold_out)
    settings = FrameFitSettings(
        iterations=given.iterations, batch=given.batch, threads=given.threads, stop=given.stop,
        target_db=given.target, keep_order=given.keep_order,
        densify=None if given.no_densify else Densify(),
    )  # fmt: skip
    print(f"{len(splats)} Gaussians, {len(shots)} views")
    print("steps, wall s, processor s, Gaussians, dB fitted, dB held out")
    fit = fit_views(splats, shots, settings, show)
    print(f"stopped by {fit.stopped}; best at {fit.trace[fit.best].iteration}")
    if given.json:
        rows = [dataclasses.asdict(point) for point in fit.trace]
        given.json.write_text(json.dumps({"rows": rows, "stopped": fit.stopped}, indent=1))
    if given.png:
        pairs = [
            np.vstack([shot.color, Rasteriser().forward(fit.splats, shot.view).color])
            for shot in shots
        ]
        picture = (np.clip(np.hstack(pairs), 0, 1) * 255 + 0.5).astype(np.uint8)
        cv2.imwrite(str(given.png), picture[..., ::-1])


if __name__ == "__main__":
    main()
