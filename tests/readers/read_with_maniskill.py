"""What ManiSkill's own ManiSkillTrajectoryDataset makes of a file; prints JSON. Runs without rpaug.

    python read_with_maniskill.py FILE FRAMES_OUT

Saves all its images and actions to FRAMES_OUT (npz).
"""

import json
import sys

import numpy as np
from mani_skill.trajectory.dataset import ManiSkillTrajectoryDataset


def main():
    dataset = ManiSkillTrajectoryDataset(sys.argv[1])
    items = [dataset[i] for i in range(len(dataset))]
    cameras = list(items[0]["obs"]["sensor_data"])
    frames = {"actions": np.stack([np.asarray(one["action"]) for one in items])}
    for name in cameras:
        for kind in items[0]["obs"]["sensor_data"][name]:
            seen = [np.asarray(one["obs"]["sensor_data"][name][kind]) for one in items]
            frames[f"{name}/{kind}"] = np.stack(seen)
    np.savez(sys.argv[2], **frames)
    seeds = [one["reset_kwargs"]["seed"] for one in dataset.episodes]
    print(json.dumps({"rpaug": "rpaug" in sys.modules, "length": len(dataset), "seeds": seeds}))


if __name__ == "__main__":
    main()
