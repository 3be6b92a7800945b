"""What a run costs, by a model of two terms, and how far the model is off at other sizes.

    python tools/bench/cost.py [--recipe light_color] [--sizes 2x2 4x2 6x3] [--repeats 3] [--json FILE]

Runs `rpaug augment` on copies of the sample that ships: one episode with one copy, one with five, four with one. From
these it takes the processor seconds of a start, of an episode (read, understood, tried), and of a copy, and the bytes
of a copy. Then it runs the sizes, episodes x copies, and compares. Processor seconds, the least of several runs, since
other work on the machine lengthens wall seconds much and these a little.
"""

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

SAMPLE = Path(__file__).parents[2] / "rpaug/sample"
GROUP = "open_drawer/all_variations/episodes"
CALIBRATED = ((1, 1), (1, 5), (4, 1))


@dataclass(frozen=True)
class Cost:
    """Processor seconds of a start, of an episode and of a copy of it, and megabytes of a copy."""

    start: float
    episode: float
    copy: float
    megabytes: float

    def seconds(self, episodes: int, copies: int) -> float:
        return self.start + episodes * (self.episode + copies * self.copy)

    def disk(self, episodes: int, copies: int) -> float:
        """Megabytes."""
        return episodes * copies * self.megabytes


def dataset(root: Path, episodes: int) -> Path:
    """The sample's episode, so many times."""
    for number in range(episodes):
        shutil.copytree(SAMPLE / GROUP / "episode0", root / GROUP / f"episode{number}")
    return root


def measured(recipe: str, episodes: int, copies: int) -> tuple[float, float]:
    """Processor seconds and megabytes of a run."""
    with tempfile.TemporaryDirectory() as folder:
        return augmented(recipe, dataset(Path(folder, "in"), episodes), copies)


def augmented(recipe: str, source: Path, copies: int) -> tuple[float, float]:
    """The same of a dataset."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "out")
        command = [sys.executable, "-m", "rpaug", "augment", str(source), "--recipe", recipe]
        command += ["--out", str(out), "--set", f"copies={copies}"]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        single = os.environ | {"OMP_NUM_THREADS": "1"}
        subprocess.run(command, check=True, env=single, stdout=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return seconds, sum(path.stat().st_size for path in (out / GROUP).rglob("*")) / 1e6


def least(recipe: str, episodes: int, copies: int, repeats: int) -> tuple[float, float]:
    """Of several runs."""
    return min(measured(recipe, episodes, copies) for _ in range(repeats))


def fitted(recipe: str, repeats: int) -> Cost:
    """The terms of the model, from the smallest runs that tell them."""
    runs = (least(recipe, *size, repeats) for size in CALIBRATED)
    (first, megabytes), (five_copies, _), (four_episodes, _) = runs
    copy = (five_copies - first) / 4
    episode = (four_episodes - first) / 3 - copy
    return Cost(first - episode - copy, episode, copy, megabytes)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--recipe", default="light_color")
    parser.add_argument("--sizes", nargs="+", default=["2x2", "4x2", "6x3"])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    measured(given.recipe, 1, 1)  # kernels are compiled and kept
    cost = fitted(given.recipe, given.repeats)
    found: dict[str, Any] = {"recipe": given.recipe, "cost": asdict(cost), "sizes": {}}
    print(cost, flush=True)
    for size in given.sizes:
        episodes, copies = map(int, size.split("x"))
        seconds, megabytes = least(given.recipe, episodes, copies, given.repeats)
        said = cost.seconds(episodes, copies), cost.disk(episodes, copies)
        found["sizes"][size] = {
            "seconds": round(seconds, 1),
            "seconds_said": round(said[0], 1),
            "megabytes": round(megabytes, 2),
            "megabytes_said": round(said[1], 2),
        }
        print(size, found["sizes"][size], flush=True)
    if given.json:
        given.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
