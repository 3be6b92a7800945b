"""RDT's own HDF5VLADataset inside rpaug's `wrap`; saves the frames it gives and those of rpaug's own dataset.

python wrap_rdt.py REPOSITORY FOLDER RECIPE FRAMES_OUT
"""

import json
import sys
from pathlib import Path

import numpy as np
from read_with_rdt import opened

from rpaug.training import AugmentedEpisodes, wrap

CAMERAS = {"front": "cam_high", "wrist": "cam_right_wrist"}  # as recorded, and as RDT calls them


class Samples:
    """Its samples, which do not say which file they are of, made to."""

    def __init__(self, rdt):
        self.rdt = rdt

    def __len__(self):
        return len(self.rdt)

    def __getitem__(self, index):
        np.random.seed(index)  # noqa: NPY002  # RDT draws its step and its image augmentation from it
        return self.rdt.get_item(index) | {"episode": index}


def main():
    repository, folder, recipe, out = (Path(argument).resolve() for argument in sys.argv[1:])
    with opened(repository, folder) as rdt:
        theirs = Samples(rdt)
        ours = wrap(
            theirs,
            folder,
            recipe,
            episode=lambda s: s["episode"],
            frame=lambda s: [max(0, s["meta"]["step_id"] - 1), s["meta"]["step_id"]],
            cameras=CAMERAS,
        )
        plain, edited = theirs[0], ours[0]
        t = int(plain["meta"]["step_id"])
        shown = AugmentedEpisodes(folder, recipe, frames=[t])[0]["cameras"]
        frames = {}
        for camera, key in CAMERAS.items():
            frames |= {f"plain/{key}": plain[key][-1], f"edited/{key}": edited[key][-1]}
            frames[f"shown/{key}"] = shown[camera]["rgb"][0]
        np.savez(out, **frames)
    same = [name for name in plain if np.array_equal(plain[name], edited[name])]
    print(json.dumps({"length": len(ours), "step": t, "same": same, "names": sorted(plain)}))


if __name__ == "__main__":
    main()
