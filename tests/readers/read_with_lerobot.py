"""What LeRobot's own loader makes of a dataset; prints JSON. Runs under LeRobot, without rpaug.

    python read_with_lerobot.py FOLDER FRAMES_OUT

Saves to FRAMES_OUT (npz) every image and number of some frames of each episode, by `<frame>/<feature>`.
"""

import json
import sys

import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset

LOOKED_AT = 5  # frames of each episode


def main():
    folder, out = sys.argv[1:]
    dataset = LeRobotDataset("local/dataset", root=folder, video_backend="pyav")
    frames, tasks = {}, {}
    for episode in dataset.meta.episodes:
        first, end = episode["dataset_from_index"], episode["dataset_to_index"]
        for index in sorted({round(i) for i in np.linspace(first, end - 1, LOOKED_AT)}):
            item = dataset[index]
            tasks[index] = item.pop("task")
            frames |= {f"{index}/{key}": np.asarray(value) for key, value in item.items()}
    np.savez(out, **frames)
    stated = {
        "rpaug": "rpaug" in sys.modules,
        "episodes": dataset.num_episodes,
        "frames": dataset.num_frames,
        "length": len(dataset),
        "lengths": [episode["length"] for episode in dataset.meta.episodes],
        "tasks": tasks,
        "statistics": {
            key: {name: np.asarray(value).tolist() for name, value in one.items()}
            for key, one in dataset.meta.stats.items()
        },
        "cameras": dataset.meta.camera_keys,
        "depth": dataset.meta.depth_keys,
    }
    print(json.dumps(stated))


if __name__ == "__main__":
    main()
