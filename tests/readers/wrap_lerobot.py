"""LeRobot's own dataset class inside rpaug's `wrap`; saves the images it gives and those of rpaug's own dataset.

python wrap_lerobot.py FOLDER RECIPE FRAMES_OUT
"""

import json
import sys

import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from rpaug.training import AugmentedEpisodes, wrap


def main():
    folder, recipe, out = sys.argv[1:]
    theirs = LeRobotDataset("local/dataset", root=folder, video_backend="pyav")
    colors = [key for key in theirs.meta.camera_keys if key not in theirs.meta.depth_keys]
    ours = wrap(
        theirs,
        folder,
        recipe,
        episode=lambda s: int(s["episode_index"]),
        frame=lambda s: int(s["frame_index"]),
        cameras={key.removeprefix("observation.images."): key for key in colors},
    )
    index = theirs.meta.episodes[1]["dataset_from_index"] + 2
    plain, edited = theirs[index], ours[index]
    shown = AugmentedEpisodes(folder, recipe, frames=[2])[1]["cameras"]
    frames = {}
    for name in colors:
        frames |= {f"plain/{name}": plain[name].numpy(), f"edited/{name}": edited[name].numpy()}
        frames[f"shown/{name}"] = shown[name.removeprefix("observation.images.")]["rgb"][0]
    np.savez(out, **frames)
    same = [name for name in plain if np.array_equal(plain[name], edited[name])]
    print(json.dumps({"length": len(ours), "same": same, "names": sorted(plain)}))


if __name__ == "__main__":
    main()
