"""How well and how fast Gaussians show a recorded episode: decibels, SSIM, depth, seconds.

    python tools/bench/fit.py DATASET [--episode KEY] [--leave-out CAMERA] [--stop fidelity]
        [--pictures FOLDER] [--json]

PSNR and SSIM (up) are means over views of the re-rendered against the recorded image, with moving cameras
where the fit found them to stand; `recorded pose` is the same with their poses as recorded. Fit seconds
include seeds and are wall time; CPU seconds are summed over threads, for machines that are shared.
`--leave-out` fits without one camera and shows what that camera would see.
"""

import argparse
import json
import resource
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from rpaug.core import registry
from rpaug.core.files import encode_png, write_atomic
from rpaug.core.sampling import frames
from rpaug.core.types import Scene
from rpaug.gaussians import fit, gaussian_view
from rpaug.gaussians.descent import settings_for
from rpaug.scene.build import build

TIMES = 12  # frames looked at per camera


def main() -> None:
    """Fit one episode and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--episode", help="key; the first if not given")
    parser.add_argument("--stop", choices=("heldout", "fidelity"), default="heldout")
    parser.add_argument("--target", type=float, help="dB, of --stop fidelity")
    parser.add_argument("--steps", type=int, help="at most")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--leave-out", metavar="CAMERA")
    parser.add_argument(
        "--pictures", type=Path, help="recorded / rendered / difference x 4, as PNGs"
    )
    parser.add_argument("--json", action="store_true", help="print everything as JSON")
    given = parser.parse_args()

    adapter = registry.adapter_for(given.dataset)
    key = given.episode or adapter.episodes(given.dataset)[0]
    scene = build(adapter.read(given.dataset, key), with_bodies=True)
    used = scene
    if given.leave_out:
        views = {n: v for n, v in scene.episode.views.items() if n != given.leave_out}
        used = replace(scene, episode=replace(scene.episode, views=views))
    start, cpu = time.perf_counter(), time.process_time()
    settings = settings_for(given.stop, target=given.target, steps=given.steps)
    settings = replace(settings, threads=given.threads)
    shown, report = fit.fitted(used, settings=settings, seed=given.seed)
    kept_out = ("bodies", "pose_correction", "irradiance")
    facts = {n: v for n, v in vars(report).items() if n not in kept_out and v is not None}
    facts["wall_seconds"] = time.perf_counter() - start
    facts["cpu_seconds"] = time.process_time() - cpu
    facts["peak_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    shown = replace(shown, episode=scene.episode, cameras=scene.cameras)
    facts["views"] = {name: _camera(shown, name) for name in scene.episode.views}
    still = [n for n, v in scene.episode.views.items() if v.camera.fixed and n != given.leave_out]
    facts["fixed_cameras_db"] = float(np.mean([facts["views"][n]["db"] for n in still]))
    kept = [facts["views"][n]["db"] for n in scene.episode.views if n != given.leave_out]
    facts["all_cameras_db"] = float(np.mean(kept))
    facts["fixed_cameras_ssim"] = float(np.mean([facts["views"][n]["ssim"] for n in still]))
    if given.pictures:
        _pictures(shown, given.pictures)
    print(json.dumps(facts, indent=1) if given.json else _table(facts))


def _camera(scene: Scene, name: str) -> dict[str, float]:
    view = scene.episode.views[name]
    found: dict[str, list[float]] = {
        k: [] for k in ("db", "ssim", "recorded_pose_db", "wrong_ids", "depth_mm")
    }
    plain = replace(scene, pose_correction={})
    for t in frames(scene.episode.length, TIMES):
        rgb, depth, ids = gaussian_view.render_view(scene, name, t)
        truth = view.rgb(t)
        found["db"].append(fit.psnr(rgb, truth))
        found["ssim"].append(fit.ssim(rgb, truth))
        found["recorded_pose_db"].append(
            fit.psnr(gaussian_view.render_view(plain, name, t)[0], truth)
        )
        assert view.ids is not None
        assert view.depth is not None
        found["wrong_ids"].append(float((ids != view.ids(t)).mean()))
        found["depth_mm"].append(1e3 * float(np.median(np.abs(depth - view.depth(t)))))
    return {k: float(np.mean(v)) for k, v in found.items()}


def _pictures(scene: Scene, folder: Path) -> None:
    for t in frames(scene.episode.length, 4):
        columns = []
        for name, view in scene.episode.views.items():
            rgb, truth = gaussian_view.render_view(scene, name, t)[0], view.rgb(t)
            off = np.clip(4 * np.abs(rgb.astype(int) - truth), 0, 255).astype(np.uint8)
            columns.append(np.vstack([truth, rgb, off]))
        image = np.hstack(columns).repeat(3, 0).repeat(3, 1)
        write_atomic(folder / f"fit_{t:04d}.png", encode_png(image))


def _table(facts: dict) -> str:
    lines = [
        f"{facts['gaussians']} Gaussians, {facts['steps']} steps, {facts['wall_seconds']:.1f} s wall, "
        f"{facts['cpu_seconds']:.1f} s CPU, {facts['moments']} moments, peak {facts['peak_mb']:.0f} MB",
        f"fitted times {facts['train_db']:.2f} dB, held-out times {facts.get('held_out_db', 0.0):.2f} dB, "
        f"all cameras {facts['all_cameras_db']:.2f} dB, fixed cameras {facts['fixed_cameras_db']:.2f} dB, "
        f"SSIM {facts['fixed_cameras_ssim']:.3f}",
        f"{'camera':18}{'dB':>8}{'SSIM':>8}{'recorded pose dB':>18}{'wrong ids %':>13}{'depth mm':>10}",
    ]
    for name, row in facts["views"].items():
        lines.append(
            f"{name:18}{row['db']:8.2f}{row['ssim']:8.3f}{row['recorded_pose_db']:18.2f}"
            f"{100 * row['wrong_ids']:13.2f}{row['depth_mm']:10.2f}"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
