"""What RDT's own HDF5VLADataset makes of a folder of episodes; prints JSON. Runs without rpaug.

    python read_with_rdt.py REPOSITORY FOLDER FRAMES_OUT

Saves the last external frame of each sample that it draws to FRAMES_OUT (npz), with the step it was drawn from.
"""

import json
import os
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np


@contextmanager
def opened(repository, folder):
    """RDT's own dataset of a folder of episodes; the working folder is another while it is open."""
    sys.path.insert(0, str(repository))
    with tempfile.TemporaryDirectory() as work:
        os.chdir(work)  # the paths in RDT's code are relative
        Path("data/datasets/agilex").mkdir(parents=True)
        Path("data/datasets/agilex/rdt_data").symlink_to(folder)
        Path("configs").symlink_to(repository / "configs")
        from data.hdf5_vla_dataset import HDF5VLADataset

        yield HDF5VLADataset()


def main():
    repository, folder, out = (Path(argument).resolve() for argument in sys.argv[1:])
    np.random.seed(0)  # noqa: NPY002  # RDT draws from it
    with opened(repository, folder) as dataset:
        stated, frames = {"rpaug": "rpaug" in sys.modules, "samples": []}, {}
        for i in range(len(dataset)):
            for draw in range(6):
                sample = dataset.get_item(i)
                meta = sample["meta"]
                frames[f"{i}_{draw}"] = sample["cam_high"][-1]
                frames[f"{i}_{draw}_wrist"] = sample["cam_right_wrist"][-1]
                stated["samples"].append({
                    "file": dataset.file_paths[i],
                    "frame": f"{i}_{draw}",
                    "step": int(meta["step_id"]),
                    "steps": int(meta["#steps"]),
                    "instruction": meta["instruction"],
                    "state": sample["state"][0].tolist(),
                    "next": sample["actions"][0].tolist(),
                })  # fmt: skip
        np.savez(out, **frames)
    print(json.dumps(stated))


if __name__ == "__main__":
    main()
