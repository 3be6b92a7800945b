"""One part of an hour-long video: time and memory of reading it, and of writing it edited.

    python tools/bench/long_clip.py [--frames 108000] [--size 64 48] [--seconds 2] [--json FILE]

Makes a video of so many frames, 30 a second, a key frame every 250, in a temporary folder (removed after), and a
`clips.yaml` with two parts. A process of its own lists the episodes, reads both parts whole, and writes one of them
edited. Prints JSON: processor seconds of each, and the memory it has before and at its peak.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import av
import numpy as np

from rpaug.core.registry import adapter

RATE, GROUP = 30, 250


def make(path: Path, frames: int, size: tuple[int, int]) -> None:
    """A still pattern with a red block that moves."""
    still = np.random.default_rng(0).integers(40, 200, (size[1], size[0], 3), np.uint8)
    with av.open(str(path), "w") as made:
        stream = made.add_stream("libx264", rate=RATE, options={"preset": "ultrafast", "crf": "30"})
        (stream.width, stream.height), stream.pix_fmt, stream.gop_size = size, "yuv420p", GROUP
        for t in range(frames):
            image = still.copy()
            at = t // 4 % (size[0] - 10)
            image[10:20, at : at + 10] = (220, 30, 30)
            made.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        made.mux(stream.encode())


def memory() -> float:
    """MB at the most so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def measure(root: Path) -> dict[str, float]:
    """What each step takes, in processor seconds and MB."""
    videos, found, before = adapter("video"), {}, memory()

    def lap(name: str, since: float) -> float:
        found[name] = round(time.process_time() - since, 2)
        return time.process_time()

    at = time.process_time()
    first, second = videos.episodes(root)
    episodes = []
    for name, key in (("first part", first), ("second part", second)):
        episode = videos.read(root, key)
        for t in range(episode.length):
            episode.views["ego"].rgb(t)
        episodes.append(episode)
        at = lap(f"{name} read, processor s", at)
    view = episodes[1].views["ego"]
    edited = replace(view, rgb=lambda t: view.rgb(t) // 2)
    videos.write(replace(episodes[1], views={"ego": edited}), root / "out", "video_0", dict)
    lap("second part written, processor s", at)
    return {**found, "memory before, MB": round(before, 1), "peak, MB": round(memory(), 1)}


def main() -> None:
    """Make the video, measure in a process of its own, print and keep."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=108_000)
    parser.add_argument("--size", type=int, nargs=2, default=(64, 48))
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--measure", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.measure:
        print(json.dumps(measure(given.measure)))
        return
    with tempfile.TemporaryDirectory() as folder:
        make(Path(folder) / "long.mp4", given.frames, tuple(given.size))
        length = given.frames / RATE
        parts = [
            {"video": "long", "start": start, "end": start + given.seconds}
            for start in (length / 2, length * 0.9)
        ]
        (Path(folder) / "clips.yaml").write_text(json.dumps({"version": 1, "clips": parts}))
        command = [sys.executable, __file__, "--measure", folder]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    print(done.stdout.strip())
    if given.json:
        given.json.write_text(done.stdout)


if __name__ == "__main__":
    main()
