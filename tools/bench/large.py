"""Seconds of edits on a large recording: one camera, 1920x1080, 121 frames, read to written.

    python tools/bench/large.py [--frames 121] [--width 1920] [--height 1080] [--edit color] [--json]

The recording is made once: a table seen by one fixed camera, a ball that rolls over it and one that lies beside, depth
and masks, in RLBench's format. Each edit is then a process of its own (`rpaug augment`), so start-up counts; kernels
are compiled beforehand. RoboPearls reports 1 minute for a color, 5 for a texture and 6 for a removal or an insertion.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from rpaug import Camera, CameraView, Episode, Robot
from rpaug.core import geometry, registry

EDITS: dict[str, dict[str, Any]] = {
    "color": {"op": "recolor", "target": {"handle": 2}, "color": "blue"},
    "texture": {"op": "retexture", "target": {"handle": 2}, "texture": "oak"},
    "table's texture": {"op": "retexture", "target": {"handle": 1}, "texture": "oak"},
    "light": {"op": "light_color"},
    "remove": {"op": "remove", "target": {"handle": 3}},
    "distractors": {"op": "distractors", "count": 2},
}
RADIUS, LYING, HEIGHT = 0.15, 0.06, 1.2  # metres: of the balls, and of the camera over the table


def recording(frames: int, width: int, height: int) -> Episode:
    """The camera looks straight down on a patterned table (handle 1), a ball that rolls (2) and one that lies (3)."""
    K = np.array([[width * 0.8, 0, width / 2], [0, width * 0.8, height / 2], [0, 0, 1.0]])
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = HEIGHT
    camera = Camera(K, np.tile(pose, (frames, 1, 1)), width, height)
    rows, columns = np.mgrid[:height, :width]
    across, down = geometry.slopes(columns, rows, K)

    @lru_cache(4)
    def shoot(t: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        z, ids, facing = np.full(across.shape, HEIGHT), np.ones(across.shape, np.int32), 1.0
        along = 1 + across**2 + down**2
        rolls = -0.3 + 0.6 * t / max(frames - 1, 1), 0.1, RADIUS
        for instance_id, (x, y, radius) in ((2, rolls), (3, (-0.45, -0.22, LYING))):
            middle = np.array([x, y, HEIGHT - radius])
            reach = across * middle[0] + down * middle[1] + middle[2]
            inside = reach**2 - along * (middle @ middle - radius**2)
            ball = inside > 0
            z = np.where(ball, (reach - np.sqrt(np.maximum(inside, 0))) / along, z)
            ids = np.where(ball, instance_id, ids).astype(np.int32)
            facing = np.where(ball, (middle[2] - z) / radius, facing)
        grain = 0.85 + 0.1 * np.sin(40 * across * z) * np.sin(31 * down * z)
        albedo = np.choose(
            (ids - 1)[..., None],
            [
                grain[..., None] * [0.7, 0.6, 0.5],
                np.array([0.8, 0.2, 0.15]),
                np.array([0.2, 0.5, 0.2]),
            ],
        )
        rgb = np.rint(255 * albedo * (0.3 + 0.7 * np.maximum(facing, 0))[..., None])
        return rgb.astype(np.uint8), z.astype(np.float32), ids

    view = CameraView(camera, lambda t: shoot(t)[0], lambda t: shoot(t)[1], lambda t: shoot(t)[2])
    robot = Robot(
        np.zeros((frames, 7)),
        np.zeros((frames, 7)),
        np.tile(np.eye(4), (frames, 1, 1)),
        np.ones(frames),
    )
    return Episode(
        "large/all_variations/episodes/episode0", {"front": view}, robot, ("roll",), frames
    )


def seconds(dataset: Path, edit: dict[str, Any], folder: Path) -> dict[str, float]:
    """Wall and processor seconds of one run of the command, and its stages."""
    recipe = folder / "recipe.yaml"
    recipe.write_text(json.dumps({"version": 1, "edits": [edit]}))
    before, start = os.times(), time.perf_counter()
    command = [sys.executable, "-m", "rpaug", "augment", str(dataset), "--json"]
    done = subprocess.run(
        [*command, "--recipe", str(recipe), "--out", str(folder / "out")],
        check=True,
        capture_output=True,
        text=True,
    )
    wall, after = time.perf_counter() - start, os.times()
    spent = (
        after.children_user + after.children_system - before.children_user - before.children_system
    )
    stages = json.loads(done.stdout)["seconds"]
    return {"wall": wall, "processor": spent, **stages}


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
    arguments = parser.parse_args()
    table = {}
    with tempfile.TemporaryDirectory() as name:
        dataset = Path(name) / "large"
        made = recording(arguments.frames, arguments.width, arguments.height)
        registry.adapter("rlbench").write(made, dataset, made.key, dict)
        warm = Path(name) / "warm"
        small = recording(4, 64, 48)
        registry.adapter("rlbench").write(small, warm, small.key, dict)
        for edit in arguments.edit or EDITS:
            for root in (warm, dataset):
                with tempfile.TemporaryDirectory() as folder:
                    table[edit] = seconds(root, EDITS[edit], Path(folder))
    table = {edit: {k: round(v, 2) for k, v in row.items()} for edit, row in table.items()}
    if arguments.json:
        sys.stdout.write(json.dumps(table) + "\n")
        return
    for edit, row in table.items():
        sys.stdout.write(f"{edit:16}{'  '.join(f'{k} {v}' for k, v in row.items())}\n")


if __name__ == "__main__":
    main()
