"""RVT's own replay buffer inside rpaug's `wrap`; says what of its transitions changes and how far from a refilled one.

Runs where rpaug is, and what RVT's dataset code imports (docs/readers.md).

    python wrap_rvt.py REPLAY EPISODES RECIPE
"""

import json
import sys
from pathlib import Path

import fill_rvt_replay
import numpy as np
from rvt.utils import peract_utils
from yarr.replay_buffer.wrappers.pytorch_replay_buffer import PyTorchReplayBuffer

from rpaug.training import wrap

PLACES = {
    "rgb": "rgb",
    "depth": "depth",
    "points": "point_cloud",
    "cam_to_world": "camera_extrinsics",
}
TRANSITION = ("sample_frame", "keypoint_frame", "next_keypoint_frame", "keypoint_idx")


def main():
    replay, recordings, recipe = sys.argv[1:]
    sys.stdout, stated = sys.stderr, sys.stdout  # RVT prints
    episodes = Path(recordings) / "all_variations/episodes"
    buffer = fill_rvt_replay.buffer(Path(replay), episodes, 1)
    augmented = wrap(
        PyTorchReplayBuffer(buffer, num_workers=0).dataset(),
        recordings,
        recipe,
        episode=lambda s: [
            f"all_variations/episodes/episode{int(n)}" for n in s["episode_idx"].flatten()
        ],
        frame=lambda s: s["sample_frame"].flatten().tolist(),
        cameras={
            name: {kind: f"{name}_{place}" for kind, place in PLACES.items()}
            for name in peract_utils.CAMERAS
        },
    )
    sample = next(iter(augmented))
    asked = [int(sample[name].flatten()[0]) for name in TRANSITION]
    plain = next(
        one
        for one in fill_rvt_replay.rows(buffer)
        if [int(one[name]) for name in TRANSITION] == asked
    )
    edited = {name: np.asarray(value)[0] for name, value in sample.items() if name in plain}
    changed = [name for name, value in edited.items() if not np.array_equal(value, plain[name])]
    moved = edited["front_camera_extrinsics"].reshape(4, 4)
    points, depth = edited["front_point_cloud"], edited["front_depth"]
    rows, columns = np.indices(depth.shape[-2:])
    K = edited["front_camera_intrinsics"].reshape(3, 3)
    ray = np.stack([(columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1], np.ones(rows.shape)])
    there = np.einsum("ij,jhw->ihw", moved[:3, :3], ray * depth.reshape(rows.shape))
    off = np.abs(there + moved[:3, 3, None, None] - points.reshape(3, *rows.shape))
    report = {"batch": len(sample["action"]), "changed": sorted(changed), "off_m": float(off.max())}
    stated.write(json.dumps(report))
    stated.flush()


main()
