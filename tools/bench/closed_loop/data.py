"""The datasets of the arms: recorded demonstrations, copies made by `rpaug augment`, copies truly rendered again."""

import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rpaug import twin
from rpaug.core import registry
from rpaug.core.files import PART
from rpaug.twin.record import stage
from tools.bench.closed_loop import looks
from tools.bench.closed_loop.samples import FRAMES

CHANCE = 0.5  # of each factor in a copy, as in the fixed recipe
LAYOUTS = 1000  # seed of the demonstrations' layouts; tests and validations have others


def recorded(root: Path, tasks: Sequence[str], demos: int) -> Path:
    """Demonstrations in RLBench's format, made once."""
    return _whole(root, lambda work: [_record(task, work, demos) for task in tasks])


def augmented(
    root: Path, source: Path, recipe: str, copies: int, workers: int, *settings: str
) -> Path:
    """Copies as a user would make them: by the command."""
    command = [sys.executable, "-m", "rpaug", "augment", str(source), "--recipe", recipe]
    command += ["--workers", str(workers)]
    for one in (f"copies={copies}", *settings):
        command += ["--set", one]

    def make(work: Path) -> None:
        again = ["--resume"] if work.exists() else []
        done = subprocess.run([*command, "--out", str(work), *again], check=False)
        if done.returncode == 2:
            raise SystemExit("rpaug augment made nothing")

    return _whole(root, make)


def rendered(
    root: Path, tasks: Sequence[str], demos: int, copies: int, leave_out: Sequence[str] = ()
) -> Path:
    """The same motions again, each factor changed with chance `CHANCE` but for those left out."""
    names = tuple(name for name in looks.SINGLE if name not in leave_out)

    def make(work: Path) -> None:
        adapter = registry.adapter("rlbench")
        for task in tasks:
            for number in range(demos * copies):
                key = f"{task}/all_variations/episodes/episode{number}"
                if (work / key).exists():
                    continue
                demo, copy = divmod(number, copies)
                rng = np.random.default_rng([LAYOUTS, demo, copy, 11])
                chosen = tuple(name for name in names if rng.random() < CHANCE)
                job, world, _ = stage(task, LAYOUTS, demo, looks.ROOM, looks.ROAM)
                look = looks.mixed(chosen, world, job, "training", rng, looks.ROOM)
                take = twin.perform(
                    task, LAYOUTS, episode=demo, look=look, frames=FRAMES, roam=looks.ROAM
                )
                adapter.write(take.episode, work, key, take.side)

    return _whole(root, make)


def _record(task: str, work: Path, demos: int) -> None:
    shutil.rmtree(work / task, ignore_errors=True)
    twin.record(
        task, LAYOUTS, work, look=looks.ROOM, episodes=demos, frames=FRAMES, roam=looks.ROAM
    )


def _whole(root: Path, make) -> Path:  # type: ignore[no-untyped-def]
    """The folder, made beside its place, begun again where it was stopped, and renamed when it is whole; nothing if it
    is there."""
    if not root.exists():
        work = root.with_name(f".{root.name}{PART}")
        make(work)
        work.rename(root)
    return root
