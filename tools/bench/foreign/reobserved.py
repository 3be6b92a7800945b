"""Demonstrations of robosuite, re-observed from their states: how exactly, and edits of them against the truth.

    python -m tools.bench.foreign.reobserved --python foreign/bin/python --out reobserved [--episodes 25] [--edited 4]

Each task's demonstrations are recorded (`tools.bench.foreign.demos`, run by --python), re-observed by the adapter
`hdf5_sim`, and compared with robosuite's own sensors of depth and of geoms, every third state, both cameras. Some of
them, evenly spread, are then edited as `tools.bench.foreign.edits` and `cameras` do it: rpaug reads the re-observed
file, the truth is the same states truly changed, seen by the same cameras. Rendered so, unchanged states must give the
recorded bytes. OUT keeps what was made and scored.
"""

import argparse
import json
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rpaug.core import registry
from rpaug.core.files import write_atomic
from rpaug.core.types import Episode
from tools.bench.foreign import cameras, edits
from tools.bench.harness import pages

TASKS = ("Lift", "Stack")
TOPIC = "reobserved"
CAMERAS, STANDING, ON_HAND = "cameras", ("agentview",), "robot0_eye_in_hand"


class Recorded(edits.Trial):
    """A re-observed demonstration; its unchanged states are rendered too."""

    def changes(self) -> edits.Changes:
        return {"same": {}, **super().changes()}

    def differing(self) -> int:
        """Pixels of the unchanged states that are not those recorded."""
        same = self.film("same")
        return sum(
            int((view.rgb(t) != same.views[name].rgb(t)).any(-1).sum())
            for name, view in self.episode.views.items()
            for t in range(self.episode.length)
        )


def simulated(python: Path, *words: Any) -> None:
    """Run `demos` in the simulators' environment."""
    command = [python, "-W", "ignore", "-m", "tools.bench.foreign.demos", *words]
    subprocess.run([str(word) for word in command], check=True)


def prepared(task: str, episodes: int, python: Path, out: Path) -> int:
    """Record, re-observe and compare a task's demonstrations; how many of them were left out."""
    recorded, seen = out / "recorded" / task, out / "seen" / task
    if not recorded.exists():
        simulated(python, "--task", task, "--episodes", episodes, "--out", recorded)
    if not seen.exists():
        adapter = registry.adapter("hdf5_sim")
        _, failures = adapter.reobserve(recorded, seen, python, lambda done, total: None)
        write_atomic(seen / "failures.json", json.dumps(failures).encode())
    compared = out / "compared" / task
    if not compared.exists():
        file = seen / f"{task.lower()}.hdf5"
        simulated(python, "--task", task, "--seen", file, "--out", compared)
    return len(json.loads((seen / "failures.json").read_text()))


def laid(task: str, count: int, python: Path, out: Path) -> Iterator[tuple[str, Path, Episode]]:
    """Some of a task's demonstrations, evenly spread: name, neutral folder, and the episode as it is read."""
    seen = out / "seen" / task
    keys = registry.adapter("hdf5_sim").episodes(seen)
    for k in np.unique(np.linspace(0, len(keys) - 1, count).round().astype(int)):
        name = keys[k].rpartition("/")[2]
        folder = out / "laid" / task / name
        if not (folder / "episode.json").exists():
            words = "--task", task, "--seen", seen / f"{task.lower()}.hdf5", "--demo", name
            simulated(python, *words, "--out", folder.parent)
        read = registry.read(seen, keys[k])
        plain = Episode(read.key, read.views, read.robot, read.descriptions, read.length)
        yield f"robosuite|{task}|{name}", folder, plain  # without its source: no edit is written


def scored(
    place: str, folder: Path, episode: Episode, python: Path, kept: Mapping[str, Any]
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Figures of a demonstration that are not kept yet: by factor and method, and of moved cameras by move."""
    trial = Recorded(folder, episode, folder / "truth")
    for found, figures in edits.figures(place, folder, trial, python, kept):
        if differing := trial.differing():
            raise RuntimeError(f"{place}: {differing} pixels of the unchanged states differ")
        yield found, figures
    if f"{place}|{CAMERAS}" not in kept:
        moves = cameras.bumps(place, STANDING, ON_HAND)
        true = cameras.shown(folder, episode, moves, folder / "moved", python)
        yield f"{place}|{CAMERAS}", cameras.figures(episode, true, moves)


def exactness(out: Path, left: Mapping[str, int]) -> list[list[pages.Cell]]:
    """By task, as EXACT names it."""
    rows: list[list[pages.Cell]] = []
    for task, failed in left.items():
        found = json.loads((out / "compared" / task / "compared.json").read_text()).values()
        sums = {
            key: sum(one[key] for one in found) for key in ("images", "pixels", "depths", "masks")
        }
        right: list[pages.Cell] = [
            {"value": sums[key], "target": "<= 0"} for key in ("depths", "masks")
        ]
        missing: pages.Cell = {"value": failed, "target": "<= 0"}
        rows.append([task, len(found), missing, sums["images"], sums["pixels"], *right])
    return rows


EXACT = (
    "task", "demonstrations", "left out", "images compared", "pixels", "depths that differ",
    "pixels of another instance",
)  # fmt: skip


def main() -> None:
    """Make and score what is not there yet, and print or record the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--python", type=Path, required=True, help="of the simulators' environment")
    parser.add_argument("--episodes", type=int, default=25, help="of each task")
    parser.add_argument("--edited", type=int, default=4, help="of each task's demonstrations")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--record", action="store_true", help="write docs/benchmarks' results")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    left = {task: prepared(task, given.episodes, given.python, given.out) for task in TASKS}
    file = given.out / "edits.json"
    kept = json.loads(file.read_text()) if file.exists() else {}
    for task in TASKS:
        for place, folder, episode in laid(task, given.edited, given.python, given.out):
            for found, figures in scored(place, folder, episode, given.python, kept):
                kept[found] = figures
                write_atomic(file, json.dumps(kept, indent=1).encode())
                print(found, flush=True)
    command = (
        "python -m tools.bench.foreign.reobserved --python foreign/bin/python --out reobserved"
    )
    places = {place.rpartition("|")[0] for place in kept}
    moved = {place: one for place, one in kept.items() if place.endswith(f"|{CAMERAS}")}
    seeds = f"{len(places)} demonstrations of {len(TASKS)} tasks"
    edits.tell(
        TOPIC, exactness(given.out, left), given.record, id="exact", columns=EXACT,
        title="Re-observed against robosuite's own sensors", seeds="every third state, two cameras", command=command,
    )  # fmt: skip
    edits.tell(
        TOPIC, edits.rows(kept, "re-observed", edits.twins()), given.record, id="edits", columns=edits.COLUMNS,
        title="Edits of re-observed demonstrations against the truth",
        seeds=f"{seeds}, {edits.FRAMES} frames each", command=command,
    )  # fmt: skip
    edits.tell(
        TOPIC, cameras.rows(moved, "re-observed"), given.record, id="cameras", columns=cameras.COLUMNS,
        title="Moved cameras of re-observed demonstrations", seeds=seeds, command=command,
    )  # fmt: skip


if __name__ == "__main__":
    main()
