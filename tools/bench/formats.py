"""A dataset copied through unedited: megabytes a processor second, and the memory it takes beside one episode's size.

    python tools/bench/formats.py [--layout rlds|lerobot] [--megabytes 2048] [--steps 64] [--size 640 480] [--json FILE]
                                  [--augment]

Makes a dataset of that size in a temporary folder (removed after), episodes of `steps` frames of that size: one RLDS
shard of JPEG frames, or LeRobot v3 with two cameras in H.264. Then a process of its own reads every episode and writes
it unedited, and gathers them, as `rpaug augment` does; its memory is what it has before, after the first episode, and
at its peak. `--no-links` does so as on a file system without hard links; `--augment` makes one copy of each with sensor
noise instead, by `rpaug augment`.
"""

import argparse
import filecmp
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from rpaug_adapters.rlds import tfrecord
from rpaug_adapters.rlds.example import example

from rpaug import Episode
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


def make_rlds(root: Path, megabytes: int, steps: int, size: tuple[int, int]) -> tuple[int, int]:
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


def make_lerobot(root: Path, megabytes: int, steps: int, size: tuple[int, int]) -> tuple[int, int]:
    """A dataset of LeRobot v3; its bytes, and those of one episode."""
    rng = np.random.default_rng(0)
    frames = rng.integers(120, 132, (2, steps, size[1], size[0], 3), np.uint8)
    episode = Episode.from_arrays(
        {"front": frames[0], "wrist": frames[1]},
        instruction="put it away",
        joint_positions=rng.normal(size=(steps, 7)),
    )
    lerobot, key = adapter("lerobot"), "bench/train/0"
    lerobot.write(replace(episode, rate=30.0), root / "one", key, dict)
    lerobot.finish(root, root / "one")
    one = _bytes(root / "one")
    count = max(1, megabytes * 10**6 // one)
    without_links()  # each has packets of its own
    for number in range(count):
        lerobot.write(lerobot.read(root / "one", key), root / "in", f"bench/train/{number}", dict)
    lerobot.finish(root / "one", root / "in")
    return _bytes(root / "in"), one


def without_links() -> None:
    """Hard links fail in this process from here on, as on file systems without them."""

    def link(*_: object) -> None:
        raise OSError

    os.link = link


def _bytes(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def most_memory() -> float:
    """Megabytes this process had at the most. (`ru_maxrss` counts what it was forked from too.)"""
    lines = Path("/proc/self/status").read_text().splitlines()
    (line,) = (line for line in lines if line.startswith("VmHWM"))
    return int(line.split()[1]) * 1024 / 1e6


def copy(layout: str, source: Path, target: Path) -> dict[str, float]:
    """Copy a dataset through; what it took of this process."""
    writer = adapter(layout)
    before, begun = resource.getrusage(resource.RUSAGE_SELF), time.perf_counter()
    own, first = most_memory(), 0.0
    for key in writer.episodes(source):
        writer.write(writer.read(source, key), target, key, dict)
        first = first or most_memory()
    writer.finish(source, target)
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


def augment(_layout: str, source: Path, target: Path) -> dict[str, float]:
    """One noisy copy of each episode; what it took of this process."""
    from rpaug.pipeline import recipe
    from rpaug.pipeline.augment import Run, execute  # copying takes less memory without them

    given = {"version": 1, "edits": [{"op": "sensor_noise"}], "copies": 1, "seed": 1}
    run, first = Run(source, recipe.build(given), target), [0.0]
    own = most_memory()

    def progress(done: int, _: int) -> None:
        if done == 1:
            first[0] = most_memory()

    execute(run, progress=progress)
    used = resource.getrusage(resource.RUSAGE_SELF)
    return {
        "user_seconds": used.ru_utime,
        "system_seconds": used.ru_stime,
        "before_megabytes": own,
        "first_episode_megabytes": first[0],
        "peak_megabytes": most_memory(),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--layout", choices=("rlds", "lerobot"), default="rlds")
    parser.add_argument("--no-links", action="store_true")
    parser.add_argument("--augment", action="store_true")
    parser.add_argument("--megabytes", type=int, default=2048)
    parser.add_argument("--steps", type=int, default=64)
    parser.add_argument("--size", nargs=2, type=int, default=(640, 480))
    parser.add_argument("--json", type=Path)
    parser.add_argument("--copy", nargs=2, type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.copy:
        if given.no_links:
            without_links()
        measure = augment if given.augment else copy
        sys.stdout.write(json.dumps(measure(given.layout, *given.copy)))
        return
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "in", Path(folder) / "out"
        rlds = given.layout == "rlds"
        make = make_rlds if rlds else make_lerobot
        total, one = make(
            source if rlds else Path(folder), given.megabytes, given.steps, tuple(given.size)
        )
        command = [sys.executable, __file__, "--layout", given.layout, "--copy", source, target]
        command += ["--no-links"] * given.no_links + ["--augment"] * given.augment
        measured = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
        payload = "*.tfrecord*" if rlds else "*.mp4"
        files = (
            () if given.augment else [path.relative_to(source) for path in source.rglob(payload)]
        )
        same = all(filecmp.cmp(source / file, target / file, shallow=False) for file in files)
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
