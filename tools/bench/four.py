"""Gaussians in space and time beside rigid parts, on the twin's towel and soft hand, at times that no fit saw.

    python tools/bench/four.py [--seeds 3] [--frames 40] [--steps 500] [--split] [--sheet four.png] [--json]

For each task and seed: the scene is fitted with rigid parts to every other frame, then what they leave unexplained is
fitted in four dimensions. Printed are the decibels (PSNR, up) of the soft thing's own recorded pixels in the frames
between, pooled over the fixed cameras and over the wrist camera, rigid and 4D; the share of its pixels whose depth is
off by more than two pixel widths (down); its Gaussians; and the processor seconds of both fits. `all` are the decibels
of whole images. `--split` tells where the wrist camera's error in 4D is: pixels by what they are, with their share of
all, their share of the squared error and their decibels. The sheet shows truth, rigid parts, 4D and three times its
error, row by row.
"""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rpaug import twin
from rpaug.core.metrics import psnr
from rpaug.core.types import Scene
from rpaug.gaussians import fit, fit4, gaussian_view
from rpaug.gaussians.descent import FitSettings
from rpaug.scene.build import build
from rpaug.twin.soft_tasks import SOFT_TASKS

SIDE = 64  # pixels of one picture on the sheet
AT_THE_LENS = 0.03  # metres of median depth: where the thing hangs over the camera


def whole_db(scene: Scene, times: list[int], cameras: list[str]) -> float:
    """PSNR of whole images, mean over views."""
    found = [
        fit.psnr(gaussian_view.render_view(scene, name, t)[0], scene.episode.views[name].rgb(t))
        for name in cameras
        for t in times
    ]
    return float(np.mean(found))


def split(scene: Scene, instance_id: int, times: list[int]) -> dict[str, list[float]]:
    """Share of the wrist camera's pixels of the thing, share of their squared error, and decibels, by kind."""
    view = scene.episode.views["wrist"]
    assert view.ids is not None
    assert view.depth is not None
    sums: dict[str, np.ndarray] = {}
    for t in times:
        mine = view.ids(t) == instance_id
        if not mine.any():
            continue
        image, _, drawn = gaussian_view.render_view(scene, "wrist", t)
        error = ((image.astype(float) - view.rgb(t)) ** 2).mean(-1)
        inner = cv2.erode(mine.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1) > 0
        near = bool(np.median(view.depth(t)[mine]) < AT_THE_LENS)
        kinds = {
            "frames at the lens": mine & near,
            "something else or nothing drawn": mine & (drawn != instance_id) & (not near),
            "outline": mine & (drawn == instance_id) & ~inner & (not near),
            "inside": mine & (drawn == instance_id) & inner & (not near),
            "all but frames at the lens": mine & (not near),
        }
        for name, where in kinds.items():
            found = np.array([where.sum(), error[where].sum()])
            sums[name] = sums.get(name, np.zeros(2)) + found
    last = "all but frames at the lens"
    whole = sums[last] + sums["frames at the lens"] if sums else np.ones(2)
    return {
        name: [*(part / whole).round(3).tolist(), round(_db(part), 2)]
        for name, part in sums.items()
        if part[0]
    }


def _db(part: np.ndarray) -> float:
    """PSNR of a count of pixels and the sum of their squared errors."""
    return psnr(part[1] / part[0], 1e-6)


