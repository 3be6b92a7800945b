"""Fit Gaussians to the recorded views of one frame: decibels against seconds.

    RPAUG_TEST_DATA=... python tools/bench/raster_fit.py [--episode episode0] [--frame 0] [--stride 2]
        [--iterations 400] [--batch 5] [--workers 2] [--hold-out 0.1] [--json FILE] [--png FILE]

Every `stride`-th recorded pixel becomes a Gaussian, lifted by its depth; each iteration takes the gradient
of the squared colour error over `batch` cameras and makes one Adam step, rates falling as a cosine. Views are
shared between `workers` threads, one thread a view. A share of the pixels is held out (weight 0) and
judged apart. Seconds exclude compiling, reading and judging, once on the wall and once as processor time of all
threads (halve it for two idle cores); decibels are PSNR over all cameras' pixels together.
"""

import argparse
import json
import os
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from rpaug import geometry
from rpaug.registry import adapter
from rpaug.render.splat import Adam, Gradients, Rasteriser, Rates, Splats, View
from rpaug.scene.gaussians import Picture, joined, lifted


@dataclass(frozen=True)
class Shot:
    """One camera's image with its pixels split in two."""

    view: View
    target: np.ndarray
    trained: np.ndarray  # weights: 0 where held out


def shots(
    root: Path, episode: str, t: int, stride: int, held_out: float
) -> tuple[Splats, list[Shot]]:
    """The Gaussians to start from and the images to fit."""
    rng = np.random.default_rng(0)
    reader = adapter("rlbench")
    key = next(key for key in reader.episodes(root) if key.endswith(episode))
    recorded = reader.read(root, key)
    parts, made = [], []
    for view in recorded.views.values():
        camera, rgb, depth = view.camera, view.rgb(t), view.depth(t)
        use = np.zeros(depth.shape, bool)
        use[::stride, ::stride] = True
        ids = np.zeros(depth.shape, np.int32) if view.ids is None else view.ids(t)
        parts.append(
            lifted(Picture(rgb, depth, ids, camera.K, camera.cam_to_world[t], use), stride)
        )
        pose = geometry.inverse(camera.cam_to_world[t])
        target = rgb.astype(np.float32) / 255
        weight = (rng.uniform(size=depth.shape) >= held_out).astype(np.float32)
        made.append(Shot(View(camera.K, pose, camera.width, camera.height), target, weight))
    return Splats.of(joined(parts)), made


def total(several: list[Gradients]) -> Gradients:
    """The sum over views, in their order."""
    first, *rest = several
    for name in ("means", "opacities", "sh", "quats", "scales"):
        for other in rest:
            np.add(getattr(first, name), getattr(other, name), out=getattr(first, name))
    return first


def decibels(splats: Splats, given: list[Shot]) -> tuple[float, float | None]:
    """PSNR of the trained and of the held-out pixels."""
    errors, weights = [], []
    for shot in given:
        colour = np.clip(Rasteriser().forward(splats, shot.view, surface=False).colour, 0, 1)
        errors.append(((colour - shot.target) ** 2).mean(-1).ravel())
        weights.append(shot.trained.ravel())
    error, trained = np.concatenate(errors), np.concatenate(weights) > 0
    held = None if trained.all() else float(-10 * np.log10(error[~trained].mean()))
    return float(-10 * np.log10(error[trained].mean())), held


def main() -> None:
    """Print a line at each checkpoint."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--episode", default="episode0")
    parser.add_argument("--frame", type=int, default=0)
    parser.add_argument("--stride", type=int, default=2)
    parser.add_argument("--iterations", type=int, default=400)
    parser.add_argument("--batch", type=int, default=5)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--hold-out", type=float, default=0.1)
    parser.add_argument("--rate", type=float, default=1.0, help="factor on all learning rates")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--png", type=Path)
    given = parser.parse_args()
    data = os.environ.get("RPAUG_TEST_DATA")
    if data is None:
        sys.exit("set RPAUG_TEST_DATA to the folder of recorded samples")
    start, views = shots(
        Path(data) / "rlbench_open_drawer", given.episode, given.frame, given.stride, given.hold_out
    )
    engines = [Rasteriser() for _ in views]

    def pull(at: int, splats: Splats) -> Gradients:
        shot = views[at]
        engines[at].forward(splats, shot.view, surface=False)
        return engines[at].backward_squared_error(shot.target, shot.trained)[2]

    Adam(start).step(pull(0, start))  # compiles
    rates = Rates(
        means=given.rate * Rates().means,
        quats=given.rate * Rates().quats,
        scales=given.rate * Rates().scales,
        opacities=given.rate * Rates().opacities,
        sh=given.rate * Rates().sh,
    )
    adam = Adam(start, rates, threads=given.workers)
    checkpoints = {given.iterations * k // 8 for k in range(9)}
    wall, cpu, rows = 0.0, 0.0, []
    print(
        f"{len(start)} Gaussians, {len(views)} views; iterations, wall s, processor s, dB trained, held out"
    )
    with ThreadPoolExecutor(given.workers) as pool:
        for step in range(given.iterations + 1):
            if step in checkpoints:
                train, held = decibels(adam.splats, views)
                row = {"step": step, "wall": wall, "cpu": cpu, "trained": train, "held_out": held}
                rows.append(row)
                shown = "" if held is None else f"{held:6.2f}"
                print(f"{step:5d} {wall:7.2f} {cpu:7.2f} {train:6.2f} {shown}", flush=True)
            begin = time.perf_counter(), time.process_time()
            chosen = [(step * given.batch + k) % len(views) for k in range(given.batch)]
            slopes = list(pool.map(pull, chosen, [adam.splats] * given.batch))
            wave = 0.5 * (1 + np.cos(np.pi * step / given.iterations))
            adam.step(total(slopes), 0.03 + 0.97 * wave)
            wall += time.perf_counter() - begin[0]
            cpu += time.process_time() - begin[1]
    if given.json:
        given.json.write_text(json.dumps({"gaussians": len(start), "rows": rows}, indent=1))
    if given.png:
        pairs = [
            np.vstack([s.target, Rasteriser().forward(adam.splats, s.view).colour]) for s in views
        ]
        picture = (np.clip(np.hstack(pairs), 0, 1) * 255 + 0.5).astype(np.uint8)
        cv2.imwrite(str(given.png), picture[..., ::-1])


if __name__ == "__main__":
    main()
