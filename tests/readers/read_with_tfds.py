"""Compares two RLDS datasets as stock TFDS reads them; prints JSON. Runs under TensorFlow, without rpaug.

    python read_with_tfds.py FOLDER OTHER_FOLDER

Each folder has `features.json` in it. `differs` maps a feature to the number of steps in which it is not the same.
"""

import json
import sys

import numpy as np
import tensorflow_datasets as tfds


def flat(value, name=""):
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from flat(inner, f"{name}/{key}" if name else key)
    else:
        yield name, value


def episodes(folder, split):
    dataset = tfds.builder_from_directory(folder).as_dataset(split=split, shuffle_files=False)
    for episode in dataset:
        yield [{name: value.numpy() for name, value in flat(step)} for step in episode["steps"]]


def main():
    one, other = sys.argv[1:]
    splits = {
        folder: dict(tfds.builder_from_directory(folder).info.splits) for folder in (one, other)
    }
    stated = {
        "rpaug": "rpaug" in sys.modules,
        "counts": [
            {name: split.num_examples for name, split in splits[f].items()} for f in (one, other)
        ],
        "bytes": [
            {name: split.num_bytes for name, split in splits[f].items()} for f in (one, other)
        ],
        "names": [],
        "steps": 0,
        "values": 0,
        "differs": {},
        "mean_difference": {},
    }
    for split in splits[one]:
        for before, after in zip(episodes(one, split), episodes(other, split), strict=True):
            for old, new in zip(before, after, strict=True):
                stated["steps"] += 1
                stated["names"] = sorted(old)
                for name, value in old.items():
                    stated["values"] += 1
                    if not np.array_equal(value, new[name]):
                        stated["differs"][name] = stated["differs"].get(name, 0) + 1
                        if value.dtype == np.uint8:
                            off = np.abs(value.astype(int) - new[name]).mean()
                            stated["mean_difference"][name] = float(off)
    print(json.dumps(stated))


if __name__ == "__main__":
    main()
