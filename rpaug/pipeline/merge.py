"""The parts of a run, made on several machines, become the output that one run would have written."""

import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rpaug.core.errors import BadInput
from rpaug.core.files import PART, apart, flush, write_atomic
from rpaug.core.fingerprint import of_file, same_files, sealed
from rpaug.core.owner import owned
from rpaug.pipeline import augment, journal, output_folder, report
from rpaug.pipeline.journal import Journal
from rpaug.pipeline.made import Place
from rpaug.pipeline.recipe import build as build_recipe
from rpaug.pipeline.run import Run, Summary


@dataclass(frozen=True)
class RunPart:
    """The output of one part of a run, and what its journal and its summary say."""

    root: Path
    held: Journal
    dataset: Path
    failures: Mapping[str, str]

    @property
    def marker(self) -> dict[str, Any]:
        """What tells the whole run from others."""
        assert self.held.marker is not None
        return {name: value for name, value in self.held.marker.items() if name != "shard"}


def merge(target: Path, roots: Sequence[Path], licence: str | None = None) -> tuple[Run, Summary]:
    """Move the episodes of all parts to `target` and finish them as one run: the same bytes come out, however many
    parts there were. Returns the whole run and what it came to. A merge that was stopped goes on when it is asked for
    again.

    Raises BadInput where the folders are no parts of one run, or an episode is in none of them.
    """
    with ExitStack() as stack:
        for root in (target, *roots):
            stack.enter_context(owned(root))
        parts = [_part(root) for root in roots]
        run = _whole(target, parts, licence)
        _see_all(run, parts)
        if journal.marker(target) is None:
            journal.begin(target, run.marker, run.source)
        output_folder.sweep(target)
        for part in parts:
            _bring(part, target)
        summary = Summary(
            failures={key: one for part in parts for key, one in part.failures.items()}
        )
        held = journal.read(target)
        if held.made:
            augment.finish(run, held, summary)
    return run, summary


def _part(root: Path) -> RunPart:
    """Raises BadInput for a folder that is no part of a run, or that has no summary yet."""
    held, begun = journal.read(root), journal.begun(root)
    if not held.marker or "shard" not in held.marker:
        expected = "the --out of a run with --shard"
        raise BadInput(root, "shard", found="no part of a run", expected=expected)
    described = report.summary(root)
    if described is None:
        found, expected = "no summary", "a run that came to its end: go on with it by --resume"
        raise BadInput(root / report.SUMMARY, "shard", found=found, expected=expected)
    return RunPart(root, held, Path(begun["dataset"]), described.get("failures", {}))


def _whole(target: Path, parts: Sequence[RunPart], licence: str | None) -> Run:
    """The run that all are parts of. Raises BadInput."""
    first = parts[0]
    for other in parts[1:]:
        for name, value in first.marker.items():
            if other.marker.get(name) != value:
                found = f"another {name} than {first.root} has"
                raise BadInput(other.root, name, found=found, expected="parts of one run")
    given = first.marker
    ratio = given.get("ratio")
    run = Run(
        first.dataset,
        build_recipe(given["recipe"]),
        target,
        given["tier"],
        share=given.get("share", False),
        keep_invalid=given["keep_invalid"],
        ratio=ratio and (ratio[0], ratio[1]),
        licence=licence,
    )
    apart(target, run.source)
    augment.check(run, resume=target.exists())
    if run.marker != given:
        name = next(name for name in given if run.marker.get(name) != given[name])
        found = f"another {name} than when {first.root} was made"
        raise BadInput(run.source, name, found=found, expected="the same dataset and rpaug")
    return run


def _see_all(run: Run, parts: Sequence[RunPart]) -> None:
    """See that every copy was made, or its episode failed. Raises BadInput."""
    made = [part.held for part in parts]
    if (run.target / journal.NAME).is_file():
        made.append(journal.read(run.target))
    there = {one for held in made for one in held.made.copies()}
    failed = {key for part in parts for key in part.failures}
    numbers = sorted(str(part.held.marker["shard"][0]) for part in parts if part.held.marker)
    for key in run.keys:
        for copy in run.copies:
            if not ((key, copy) in there or (key, copy) in run.spared or key in failed):
                found = f"copy {copy} in none of the parts {', '.join(numbers)}"
                expected = "all parts, each run to its end (--resume)"
                raise BadInput(run.source / key, "shard", found=found, expected=expected)


def _bring(part: RunPart, target: Path) -> None:
    """Move a part's episodes, and copy what belongs to none. Raises BadInput where parts differ in that."""
    there = journal.read(target).made
    for within in output_folder.FOLDERS:
        for name in output_folder.shared(part.root / within, part.held, within):
            _bring_shared(part.root / within / name, target / within / name)
    for (within, key), line in _notes(part):
        if (within, key) in there:
            continue
        home, goal = part.root / within / key, target / within / key
        if home.is_dir():
            _move(home, goal)
        if not same_files(part.held.made[within, key].seal, sealed(goal, read=False)):
            found, expected = "not the files that its journal names", "a part as it was written"
            raise BadInput(home, "episode", found=found, expected=expected)
        journal.append(target, [line], durable=journal.due())


def _notes(part: RunPart) -> Iterator[tuple[Place, dict[str, Any]]]:
    for within in output_folder.FOLDERS:
        for key, line in journal.facts(part.root, part.held.made.of(within)):
            yield (within, key), line


def _bring_shared(home: Path, goal: Path) -> None:
    if not goal.exists():
        write_atomic(goal, home.read_bytes(), durable=True)
    elif of_file(home) != of_file(goal):
        found, expected = "other than in another part", "the same in all: episodes of one kind"
        raise BadInput(home, "file", found=found, expected=expected)


def _move(home: Path, goal: Path) -> None:
    """One rename where both are in one file system, else a copy that appears by one."""
    goal.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.rename(home, goal)
    except OSError:
        work = goal.with_name(f".{goal.name}-moved{PART}")
        shutil.rmtree(work, ignore_errors=True)
        shutil.copytree(home, work)
        for path in work.rglob("*"):
            if path.is_file():
                flush(path)
        os.rename(work, goal)
        shutil.rmtree(home)
