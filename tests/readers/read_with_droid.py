"""What DROID's own `parse_trajectory` and its RLDS builder's `load_trajectory` make of an episode; prints JSON.

    python read_with_droid.py DROID BUILDER DATASET EPISODE FRAMES_OUT

DROID is a clone of droid-dataset/droid, BUILDER of the builder of its RLDS: the robot's own `load_trajectory` needs the
robot. Saves images, states and actions to FRAMES_OUT (npz). Runs without rpaug.
"""

import importlib.util
import json
import sys
from pathlib import Path

import numpy as np


def load(path, name):
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main():
    droid, builder, dataset, episode, out = map(Path, sys.argv[1:])
    sys.path.insert(0, str(droid))
    from droid.postprocessing.parse import parse_trajectory

    known, record = parse_trajectory(dataset, episode, "uuid", "LAB", "user", "id", "2023-07-07")
    utils = load(builder / "droid/droid_utils.py", "droid_utils")
    assert utils.crawler(str(dataset)) == [str(episode)]
    steps = utils.load_trajectory(
        str(episode / "trajectory.h5"), recording_folderpath=str(episode / "recordings/MP4")
    )
    frames = {
        name: np.stack([step["observation"]["image"][name][..., ::-1] for step in steps])
        for name in steps[0]["observation"]["image"]
    }
    frames["joints"] = np.stack(
        [one["observation"]["robot_state"]["joint_positions"] for one in steps]
    )
    frames["action"] = np.stack([one["action"]["cartesian_velocity"] for one in steps])
    np.savez(out, **frames)
    print(json.dumps({"rpaug": "rpaug" in sys.modules, "known": known, "record": record}))


if __name__ == "__main__":
    main()
