"""What robomimic's own SequenceDataset makes of a file; prints JSON. Runs without rpaug.

    python read_with_robomimic.py REPOSITORY FILE FRAMES_OUT [LIBERO]

With a folder of LIBERO the dataset is the one that its `get_dataset` makes, which was written for robomimic 0.2. Saves
the images of each demonstration's first and last step to FRAMES_OUT (npz).
"""

import json
import sys
from pathlib import Path

import h5py
import numpy as np


def main():
    repository, path, out, *libero = (str(Path(argument).resolve()) for argument in sys.argv[1:])
    sys.path.insert(0, repository)
    with h5py.File(path) as file:
        keys = list(file["data/demo_0/obs"])
        filters = list(file.get("mask", ()))
    colors = [key for key in keys if key.endswith(("_image", "_rgb"))]
    low = [key for key in keys if file_is_low(path, key)]
    import robomimic.utils.obs_utils as obs_utils

    modalities = {"rgb": colors, "low_dim": low}
    stated, frames = {"rpaug": "rpaug" in sys.modules, "filters": {}}, {}
    for key in [None, *filters]:
        if libero:
            sys.path.insert(0, libero[0])
            import importlib.util

            place = Path(libero[0]) / "libero/lifelong/datasets.py"
            spec = importlib.util.spec_from_file_location("libero_datasets", place)
            module = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(module)
            dataset, _ = module.get_dataset(path, modalities, filter_key=key)
            dataset = module.SequenceVLDataset(dataset, np.zeros(3))
            inner = dataset.sequence_dataset
        else:
            obs_utils.initialize_obs_utils_with_obs_specs({"obs": modalities})
            from robomimic.utils.dataset import SequenceDataset

            dataset = inner = SequenceDataset(
                path, obs_keys=colors + low, action_keys=["actions"], dataset_keys=["actions"],
                action_config={"actions": {"normalization": None}}, load_next_obs=False,
                hdf5_cache_mode="low_dim", filter_by_attribute=key,
            )  # fmt: skip
        stated["filters"][key or ""] = list(inner.demos)
        if key is None:
            stated["length"] = len(dataset)
            for demo, first in inner._demo_id_to_start_indices.items():
                steps = inner._demo_id_to_demo_length[demo]
                for name, index in (("first", first), ("last", first + int(steps) - 1)):
                    item = dataset[index]
                    frames[f"{demo}/{name}/actions"] = item["actions"]
                    for color in colors:
                        frames[f"{demo}/{name}/{color}"] = np.asarray(item["obs"][color])
    np.savez(out, **frames)
    print(json.dumps(stated))


def file_is_low(path, key):
    with h5py.File(path) as file:
        return file["data/demo_0/obs"][key].ndim == 2


if __name__ == "__main__":
    main()
