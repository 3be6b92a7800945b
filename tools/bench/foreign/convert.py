"""Neutral folders become datasets in RLBench's and LeRobot's layouts, by rpaug's own writers.

    python -m tools.bench.foreign.convert --recorded recorded --out data [--half worked] [--lerobot FPS]

OUT/<half>/<world>.<task>/ gets RLBench's `all_variations/episodes/episode<i>`, and `truth.json`, which no reader looks
at: the true instance ids by role. `--lerobot` writes OUT/lerobot/<half>/<world>.<task> as well.
"""

import argparse
import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from rpaug import Episode
from rpaug.core import registry
from rpaug.core.files import atomic_folder
from rpaug.pipeline import convert
from tools.bench.foreign import neutral

RATE = (
    20.0  # frames a second, taken for the episodes' own: RLBench's readers ask for joint velocities
)
FAR = 10.0  # metres: the far plane, where RLBench's cameras see nothing
TRUTH = "truth.json"


def read(folder: Path, key: str = "episode0") -> Episode:
    """A neutral folder as an episode."""
    facts = neutral.facts(folder)
    films = {name: neutral.arrays(folder, name) for name in facts["cameras"]}
    return episode(films, neutral.arrays(folder, "robot"), facts["instruction"], key)


def episode(
    films: Mapping[str, Mapping[str, np.ndarray]],
    robot: Mapping[str, np.ndarray],
    instruction: str,
    key: str,
) -> Episode:
    """Films by camera and the robot's record as an episode; where nothing is, the far plane."""
    return Episode.from_arrays(
        {name: film["rgb"] for name, film in films.items()},
        depth={name: np.where(film["ids"] > 0, film["depth"], FAR) for name, film in films.items()},
        masks={name: film["ids"] for name, film in films.items()},
        cameras={name: (film["K"], film["cam_to_world"]) for name, film in films.items()},
        instruction=instruction,
        joint_positions=robot["joint_positions"],
        gripper_to_world=robot["gripper_to_world"],
        gripper_open=robot["gripper_open"],
        key=key,
    )


def rlbench(task: Path, out: Path) -> None:
    """A task's episodes as a new dataset, in the order of their seeds, with `truth.json` beside them."""
    writer, truth = registry.adapter("rlbench"), {}
    with atomic_folder(out) as work:
        for number, folder in enumerate(finished(task)):
            key = f"all_variations/episodes/episode{number}"
            writer.write(replace(read(folder, key), rate=RATE), work, key, dict)
            facts = neutral.facts(folder)
            truth[key] = {name: facts[name] for name in ("seed", "ids", "roles")}
        (work / TRUTH).write_text(json.dumps(truth, indent=1))


def finished(task: Path) -> list[Path]:
    """The episodes of a task that were recorded whole, in the order of their seeds."""
    found = [path.parent for path in task.glob("*/episode.json")]
    return sorted(found, key=lambda path: int(path.name))


def main() -> None:
    """Convert what is not there yet or has fewer episodes than were recorded."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--recorded", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--half", choices=neutral.HALVES, default="worked")
    parser.add_argument("--lerobot", type=float, metavar="FPS", help="in LeRobot's layout too")
    given = parser.parse_args()
    for task in sorted((given.recorded / given.half).iterdir()):
        out = given.out / given.half / task.name
        have = len(json.loads((out / TRUTH).read_text())) if out.exists() else 0
        if have < len(finished(task)):
            shutil.rmtree(out, ignore_errors=True)
            rlbench(task, out)
            print(out, flush=True)
        other = given.out / "lerobot" / given.half / task.name
        if given.lerobot and out.exists() and not other.exists():
            convert.convert(out, other, "lerobot", fps=given.lerobot)
            print(other, flush=True)


if __name__ == "__main__":
    main()
