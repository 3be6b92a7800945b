"""Shadows of things that were edited, against the same motion recorded with the thing truly edited.

    python -m tools.bench.recast --seeds 3 [--first-seed 0] [--edit removed] [--record closed]

Mean error in grey levels over the pixels in which the thing itself is in no picture and that truly change by more than
3 levels, and how much of the error of leaving the shadows as they were that is; the same over these and all that were
changed by more where nothing truly changes.
"""

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpaug import twin
from rpaug.core.errors import Unsupported
from rpaug.core.interfaces import Edit, Operator
from rpaug.core.types import Episode, Scene
from rpaug.operators.distractors import Distractors
from rpaug.operators.move import Move
from rpaug.operators.object_size import ObjectSize
from rpaug.operators.remove import Remove
from rpaug.pipeline.contracts import shown
from rpaug.scene import build
from rpaug.scene.targets.targets import Target
from tools.bench.harness import pages
from tools.bench.objects import extra

FRAMES, EVERY = 17, 4
SEEN = 3  # levels
TASKS = ("open_drawer", "pick_block", "push_button", "stack_cups", "put_in_box")
THING = "cylinder"
SCALE = 1.25
LOOK = twin.Look(shadows=True)
TARGET = 0.5  # of the error of leaving the shadows as they were


@dataclass(frozen=True)
class Kind:
    """An operator for the thing with this id, and the truth of its edit: factor, value."""

    operator: Callable[[int], Operator]
    factor: str
    value: Callable[[Edit], Any] = lambda edit: None


KINDS = {
    "removed": Kind(lambda one: Remove(target=Target(handle=one)), "removal"),
    "resized": Kind(
        lambda one: ObjectSize(target=Target(handle=one), range=(SCALE, SCALE)),
        "object_size",
        lambda edit: edit["scale"],
    ),
    "moved": Kind(
        lambda one: Move(target=Target(handle=one), shift=0.2, turn=0.0),
        "object_place",
        lambda edit: tuple(np.array(edit["motion"])[:3, 3].tolist()),
    ),
    "inserted": Kind(
        lambda one: Distractors(count=2),
        "distractor",
        lambda edit: tuple(extra(thing) for thing in edit["things"]),
    ),
}


@dataclass(frozen=True)
class Shadows:
    """One edit of one seed: mean errors with shadows cast anew and left as they were, the same with all that was
    changed, and processor seconds of both."""

    kind: str
    seed: int
    task: str
    lamps: int
    cast: float
    left: float
    cast_wide: float
    left_wide: float
    seconds: float
    seconds_left: float


def perform(task: str, seed: int, **changed: Any) -> twin.Take:
    return twin.perform(task, seed, look=LOOK, frames=FRAMES, **changed)


def measured(kinds: list[str], seeds: range) -> Iterator[Shadows]:
    for seed in seeds:
        task = TASKS[seed % len(TASKS)]
        recorded = perform(task, seed)
        scene = build.build(recorded.episode, with_bodies=True)
        for name in kinds:
            found = one(name, seed, recorded, scene)
            if found is not None:
                yield found


def one(name: str, seed: int, recorded: twin.Take, scene: Scene) -> Shadows | None:
    """None where there is no room for the edit."""
    kind, handle = KINDS[name], recorded.truth.handles[THING]
    operator = kind.operator(handle)
    try:
        edit = operator.sample(scene, np.random.default_rng(seed))
    except Unsupported as error:
        print(f"{name}, seed {seed}: {error}", flush=True)
        return None
    value = kind.value(edit)
    named = {} if kind.factor == "distractor" else {"target": THING}
    true = perform(recorded.truth.task, seed, factor=kind.factor, value=value, **named)
    new = [each.handle for each in value] if kind.factor == "distractor" else [handle]
    start = time.process_time()
    cast = drawn(operator.apply(scene, edit))
    middle = time.process_time()
    left = drawn(operator.apply(scene, edit | {"lamps": []}))
    seconds = middle - start, time.process_time() - middle
    regions = region(recorded.episode, true.episode, left, cast, new)
    errors = [
        float(np.mean(off(made, true.episode)[where])) for where in regions for made in (cast, left)
    ]
    lamps = edit["lamps"]
    known = len(lamps["directions"]) if isinstance(lamps, dict) else 0
    return Shadows(
        name, seed, recorded.truth.task, known, *errors, *seconds
    )  # fmt: skip


