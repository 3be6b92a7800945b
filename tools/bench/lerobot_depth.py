"""Every operator on a LeRobot dataset whose depth is video: does it run, and are unedited codes the recorded ones?

    python tools/bench/lerobot_depth.py [--frames 17] [--size 96] [--only move,remove] [--vgg FILE] [--json FILE]

Records one episode of the simulated tabletop, writes it as LeRobot with depth filmed as its recorder does (12 bits,
HEVC), and edits it with one operator after another, the original kept. `stylize` looks through the VGG16 in FILE;
without one through the tests' stand-in, a small network of random weights: that it runs is shown, not how it looks.
Folders are temporary and removed after.
"""

import argparse
import json
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import numpy as np
import pyarrow.parquet as pq
from rpaug_adapters.lerobot import codes, tables
from rpaug_adapters.shared import video

from rpaug.core import registry
from rpaug.pipeline import recipe
from rpaug.pipeline.augment import Run, execute
from rpaug.twin.record import record

sys.path.append(str(Path(__file__).parents[2] / "tests/helpers"))
import vgg

DEPTH = "observation.images.{}_depth"
KEY = "twin/train/0"
TARGET = {"target": {"role": "manipulated"}}
OTHER = {"target": {"handle": 177}}  # the cylinder of the twin, which nothing touches or names
FIELDS: dict[str, dict[str, Any]] = {
    "recolor": {**OTHER, "color": {"rgb": [0.2, 0.4, 0.9]}},
    "retexture": OTHER,
    "stylize": {**OTHER, "style": {"sample": "all"}, "steps": 5},
    "object_size": TARGET,
    "physics": {**OTHER, "material": "foam"},
    "camera_pose": {"camera": "front", "shift": 0.02, "turn": 0.02},
    "remove": OTHER,
    "move": OTHER,
    "duplicate": OTHER,
    "distractors": {"count": 1},
}


def film(root: Path, source: Path) -> None:
    """The first episode of a dataset as LeRobot with filmed depth."""
    reader, writer = registry.adapter_for(source), registry.adapter("lerobot")
    episode = replace(reader.read(source, reader.episodes(source)[0]), source=None, rate=10.0)
    writer.write(episode, root, KEY, dict)
    own, info = root / KEY, root / "twin" / tables.INFO
    rows, given = pq.read_table(own / tables.STAGED), json.loads(info.read_text())
    options = {"g": "1", "x265-params": f"{video.X265}:lossless=1"}
    for name, view in episode.views.items():
        if view.depth is None:
            continue
        key = DEPTH.format(name)
        rows = rows.drop_columns([key])
        with av.open(str(own / f"{key}.mp4"), "w", format="mp4") as made:
            stream = made.add_stream("libx265", rate=10, options=options)
            stream.width, stream.height = view.camera.width, view.camera.height
            stream.pix_fmt = video.CODES
            for t in range(episode.length):
                values = codes.Scale().codes(view.depth(t))
                made.mux(stream.encode(av.VideoFrame.from_ndarray(values, format=video.CODES)))
            made.mux(stream.encode())
        about = {"is_depth_map": True, "depth_unit": "mm"}
        given["features"][key] |= {"dtype": "video", "info": about}
    pq.write_table(rows, own / tables.STAGED)
    counted = json.loads((own / tables.STATISTICS).read_text())
    images = {key: one for key, one in counted.items() if not key.endswith("_depth")}
    (own / tables.STATISTICS).write_text(json.dumps(images))
    (own / tables.ROW).unlink()  # names images that are videos now
    info.write_text(json.dumps(given))
    writer.finish(root, root)


def stored(root: Path, key: str) -> dict[str, list[np.ndarray]]:
    """All codes of an episode's depth."""
    episode = registry.adapter("lerobot").read(root, key)
    found = {}
    for name, span in episode.source.spans.items():
        if name.endswith("_depth"):
            frames = video.Frames(span, video.CODES)
            found[name] = [frames(t) for t in range(episode.length)]
    return found


def tried(op: str, root: Path, out: Path, network: Path) -> dict[str, Any]:
    """One operator: what came of it, and how many codes of the original and of the copy changed."""
    edit = {"op": op, **FIELDS.get(op, {})}
    if op == "stylize":
        edit["weights"] = str(network)
    given = {"version": 1, "edits": [edit], "copies": 1, "seed": 1, "keep_originals": True}
    begun = time.process_time()
    done = execute(Run(root, recipe.build(given), out))
    seconds = round(time.process_time() - begun, 1)
    if done.exit_code:
        reasons = {**done.failures, **done.rejected}
        return {"op": op, "ran": False, "seconds": seconds, "why": str(list(reasons.values()))}
    before = stored(root, KEY)
    changed = []
    for key in (KEY, "twin/train/1"):
        after = stored(out, key)
        pairs = [(a, b) for name in before for a, b in zip(before[name], after[name], strict=True)]
        changed.append(sum(int((a != b).sum()) for a, b in pairs))
    return {"op": op, "ran": True, "seconds": seconds, "codes": changed}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=17)
    parser.add_argument("--size", type=int, default=96)
    parser.add_argument("--only", type=lambda names: names.split(","), default=None)
    parser.add_argument("--vgg", type=Path)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    found = []
    with tempfile.TemporaryDirectory() as folder:
        base = Path(folder)
        record("pick_block", 0, base / "twin", frames=given.frames, size=given.size)
        film(base / "in", base / "twin")
        for op in given.only or registry.operator_names():
            one = tried(op, base / "in", base / op, given.vgg or vgg.saved(base))
            found.append(one)
            sys.stdout.write(json.dumps(one) + "\n")
            sys.stdout.flush()
    if given.json:
        given.json.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
