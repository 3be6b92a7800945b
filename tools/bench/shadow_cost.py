"""What cast shadows cost: `rpaug augment` of episodes of the twin recorded without and with them.

    python -m tools.bench.shadow_cost [--recipe object_color robust] [--frames 60] [--repeats 3] [--record]

Three commands each, of one episode with one copy and with several, and of several episodes, tell what an episode costs
from read to written with its first copy, and what each further copy does. Processor seconds, the least of several runs.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rpaug import twin
from rpaug.scene.lighting import rig
from tools.bench import cost
from tools.bench.harness import pages

TASK = "open_drawer"
EPISODES, COPIES = 3, 4
TARGET = 40  # percent more, at most


@dataclass(frozen=True)
class EpisodeSeconds:
    """Processor seconds: the command of one episode and copy, an episode with its first copy, each further copy."""

    command: float
    episode: float
    copy: float

    @staticmethod
    def of(one: float, copied: float, several: float) -> "EpisodeSeconds":
        """By the commands of one episode and copy, of several copies, of several episodes."""
        return EpisodeSeconds(one, (several - one) / (EPISODES - 1), (copied - one) / (COPIES - 1))


def recorded(root: Path, seed: int, frames: int) -> dict[bool, list[Path]]:
    """Datasets without and with shadows, of one episode and of several; the motion is the same."""
    found = {}
    for shadows in (False, True):
        found[shadows] = [root / f"{shadows}{episodes}" for episodes in (1, EPISODES)]
        for folder, episodes in zip(found[shadows], (1, EPISODES), strict=True):
            look = twin.Look(shadows=shadows)
            twin.record(TASK, seed, folder, look=look, frames=frames, episodes=episodes)
    return found


def measured(
    recipe: str, sources: dict[bool, list[Path]], repeats: int
) -> dict[bool, EpisodeSeconds]:
    """By whether there are shadows."""
    least: dict[bool, list[float]] = {}
    for one, _ in sources.values():
        cost.augmented(recipe, one, COPIES)  # kernels are compiled and kept
    for _ in range(repeats):
        for shadows, (one, several) in sources.items():
            runs = ((one, 1), (one, COPIES), (several, 1))
            seconds = [cost.augmented(recipe, source, copies)[0] for source, copies in runs]
            least[shadows] = list(map(min, least.get(shadows, seconds), seconds))
    return {shadows: EpisodeSeconds.of(*seconds) for shadows, seconds in least.items()}


def tested(seed: int, frames: int) -> float:
    """Milliseconds of the test that an episode without shadows pays."""
    episode = twin.perform(TASK, seed, frames=frames).episode
    start = time.process_time()
    assert not rig.shadows_wander(episode)
    return 1000 * (time.process_time() - start)


def row(recipe: str, what: str, without: float, shadows: float) -> list[pages.Cell]:
    more = round(100 * (shadows / without - 1))
    aimed = {"value": more, "target": f"<= {TARGET}"}
    return [recipe, what, round(without, 2), round(shadows, 2), aimed]


def rows(found: dict[str, dict[bool, EpisodeSeconds]]) -> list[list[pages.Cell]]:
    out = []
    for recipe, by_light in found.items():
        without, cast = by_light[False], by_light[True]
        out.append(row(recipe, "an episode with its first copy", without.episode, cast.episode))
        out.append(row(recipe, "each further copy", without.copy, cast.copy))
        out.append(row(recipe, "the command, one episode, one copy", without.command, cast.command))
    return out


def table(
    given: argparse.Namespace, found: Sequence[Sequence[pages.Cell]], test: float
) -> pages.Table:
    command = [one for one in sys.argv[1:] if one != "--record"]
    return pages.Table(
        id="cost",
        title="Processor seconds of episodes without and with cast shadows, read to written",
        command=" ".join(["python -m tools.bench.shadow_cost", *command]),
        seeds=f"seed {given.seed} ({TASK}), {given.frames} frames, five cameras of 128 pixels; "
        f"least of {given.repeats}; the test that an episode without shadows pays: {test:.0f} ms",
        columns=["recipe", "what", "without shadows", "with", "more, %"],
        rows=found,
        **pages.stamp(),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--recipe", nargs="+", default=["object_color", "robust"])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--record", action="store_true", help="put the table on the page")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        sources = recorded(Path(folder), given.seed, given.frames)
        found = {recipe: measured(recipe, sources, given.repeats) for recipe in given.recipe}
    made = table(given, rows(found), tested(given.seed, given.frames))
    print(made.markdown())
    if given.record:
        pages.record("recast", made)


if __name__ == "__main__":
    main()
