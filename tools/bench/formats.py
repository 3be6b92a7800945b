"""RLDS copied through unedited: megabytes a processor second, and the memory it takes beside one episode's size.

    python tools/bench/formats.py [--megabytes 2048] [--steps 64] [--size 640 480] [--json FILE]

Makes one shard of that size in a temporary folder (removed after), episodes of `steps` JPEG frames of that size. Then a
process of its own reads every episode and writes it unedited, and gathers the shard, as `rpaug augment` does; its
memory is what it has before, after the first episode, and at its peak.
"""

import argparse
import filecmp
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
from rpaug_adapters.rlds import tfrecord
from rpaug_adapters.rlds.example import example

from rpaug.core.registry import adapter

CORE = "tensorflow_datasets.core.features."


def features(size: tuple[int, int]) -> dict:
    """`features.json` of one camera, actions and words."""

    def tensor(kind: str, *shape: int) -> dict:
        about = {"shape": {"dimensions": [str(s) for s in shape]}, "dtype": kind}
        return {"pythonClassName": CORE + "tensor_feature.Tensor", "tensor": about}

    def several(inner: dict) -> dict:
        name = CORE + "features_dict.FeaturesDict"
        return {"pythonClassName": name, "featuresDict": {"features": inner}}

    about = {
        "shape": {"dimensions": [str(size[1]), str(size[0]), "3"]},
        "dtype": "uint8",
        "encodingFormat": "jpeg",
    }
    image = {"pythonClassName": CORE + "image_feature.Image", "image": about}
    text = {"pythonClassName": CORE + "text_feature.Text", "text": {}}
    steps = several({
        "observation": several({"image_0": image}),
        "action": tensor("float32", 7), "language_instruction": text,
    })  # fmt: skip
    sequence = {"feature": steps, "length": "-1"}
    every = {"pythonClassName": CORE + "dataset_feature.Dataset", "sequence": sequence}
    return several({"steps": every})


def make(root: Path, megabytes: int, steps: int, size: tuple[int, int]) -> tuple[int, int]:
    """One shard; its bytes of records, and those of one."""
    folder = root / "bench/1.0.0"
    folder.mkdir(parents=True)
    (folder / "features.json").write_text(json.dumps(features(size)))
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 255, (size[1], size[0], 3), np.uint8)
    frame = cv2.imencode(".jpg", noise, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()
    record = example({
        "steps/observation/image_0": [frame] * steps,
        "steps/action": rng.normal(size=7 * steps).astype(np.float32),
        "steps/language_instruction": [b"put it away"] * steps,
    })  # fmt: skip
    count = max(1, megabytes * 10**6 // len(record))
    framed = tfrecord.frame(record)
    with (folder / "bench-train.tfrecord-00000-of-00001").open("wb") as stream:
        for _ in range(count):
            stream.write(framed)
    total = count * len(record)
    split = {"name": "train", "numBytes": str(total), "shardLengths": [str(count)],
             "filepathTemplate": "{DATASET}-{SPLIT}.{FILEFORMAT}-{SHARD_X_OF_Y}"}  # fmt: skip
    info = {"fileFormat": "tfrecord", "name": "bench", "splits": [split], "version": "1.0.0"}
    (folder / "dataset_info.json").write_text(json.dumps(info))
    return total, len(record)


def most_memory() -> float:
    """Megabytes this process had at the most. (`ru_maxrss` counts what it was forked from too.)"""
    lines = Path("/proc/self/status").read_text().splitlines()
    (line,) = (line for line in lines if line.startswith("VmHWM"))
    return int(line.split()[1]) * 1024 / 1e6


def copy(source: Path, target: Path) -> dict[str, float]:
    """Copy a dataset through; what it took of this process."""
    rlds = adapter("rlds")
    before, begun = resource.getrusage(resource.RUSAGE_SELF), time.perf_counter()
    own, first = most_memory(), 0.0
    for key in rlds.episodes(source):
        rlds.write(rlds.read(source, key), target, key, dict)
        first = first or most_memory()
    rlds.finish(source, target)
    after = resource.getrusage(resource.RUSAGE_SELF)
    user, system = after.ru_utime - before.ru_utime, after.ru_stime - before.ru_stime
    return {
        "user_seconds": user,
        "system_seconds": system,
        "wall_seconds": time.perf_counter() - begun,
        "before_megabytes": own,
        "first_episode_megabytes": first,
        "peak_megabytes": most_memory(),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--megabytes", type=int, default=2048)
    parser.add_argument("--steps", type=int, default=64)
    parser.add_argument("--size", nargs=2, type=int, default=(640, 480))
    parser.add_argument("--json", type=Path)
    parser.add_argument("--copy", nargs=2, type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.copy:
        sys.stdout.write(json.dumps(copy(*given.copy)))
        return
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "in", Path(folder) / "out"
        total, one = make(source, given.megabytes, given.steps, tuple(given.size))
        command = [sys.executable, __file__, "--copy", source, target]
        measured = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
        (shard,) = (source / "bench/1.0.0").glob("*.tfrecord*")
        same = filecmp.cmp(shard, target / "bench/1.0.0" / shard.name, shallow=False)
    busy = measured["user_seconds"] + measured["system_seconds"]
    figures = {
        "megabytes": total / 1e6,
        "episode_megabytes": one / 1e6,
        **measured,
        "megabytes_a_processor_second": total / 1e6 / busy,
        "same_bytes": float(same),
    }
    for name, value in figures.items():
        sys.stdout.write(f"{name:32} {value:10.1f}\n")
    if given.json:
        given.json.write_text(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
