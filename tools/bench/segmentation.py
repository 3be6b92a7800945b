"""Instances told by motion alone, beside the recorded masks, which are withheld.

    python tools/bench/segmentation.py [--tasks open_drawer ...] [--seed 3] [--frames 48] [--dataset FOLDER]
        [--episodes episode0] [--sheet masks.png] [--json]

Printed for fixed cameras and for the wrist camera: the intersection over union (up) of what moves with what truly
moves, pooled over images, and for each body that moves that of the found instance that fits it best; the instances that
were found; processor seconds to look at the episode, and for the masks of one image. With --dataset, recorded RLBench
episodes are measured instead of the twin: there, a handle counts as moving if its body's track says so.
"""

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rpaug import twin
from rpaug.core import registry
from rpaug.core.types import Episode
from rpaug.scene.build import build
from rpaug.scene.instances import by_motion
from rpaug.twin.soft_tasks import SOFT_TASKS

STRIDE = 12  # frames between those that are compared
ARM = ("link", "hand", "finger")


def takes(
    arguments: argparse.Namespace,
) -> Iterator[tuple[str, Episode, dict[str, frozenset[int]]]]:
    """Name, episode with masks, and the bodies that truly move."""
    if arguments.dataset:
        adapter = registry.adapter("rlbench")
        for key in arguments.episodes:
            episode = adapter.read(arguments.dataset, key)
            bodies = build(episode, with_bodies=True).bodies
            moving = [body for body in bodies if body.motion != "static"]
            yield (
                key,
                episode,
                {f"{b.motion} {min(b.instance_ids)}": b.instance_ids for b in moving},
            )
        return
    for task in arguments.tasks:
        take = twin.perform(task, arguments.seed, frames=arguments.frames)
        moving = {
            name for name, track in take.poses.items() if np.abs(track - track[:1]).max() > 1e-6
        }
        moving |= set(take.shapes) | {
            name for name in take.truth.bodies if name.startswith(ARM) and name != "link0"
        }
        bodies = {name: frozenset(take.truth.bodies[name]) for name in sorted(moving)}
        # The hand is fixed to the last link: no motion tells them apart.
        bodies["link7"] |= bodies.pop("hand")
        yield task, take.episode, bodies


def counted(episode: Episode, found: by_motion.Segmentation) -> tuple[dict[str, Counter], float]:
    """Pixels by true and found handle, of fixed cameras and of the others; seconds for one image."""
    pairs = {"fixed": Counter(), "wrist": Counter()}
    images, start = 0, time.process_time()
    for name, view in episode.views.items():
        assert view.ids is not None
        for t in range(0, episode.length, STRIDE):
            both = np.stack([view.ids(t).ravel(), found.ids(name, t).ravel()])
            values, counts = np.unique(both, axis=1, return_counts=True)
            kind = "fixed" if view.camera.fixed else "wrist"
            for (true, got), count in zip(values.T.tolist(), counts.tolist(), strict=True):
                pairs[kind][true, got] += count
            images += 1
    return pairs, (time.process_time() - start) / images


def overlaps(
    pairs: Counter, bodies: Mapping[str, frozenset[int]], names: Mapping[int, str]
) -> dict[str, Any]:
    """IoU of all that moves, and of each body with the instance that fits it best."""
    moving = frozenset().union(*bodies.values())
    both = sum(n for (true, got), n in pairs.items() if true in moving and got > 1)
    either = sum(n for (true, got), n in pairs.items() if true in moving or got > 1)
    row: dict[str, Any] = {"moving": round(both / max(either, 1), 3), "bodies": {}}
    sizes: Counter = Counter()
    for (_, got), n in pairs.items():
        sizes[got] += n
    for body, instance_ids in bodies.items():
        hits: Counter = Counter()
        for (true, got), n in pairs.items():
            if true in instance_ids:
                hits[got] += n
        total = sum(hits.values())
        if total:
            iou = {got: n / (total + sizes[got] - n) for got, n in hits.items()}
            best = max(iou, key=lambda got: iou[got])
            row["bodies"][body] = {
                "iou": round(iou[best], 2),
                "as": names.get(best),
                "pixels": total,
            }
    return row


def picture(episode: Episode, found: by_motion.Segmentation) -> np.ndarray:
    """Images over found instances: two cameras, five times."""
    colors = np.random.default_rng(4).integers(60, 255, (1000, 3)).astype(np.uint8)
    colors[0], colors[1] = 0, 60
    times = np.linspace(0, episode.length - 1, 5).round().astype(int).tolist()
    rows = []
    for name in list(episode.views)[:2]:
        view = episode.views[name]
        rows.append(
            np.hstack([np.vstack([view.rgb(t), colors[found.ids(name, t)]]) for t in times])
        )
    return np.vstack(rows)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--tasks", nargs="+", default=["open_drawer", "pick_block", "slide_block", *SOFT_TASKS]
    )
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--frames", type=int, default=48)
    parser.add_argument("--dataset", type=Path)
    parser.add_argument("--episodes", nargs="+", default=["episode0"])
    parser.add_argument("--sheet", type=Path)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    rows, sheet = [], []
    for name, episode, bodies in takes(arguments):
        bare = {key: replace(view, ids=None) for key, view in episode.views.items()}
        start = time.process_time()
        found = by_motion.segment(replace(episode, views=bare))
        seconds = time.process_time() - start
        pairs, each = counted(episode, found)
        row: dict[str, Any] = {"episode": name, "found": list(found.names.values())}
        row |= {kind: overlaps(pairs[kind], bodies, found.names) for kind in pairs}
        row |= {"seconds": round(seconds, 1), "seconds_an_image": round(each, 3)}
        rows.append(row)
        sheet.append(picture(episode, found))
        if not arguments.json:
            sys.stdout.write(given(row))
            sys.stdout.flush()
    if arguments.sheet:
        cv2.imwrite(str(arguments.sheet), np.vstack(sheet)[..., ::-1])
    if arguments.json:
        sys.stdout.write(json.dumps(rows, indent=1) + "\n")


def given(row: dict[str, Any]) -> str:
    """One episode for people."""
    lines = [f"{row['episode']}: {row['seconds']} s + {row['seconds_an_image']} s an image"]
    for kind in ("fixed", "wrist"):
        bodies = ", ".join(
            f"{body} {one['iou']:.2f} ({one['as']})" for body, one in row[kind]["bodies"].items()
        )
        lines.append(f"  {kind}: moving {row[kind]['moving']:.3f}; {bodies}")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
