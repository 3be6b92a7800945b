"""Augmented frames per second and core in a training loop, the first sample's seconds, and memory over a soak.

    python tools/bench/training.py DATASET [--only fixed] [--soak 3600] [--workers 2] [--json]

DATASET is in any layout rpaug reads, with cameras. Frames are key frames of all cameras, drawn anew each epoch from
scenes kept in a temporary folder; gates are off: a copy that is to be judged is rendered whole, once. `moved` counts
the frames of moved cameras alone, `fixed` all. Seconds are of the process (one thread). The soak runs a DataLoader of
workers and samples their resident memory.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from torch.utils.data import DataLoader

from rpaug.core import registry
from rpaug.training import AugmentedEpisodes

FIXED = {"op": "recolor", "target": {"role": "manipulated"}, "color": {"sample": "colosseum"}}
MOVED = {"op": "camera_pose", "shift": 0.1, "turn": 0.05}  # of the fixed cameras
OPEN = dict.fromkeys(["outside", "reprojection", "holes", "moving", "torn", "flicker", "color"])
RATE = """
import json, sys, time
from rpaug.training import AugmentedEpisodes
imported = start = time.process_time()
dataset, recipe, folder, epochs, *cameras = sys.argv[1:]
episodes = AugmentedEpisodes(dataset, recipe, scenes=folder, cameras=cameras or None)
item = episodes[0]
first = time.process_time() - start
frames = spent = 0.0
for epoch in range(1, 1 + int(epochs)):
    episodes.set_epoch(epoch)
    start = time.process_time()
    item = episodes[0]
    if item["skipped"]:
        sys.exit(item["skipped"])
    cameras = item["cameras"]
    spent += time.process_time() - start
    frames += sum(len(images["rgb"]) for images in cameras.values())
rate = round(frames / spent, 1)
print(json.dumps({"imports_s": round(imported, 2), "first_s": round(first, 2), "frames_per_s": rate}))
"""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--epochs", type=int, default=20)
    parser.add_argument(
        "--only", choices=["fixed", "moved"], help="edits of fixed cameras, or moved ones"
    )
    parser.add_argument("--soak", type=float, default=0.0, help="seconds")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = measure(given, Path(folder))
    if given.json:
        print(json.dumps(found))
        return
    for name, facts in found.items():
        print(name, ", ".join(f"{key} {value}" for key, value in facts.items()))


def measure(given: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """All figures; each rate in a process of its own, twice: the second finds the scene kept."""
    found = {}
    recipes = {}
    adapter = registry.adapter_for(given.dataset)
    views = adapter.read(given.dataset, adapter.episodes(given.dataset)[0]).views
    moved = MOVED | {"camera": [name for name, view in views.items() if view.camera.fixed]}
    for name, edit in (("fixed", FIXED), ("moved", moved)):
        if given.only not in (None, name):
            continue
        recipes[name] = folder / f"{name}.yaml"
        recipes[name].write_text(json.dumps({"version": 1, "edits": [edit], "gates": OPEN}))
        for state in ("cold", "kept"):
            shown = edit.get("camera", ())
            found[f"{name}, {state}"] = rate(given, recipes[name], folder / f"scenes_{name}", shown)
    if given.soak:
        both = folder / "both.yaml"
        both.write_text(json.dumps({"version": 1, "edits": [FIXED, moved], "gates": OPEN}))
        found["soak"] = soak(given, both, folder / "scenes_soak")
    return found


def rate(
    given: argparse.Namespace, recipe: Path, scenes: Path, cameras: Sequence[str]
) -> dict[str, float]:
    """Seconds of imports, from opening the dataset to its first sample, and frames per second after it."""
    one = {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    command = [
        sys.executable,
        "-c",
        RATE,
        str(given.dataset),
        str(recipe),
        str(scenes),
        str(given.epochs),
        *cameras,
    ]
    done = subprocess.run(command, env=os.environ | one, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def soak(given: argparse.Namespace, recipe: Path, scenes: Path) -> dict[str, Any]:
    """Items through workers for that long: the workers' memory after a tenth of it, in the middle, and at the end."""
    episodes = AugmentedEpisodes(given.dataset, recipe, scenes=scenes)
    loader = DataLoader(
        episodes,
        batch_size=None,
        num_workers=given.workers,
        persistent_workers=True,
        prefetch_factor=1,
    )
    start, epoch, items = time.monotonic(), 0, 0
    trace: list[tuple[float, float]] = []
    while time.monotonic() - start < given.soak:
        episodes.set_epoch(epoch)
        items += sum(1 for _ in loader)
        epoch += 1
        trace.append((time.monotonic() - start, resident(os.getpid())))
    at = [memory for share in (0.1, 0.5, 1.0) for memory in [_nearest(trace, share * given.soak)]]
    return {
        "seconds": round(given.soak), "items": items, "epochs": epoch,
        "mb_at_tenth": at[0], "mb_at_half": at[1], "mb_at_end": at[2],
    }  # fmt: skip


def resident(parent: int) -> float:
    """Resident MB of a process's children, shared pages counted once in each (proc(5))."""
    total = 0.0
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                status = dict(
                    line.split(":", 1) for line in (entry / "status").read_text().splitlines()
                )
            except OSError:  # it has just ended
                continue
            if int(status["PPid"]) == parent and "VmRSS" in status:
                total += int(status["VmRSS"].split()[0]) / 1024
    return round(total, 1)


def _nearest(trace: list[tuple[float, float]], wanted: float) -> float:
    return min(trace, key=lambda one: abs(one[0] - wanted))[1]


if __name__ == "__main__":
    main()
