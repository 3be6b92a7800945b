"""A whole dataset through the pipeline: which copies to make, where they go, and what came of them."""

import json
import os
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from rpaug import registry, report
from rpaug.engine import local
from rpaug.errors import BadInput
from rpaug.files import PART, write_atomic
from rpaug.interfaces import Adapter
from rpaug.pipeline import ORIGINAL, Job
from rpaug.recipe import Recipe


@dataclass
class Summary:
    """What a run did, as `rpaug.summary.json` stores it."""

    episodes: int = 0
    copies: int = 0
    resumed: int = 0
    failures: dict[str, str] = field(default_factory=dict)
    aborted: str | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    changed_share: dict[str, float] = field(default_factory=dict)

    @property
    def exit_code(self) -> int:
        """0: all done; 1: some episodes were skipped; 2: nothing could be made."""
        if not self.failures and not self.aborted:
            return 0
        return 1 if self.copies + self.resumed and not self.aborted else 2


def jobs(
    adapter: Adapter,
    source: Path,
    target: Path,
    recipe: Recipe,
    tier: int,
    done: dict[str, tuple[str, int]],
    scenes: Path | None = None,
) -> list[Job]:
    """One job per source episode: its missing copies and the keys they get, numbered from 0 in each group.

    `done` maps keys already in the target to (source key, copy).
    """
    selected = recipe.select(adapter.episodes(source))
    first = ORIGINAL if recipe.keep_originals else ORIGINAL + 1
    finished = set(done.values())
    wanted = [(copy, key) for copy in range(first, recipe.copies + 1) for key in selected]
    free: dict[str, int] = {}
    copies: dict[str, list[tuple[int, str]]] = {key: [] for key in selected}
    for copy, key in wanted:
        if (key, copy) in finished:
            continue
        group = PurePosixPath(adapter.key_at(key, 0)).parent.as_posix()
        while adapter.key_at(key, free.setdefault(group, 0)) in done:
            free[group] += 1
        copies[key].append((copy, adapter.key_at(key, free[group])))
        free[group] += 1
    return [
        Job(adapter.name, source, key, target, tuple(made), recipe.source, tier, scenes)
        for key, made in copies.items()
        if made
    ]


def finished(adapter: Adapter, target: Path, recipe: Recipe) -> dict[str, tuple[str, int]]:
    """Keys that a stopped run left whole, with their source and copy. Raises BadInput if the recipe differs."""
    done = {}
    for key in adapter.episodes(target):
        path = target / key / report.NAME
        try:
            described = json.loads(path.read_bytes())
            done[key] = (str(described["source"]), int(described["copy"]))
        except (OSError, ValueError, KeyError, TypeError):
            raise BadInput(
                path, "report", found="none that can be read", expected="an episode of this run"
            ) from None
        if described["recipe"] != recipe.source:
            raise BadInput(path, "recipe", found="another recipe", expected="the one being resumed")
    return done


def run(
    source: Path,
    recipe: Recipe,
    target: Path,
    *,
    workers: int = 1,
    tier: int = 0,
    scenes: Path | None = None,
    resume: bool = False,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Summary:
    """Augment a dataset into `target`. Raises BadInput for what is wrong before the first episode.

    A bad episode among good ones is skipped and named in the summary. Every finished episode appears by one rename,
    so a killed run leaves only whole ones and can be resumed.
    """
    adapter = registry.adapter_for(source)
    if target.exists() and not resume:
        raise BadInput(
            target, "--out", found="something there already", expected="a new path, or --resume"
        )
    if target.resolve().is_relative_to(source.resolve()):
        raise BadInput(
            target, "--out", found="a path inside the dataset", expected="a path outside it"
        )
    _sweep(target)
    done = finished(adapter, target, recipe)
    todo = jobs(adapter, source, target, recipe, tier, done, scenes)
    if not todo and not done:
        raise BadInput(
            source,
            "select",
            found="no episode that matches",
            expected=f"one of its {len(adapter.episodes(source))} episodes",
        )
    summary = Summary(resumed=len(done))
    total = sum(len(job.copies) for job in todo)
    reports: list[dict[str, Any]] = []
    progress(0, total)
    for outcome in local.run(todo, workers):
        reports += outcome.reports
        if outcome.error:
            summary.failures[outcome.job.key] = outcome.error
        if outcome.fatal:
            summary.aborted = outcome.error
            break
        progress(len(reports), total)
    summary.episodes, summary.copies = len(todo) - len(summary.failures), len(reports)
    if not reports and not done:
        shutil.rmtree(target, ignore_errors=True)
        return summary
    _close_gaps(adapter, target)
    adapter.finish(source, target)
    _total(summary, reports)
    write_atomic(target / report.SUMMARY, report.encode(vars(summary) | {"recipe": recipe.source}))
    return summary


def _sweep(target: Path) -> None:
    """Remove what a killed run had half written."""
    for folder, subfolders, _ in os.walk(target):
        for name in [name for name in subfolders if name.startswith(".") and name.endswith(PART)]:
            shutil.rmtree(Path(folder) / name, ignore_errors=True)
            subfolders.remove(name)


def _close_gaps(adapter: Adapter, target: Path) -> None:
    """Renumber so that each group counts from 0 without holes: readers walk the numbers until one is missing."""
    counts: dict[str, int] = {}
    for key in adapter.episodes(target):
        group = PurePosixPath(adapter.key_at(key, 0)).parent.as_posix()
        wanted = adapter.key_at(key, counts.get(group, 0))
        counts[group] = counts.get(group, 0) + 1
        if wanted != key:
            os.rename(target / key, target / wanted)


def _total(summary: Summary, reports: Sequence[dict[str, Any]]) -> None:
    for described in reports:
        for stage, seconds in described["seconds"].items():
            summary.seconds[stage] = round(summary.seconds.get(stage, 0.0) + seconds, 4)
    cameras = {name for described in reports for name in described["changed_share"]}
    for name in sorted(cameras):
        shares = [described["changed_share"].get(name, 0.0) for described in reports]
        summary.changed_share[name] = round(sum(shares) / len(shares), 6)
