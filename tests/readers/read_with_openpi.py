"""What lerobot 0.1.0, as openpi pins it, makes of a dataset of v2.1; prints JSON. Runs without rpaug.

    python read_with_openpi.py FOLDER FRAMES_OUT

Saves to FRAMES_OUT (npz) every image and number of each frame, by `<frame>/<feature>`.
"""

import json
import sys

import numpy as np
from lerobot.common.datasets.lerobot_dataset import LeRobotDataset


def main():
    folder, out = sys.argv[1:]
    dataset = LeRobotDataset("local/dataset", root=folder, video_backend="pyav")
    frames, tasks = {}, []
    for index in range(len(dataset)):
        item = dataset[index]
        tasks.append(item.pop("task"))
        frames |= {
            f"{index}/{key}": np.asarray(value)
            for key, value in item.items()
            if not isinstance(value, str)
        }
    np.savez(out, **frames)
    stated = {
        "rpaug": "rpaug" in sys.modules,
        "lengths": [dataset.meta.episodes[i]["length"] for i in range(dataset.num_episodes)],
        "tasks": tasks,
        "statistics": {
            key: {name: np.asarray(value).tolist() for name, value in one.items()}
            for key, one in dataset.meta.stats.items()
        },
    }
    print(json.dumps(stated))


if __name__ == "__main__":
    main()
