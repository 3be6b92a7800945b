"""What GR00T's episode loader makes of a dataset of v2.1 with `modality.json`; prints JSON. Runs without rpaug.

    python read_with_gr00t.py FOLDER FRAMES_OUT

Saves to FRAMES_OUT (npz) states, actions and images of each episode, by `<episode>/<column>`.
"""

import json
import sys
from pathlib import Path

import numpy as np
from gr00t.data.dataset.lerobot_episode_loader import LeRobotEpisodeLoader
from gr00t.data.types import ModalityConfig


def main():
    folder, out = sys.argv[1:]
    modality = json.loads((Path(folder) / "meta/modality.json").read_text())
    keys = {name: list(modality[name]) for name in ("video", "state", "action")}
    keys["language"] = [f"annotation.{name}" for name in modality["annotation"]]
    configs = {
        name: ModalityConfig(delta_indices=[0], modality_keys=given) for name, given in keys.items()
    }
    loader = LeRobotEpisodeLoader(folder, configs, video_backend="opencv")
    frames, words = {}, []
    for number in range(len(loader)):
        rows = loader[number]
        words.append({name: list(rows[name]) for name in rows if name.startswith("language.")})
        frames |= {
            f"{number}/{name}": np.stack(list(rows[name]))
            for name in rows
            if not name.startswith("language.")
        }
    np.savez(out, **frames)
    stated = {
        "rpaug": "rpaug" in sys.modules,
        "lengths": [loader.get_episode_length(number) for number in range(len(loader))],
        "words": words,
        "statistics": loader.get_dataset_statistics(),
    }
    print(json.dumps(stated))


if __name__ == "__main__":
    main()
