"""How much an edit flickers where nothing moves: pixels that the recording repeats, and what the copy makes of them.

    python -m tools.bench.steady [DATASET ...] [--twin open_drawer ...] [--frames 33] [--record SOURCES]

A pixel of a fixed camera is still from one frame to the next if its recorded color and instance id are the same in
both, bit for bit, and its instance moves nowhere: no pixel that shows it in both frames, in any fixed camera, changes
its depth. A recorded shadow that wanders over a pixel changes its color, and the pixel is not still. The recording's
own noise is then 0, and all that a copy changes there is flicker. Rows are edits; figures are the share of still
pixels that change, the largest change in levels of 255, and how many pixels were compared.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

import rpaug
from rpaug import twin
from rpaug.core import image_cache
from rpaug.core.types import CameraView, Episode
from tools.bench.harness import pages

EDITS = {
    "light_direction": {"op": "light_direction"},
    "light_color": {"op": "light_color"},
    "table_texture": {"op": "table_texture", "texture": {"sample": "checker"}},
    "background_texture": {"op": "background_texture"},
    "retexture what is moved": {
        "op": "retexture",
        "target": {"role": "manipulated"},
        "texture": {"sample": "checker"},
    },
    "retexture the rest": {
        "op": "retexture",
        "target": {"role": "background"},
        "texture": {"sample": "checker"},
    },
    "recolor what is moved": {
        "op": "recolor",
        "target": {"role": "manipulated"},
        "color": "blue",
    },
}


def moving(views: Sequence[CameraView], t: int) -> np.ndarray:
    """Instances of which a pixel that shows them at t and at t + 1 has another depth then."""
    found = []
    for view in views:
        ids = view.ids(t)
        same = ids == view.ids(t + 1)
        found.append(np.unique(ids[same & (view.depth(t) != view.depth(t + 1))]))
    return np.unique(np.concatenate(found))


def changes(episode: Episode, copy: Episode) -> Iterator[np.ndarray]:
    """Per frame but the last and fixed camera, by how many levels the copy changes each still pixel until the next."""
    fixed = {name: view for name, view in episode.views.items() if view.camera.fixed}
    for t in range(episode.length - 1):
        moved = moving(tuple(fixed.values()), t)
        for name, view in fixed.items():
            ids, after = view.ids(t), copy.views[name].rgb
            still = (ids == view.ids(t + 1)) & ~np.isin(ids, moved)
            still &= (view.rgb(t) == view.rgb(t + 1)).all(-1)
            step = np.abs(after(t).astype(int) - after(t + 1)).max(-1)
            yield step[still]


def measure(episode: Episode, edit: dict[str, object], seed: int) -> dict[str, float]:
    """Flicker of one copy over all fixed cameras."""
    copy = rpaug.augment(episode, {"version": 1, "seed": seed, "edits": [edit]})
    found = np.concatenate(list(changes(image_cache.shelved(episode), image_cache.shelved(copy))))
    return {
        "share": float((found > 0).mean()),
        "levels": int(found.max(initial=0)),
        "pixels": len(found),
    }


def episodes(
    datasets: Sequence[Path], keys: Sequence[str], tasks: Sequence[str], frames: int
) -> Iterator[Episode]:
    """The datasets' episodes, all or those of `keys`, and one of each task of the twin."""
    for dataset in datasets:
        for key in rpaug.episodes(dataset):
            if not keys or key in keys:
                yield rpaug.read(dataset, key)
    for task in tasks:
        yield twin.perform(task, 0, frames=frames).episode


def main() -> None:
    """Measure, print, and record."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", nargs="*", type=Path)
    parser.add_argument(
        "--twin", action="append", default=[], help="a task of the twin; repeatable"
    )
    parser.add_argument(
        "--episode", action="append", default=[], help="only these of the datasets; repeatable"
    )
    parser.add_argument("--frames", type=int, default=33, help="that the twin records")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", choices=tuple(EDITS), default=tuple(EDITS))
    parser.add_argument(
        "--record", help="names the sources, and keeps the table in docs/benchmarks"
    )
    given = parser.parse_args()
    found: dict[str, list[dict[str, float]]] = {name: [] for name in given.only}
    for episode in episodes(given.dataset, given.episode, given.twin, given.frames):
        for name in given.only:
            try:
                one = measure(episode, EDITS[name], given.seed)
            except rpaug.RpaugError as error:
                print(f"{episode.key}: {name}: {error}")
                continue
            found[name].append(one)
            print(f"{episode.key}  {name:24}", *one.items(), flush=True)
    rows = []
    for name, each in found.items():
        if each:
            pixels = sum(one["pixels"] for one in each)
            share = 100 * sum(one["share"] * one["pixels"] for one in each) / pixels
            levels = int(max(one["levels"] for one in each))
            figures = (
                {"value": round(share, 5), "target": "<= 0.01"},
                {"value": levels, "target": "<= 8"},
            )
            rows.append((name, *figures, round(pixels / 1e6, 1), len(each)))
    for row in rows:
        print(*row)
    if given.record:
        words = ["DATASET"] * len(given.dataset) + [f"--episode {key}" for key in given.episode]
        words += [f"--twin {task}" for task in given.twin]
        words += [f"--frames {given.frames}", f"--seed {given.seed}"]
        if given.only != tuple(EDITS):
            words += ["--only", *(f"'{name}'" for name in given.only)]
        table = pages.Table(
            id="steady",
            title="Flicker where nothing moves, % of still pixels",
            command=" ".join(["python -m tools.bench.steady", *words]),
            seeds=given.record,
            columns=("edit", "share that changes, %", "most, levels", "million pixels", "episodes"),
            rows=rows,
            **pages.stamp(),
        )
        pages.record("appearance", table)


if __name__ == "__main__":
    main()
