"""Where a copy's time goes, on a dataset of one's own: what is done once an episode, and what each edit adds."""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import TypeVar

from rpaug.core.errors import RpaugError
from rpaug.core.types import Episode
from rpaug.pipeline.copies import ORIGINAL, PreparedEpisode
from rpaug.pipeline.job import see_readable
from rpaug.pipeline.prepare import ground, prepare_scene
from rpaug.pipeline.recipe import Option, Recipe, Step
from rpaug.pipeline.run import Run
from rpaug.pipeline.write import CopyPlace, write_copy
from rpaug.scene.recorded import surfels

START, READ, FIND, TRY = "start of a worker", "read and checked", "what is in it", "edits tried"
FILES, WHOLE = "files alone", "the recipe"
FIXED = 6  # parts beside one for each edit

Made = TypeVar("Made")


@dataclass(frozen=True)
class SpentTime:
    """Processor seconds, of all threads, of one part: `once` an episode (or a worker), or by copy. An edit alone has
    what it adds to a copy of the files alone; `left_out` says why one has no time."""

    part: str
    seconds: float
    once: bool
    left_out: str = ""


def measure(run: Run, key: str, copies: int) -> Iterator[SpentTime]:
    """The parts of an episode's copies, each as it is measured; copies go to a temporary folder.

    What a copy costs is timed on one that was made before, so that nothing is loaded or compiled within it; the whole
    recipe is the mean of `copies`, as it draws them. Raises RpaugError.
    """
    yield SpentTime(START, _started(), once=True)
    episode, seconds = _timed(partial(_read, run, key))
    yield SpentTime(READ, seconds, once=True)
    whole, seconds = _timed(partial(_prepared, run, episode, run.recipe))
    yield SpentTime(FIND, seconds, once=True)
    _, seconds = _timed(partial(ground, whole.scene, run.recipe))
    yield SpentTime(TRY, seconds, once=True)
    files = _copies(run, key, whole, [ORIGINAL, ORIGINAL])[-1]
    yield SpentTime(FILES, files, once=False)
    for option in (option for step in run.recipe.steps for option in step.options):
        yield _alone(run, key, episode, option, files)
    made = _copies(run, key, whole, [1, *range(1, copies + 1)])[1:]
    yield SpentTime(WHOLE, sum(made) / len(made), once=False)


def sums(parts: Sequence[SpentTime]) -> tuple[float, float]:
    """Seconds once an episode in a worker that runs, and of a copy."""
    once = sum(part.seconds for part in parts if part.once and part.part != START)
    return once, next(part.seconds for part in parts if part.part == WHOLE)


def _alone(run: Run, key: str, episode: Episode, option: Option, files: float) -> SpentTime:
    recipe = replace(run.recipe, steps=(Step((option,)),), gates=None)
    try:
        prepared = _prepared(run, episode, recipe)
        ground(prepared.scene, recipe)
        made = _copies(run, key, prepared, [1, 1])[-1]
    except RpaugError as error:
        return SpentTime(option.name, 0.0, once=False, left_out=str(error))
    return SpentTime(option.name, made - files, once=False)


def _read(run: Run, key: str) -> Episode:
    episode = run.adapter.read(run.source, key)
    see_readable(run.adapter, run.source, episode)
    return episode


def _prepared(run: Run, episode: Episode, recipe: Recipe) -> PreparedEpisode:
    scene, plan = prepare_scene(episode, recipe, run.tier, run.scenes, device=run.device)
    return PreparedEpisode(scene, plan, recipe, cache(partial(surfels.recorded, scene)))


def _copies(run: Run, key: str, prepared: PreparedEpisode, numbers: list[int]) -> list[float]:
    """Processor seconds of copies, one after the other."""
    found = []
    for number in numbers:
        with tempfile.TemporaryDirectory() as folder:
            place = CopyPlace(key, number, Path(folder), run.adapter.key_at(key, 0))
            _, seconds = _timed(partial(write_copy, run.adapter, prepared, place, {}))
        found.append(seconds)
    return found


def _timed(make: Callable[[], Made]) -> tuple[Made, float]:
    start = time.process_time()
    made = make()
    return made, time.process_time() - start


def _started() -> float:
    """Processor seconds in which a fresh interpreter has what a worker needs."""
    before = os.times()
    subprocess.run([sys.executable, "-c", "import rpaug.pipeline.workers"], check=True)
    after = os.times()
    return sum(
        getattr(after, kind) - getattr(before, kind)
        for kind in ("children_user", "children_system")
    )