def measure(
    task: str, seed: int, frames: int, steps: int, changed: dict[str, Any]
) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Figures of one recording, and pictures of it."""
    take = twin.perform(task, seed, frames=frames)
    instance_id = take.truth.handles[take.truth.manipulated]
    start = time.process_time()
    scene = build(take.episode, with_bodies=True)
    settings = FitSettings(steps=steps, train_frames=frames // 2, checked_frames=2)
    rigid, _ = fit.fitted(scene, settings=settings)
    middle = time.process_time()
    settings4 = fit4.FourSettings(train_frames=frames // 2, **changed)
    four, report = fit4.fitted(rigid, settings=settings4)
    end = time.process_time()
    fixed = [name for name, view in take.episode.views.items() if view.camera.fixed]
    seen = set(np.linspace(0, frames - 1, frames // 2).round().astype(int).tolist())
    unseen = [t for t in range(frames) if t not in seen][1::2]
    row: dict[str, Any] = {"task": task, "seed": seed, "handle": instance_id}
    for name, made in (("rigid", rigid), ("four", four)):
        still = fit4.residuals(made, unseen, cameras=fixed)[instance_id]
        wrist = fit4.residuals(made, unseen, cameras=["wrist"]).get(instance_id)
        row[name] = {
            "db": round(still.db, 2),
            "wrist_db": round(wrist.db, 2) if wrist else None,
            "off": round(still.off, 3),
            "all_db": round(whole_db(made, unseen[::3], fixed), 2),
        }
    names = {number: name for name, number in take.truth.handles.items()}
    row |= {
        "taken": [names[h] for h in report.instance_ids],
        "gaussians": report.gaussians,
        "rigid_seconds": round(middle - start, 1),
        "four_seconds": round(end - middle, 1),
        "split": split(four, instance_id, unseen),
    }
    columns = [pictures(rigid, four, instance_id, camera, t) for camera, t in shown(unseen)]
    return row, columns


def shown(unseen: list[int]) -> list[tuple[str, int]]:
    """Cameras and times of the sheet."""
    few = [unseen[i] for i in np.linspace(1, len(unseen) - 1, 4).round().astype(int)]
    return [(camera, t) for camera in ("front", "left_shoulder") for t in few]


def pictures(rigid: Scene, four: Scene, instance_id: int, camera: str, t: int) -> np.ndarray:
    """Truth, rigid, 4D and 4D's error, one below the other, around the thing."""
    view = four.episode.views[camera]
    assert view.ids is not None
    rows, columns = np.nonzero(view.ids(t) == instance_id)
    height, width = view.camera.height, view.camera.width
    top = (
        int(np.clip((rows.min() + rows.max()) // 2 - SIDE // 2, 0, height - SIDE))
        if len(rows)
        else 0
    )
    left = (
        int(np.clip((columns.min() + columns.max()) // 2 - SIDE // 2, 0, width - SIDE))
        if len(rows)
        else 0
    )
    window = np.s_[top : top + SIDE, left : left + SIDE]
    truth = view.rgb(t)[window]
    images = [gaussian_view.render_view(scene, camera, t)[0][window] for scene in (rigid, four)]
    error = np.clip(3 * np.abs(images[1].astype(int) - truth), 0, 255).astype(np.uint8)
    return np.vstack([truth, *images, error])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--tasks", nargs="+", default=list(SOFT_TASKS), choices=list(SOFT_TASKS))
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--steps", type=int, default=500)
    parser.add_argument("--split", action="store_true")
    parser.add_argument("--bridged-share", type=float, help="instead of the setting's")
    parser.add_argument("--sheet", type=Path)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    share = arguments.bridged_share
    changed = {} if share is None else {"bridged_share": share}
    rows, sheet = [], []
    for task in arguments.tasks:
        for seed in range(arguments.seeds):
            row, columns = measure(task, seed, arguments.frames, arguments.steps, changed)
            rows.append(row)
            sheet.append(np.hstack(columns))
            if not arguments.json:
                sys.stdout.write(line(row))
                if arguments.split:
                    sys.stdout.write("".join(f"  {k}: {v}\n" for k, v in row["split"].items()))
                sys.stdout.flush()
    if arguments.sheet:
        picture = cv2.resize(np.vstack(sheet), None, fx=2, fy=2, interpolation=cv2.INTER_NEAREST)
        cv2.imwrite(str(arguments.sheet), picture[..., ::-1])
    if arguments.json:
        sys.stdout.write(json.dumps(rows, indent=1) + "\n")


def line(row: dict[str, Any]) -> str:
    """One row for people."""
    parts = [
        f"{name}: {row[name]['db']:.1f} dB (wrist {row[name]['wrist_db']}), {row[name]['off']:.0%} off, "
        f"all {row[name]['all_db']:.1f}"
        for name in ("rigid", "four")
    ]
    taken = ", ".join(row["taken"]) or "nothing"
    return (
        f"{row['task']} {row['seed']}: {'; '.join(parts)}; taken: {taken}; {row['gaussians']} in 4D; "
        f"{row['rigid_seconds']} + {row['four_seconds']} s\n"
    )


if __name__ == "__main__":
    main()