Images = dict[tuple[str, int], tuple[np.ndarray, np.ndarray]]


def drawn(scene: Scene) -> Images:
    return images(shown(scene))


def images(episode: Episode) -> Images:
    """Colors and ids by camera and frame."""
    return {
        (name, t): (view.rgb(t), view.ids(t))  # type: ignore[misc]
        for name, view in episode.views.items()
        for t in range(0, episode.length, EVERY)
    }


def region(
    recorded: Episode, true: Episode, left: Images, cast: Images, handles: list[int]
) -> tuple[np.ndarray, np.ndarray]:
    """What changes truly besides the thing, and that with what was changed: flat over all images."""
    found, wide = [], []
    before, after = images(recorded), images(true)
    for key, (rgb, _) in before.items():
        thing = np.any([np.isin(each[key][1], handles) for each in (before, after, cast)], 0)
        truly = np.abs(after[key][0].astype(int) - rgb).max(-1) > SEEN
        changed = np.abs(cast[key][0].astype(int) - left[key][0]).max(-1) > SEEN
        found.append((truly & ~thing).ravel())
        wide.append(((truly | changed) & ~thing).ravel())
    return np.concatenate(found), np.concatenate(wide)


def off(made: Images, true: Episode) -> np.ndarray:
    goal = images(true)
    parts = [np.abs(rgb.astype(float) - goal[key][0]).mean(-1) for key, (rgb, _) in made.items()]
    return np.concatenate([part.ravel() for part in parts])


def table(name: str, rows: list[Shadows], command: str, seeds: str) -> pages.Table:
    out: list[list[pages.Cell]] = []
    for kind in dict.fromkeys(row.kind for row in rows):
        mine = [row for row in rows if row.kind == kind]
        shares = [row.cast / row.left for row in mine]
        cast, left, seconds, before = (
            round(float(np.mean([getattr(row, field) for row in mine])), 1)
            for field in ("cast", "left", "seconds", "seconds_left")
        )
        share, worst = (
            {"value": round(value, 2), "target": f"<= {TARGET}"}
            for value in (float(np.mean(shares)), max(shares))
        )
        wide = round(float(np.mean([row.cast_wide / row.left_wide for row in mine])), 2)
        out.append([kind, len(mine), left, cast, share, worst, wide, before, seconds])
    columns = ["thing", "episodes", "left as they were", "cast anew", "share", "worst share"]
    columns += ["share, wrongly changed pixels too", "processor s, left", "processor s"]
    title = f"Mean error of shadows in grey levels, {TITLES[name]}"
    return pages.Table(
        id=name, title=title, command=command, seeds=seeds, columns=columns, rows=out, **pages.stamp()
    )  # fmt: skip


TITLES = {"worked": "seeds worked with", "closed": "seeds not worked with"}


def main() -> None:
    """Measure and print; with --record, into the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--edit", action="append", choices=KINDS)
    parser.add_argument("--record", choices=TITLES)
    given = parser.parse_args()
    kinds, seeds = (
        given.edit or list(KINDS),
        range(given.first_seed, given.first_seed + given.seeds),
    )
    rows = []
    for row in measured(kinds, seeds):
        rows.append(row)
        print(row, flush=True)
    if given.record:
        command = (
            f"python -m tools.bench.recast --seeds {given.seeds} --first-seed {given.first_seed}"
        )
        command += "".join(f" --edit {kind}" for kind in given.edit or ())
        tasks = ", ".join(f"{seed} ({TASKS[seed % len(TASKS)]})" for seed in seeds)
        seeds_line = f"seeds {tasks}, {FRAMES} frames, five cameras, every {EVERY}th frame"
        pages.record("recast", table(given.record, rows, command, seeds_line))


if __name__ == "__main__":
    main()
