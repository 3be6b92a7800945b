"""A whole dataset through the pipeline: which copies to make, where they go, and what came of them."""

import json
import os
import shutil
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from rpaug import card, preparing, registry, report, splits
from rpaug.engine import local
from rpaug.errors import BadInput
from rpaug.files import PART, REJECTED, write_atomic
from rpaug.interfaces import Adapter
from rpaug.pipeline import ORIGINAL, Job
from rpaug.recipe import Recipe

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Run:
    """What is asked for: `recipe` on the dataset `source`, written to `target`, shown at `tier` at least."""

    source: Path
    recipe: Recipe
    target: Path
    tier: int = 0
    scenes: Path | None = None  # a store of fitted scenes
    share: bool = (
        False  # episodes of one place borrow the static Gaussians of its first, through the store
    )
    keep_invalid: bool = False  # copies whose recorded actions no longer hold
    ratio: tuple[int, int] | None = None  # recorded to synthetic episodes, in each group
    licence: str | None = None  # of the source, where it does not say

    @cached_property
    def adapter(self) -> Adapter:
        """The adapter of the dataset's layout. Raises BadInput."""
        return registry.adapter_for(self.source)

    @cached_property
    def keys(self) -> list[str]:
        """The selected episodes. Raises BadInput if there are none."""
        every = self.adapter.episodes(self.source)
        keys = self.recipe.select(every)
        if not keys:
            known = f"{', '.join(every[:5])}{', ...' if len(every) > 5 else ''}"
            raise BadInput(
                self.source,
                "select",
                found="no episode that matches",
                expected=f"patterns for: {known}",
            )
        return keys

    @property
    def copies(self) -> range:
        """The copy numbers of each episode, the original's among them if it is kept."""
        first = ORIGINAL if self.recipe.keep_originals or self.ratio else ORIGINAL + 1
        last = self.recipe.copies
        if self.ratio:
            last = -(-self.ratio[1] // self.ratio[0])
        return range(first, last + 1)

    @cached_property
    def spared(self) -> frozenset[tuple[str, int]]:
        """Episodes that get no last copy, so that `ratio` is met: drawn from the recipe's seed, group by group."""
        if not self.ratio:
            return frozenset()
        groups: dict[str, list[str]] = {}
        for key in self.keys:
            groups.setdefault(_group(self.adapter, key), []).append(key)
        found, last = set(), self.copies[-1]
        for group, keys in groups.items():
            wanted = round(len(keys) * self.ratio[1] / self.ratio[0])
            rng = np.random.default_rng([self.recipe.seed, zlib.crc32(group.encode())])
            order = rng.permutation(len(keys))
            found |= {(keys[i], last) for i in order[wanted - len(keys) * (last - 1) :]}
        return frozenset(found)

    @property
    def marker(self) -> dict[str, Any]:
        """What tells one run's output from another's."""
        return {
            "dataset": str(self.source.resolve()),
            "tier": self.tier,
            "keep_invalid": self.keep_invalid,
            "recipe": self.recipe.source,
            **({"share": True} if self.share else {}),
            **({"ratio": list(self.ratio)} if self.ratio else {}),
        }


@dataclass
class Summary:
    """What a run came to, over all that is in the output folder now."""

    copies: int = 0
    resumed: int = 0
    failures: dict[str, str] = field(default_factory=dict)
    rejected: dict[str, str] = field(default_factory=dict)  # by key in that folder: why
    aborted: str | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    changed_share: dict[str, float] = field(default_factory=dict)
    warnings: dict[str, list[str]] = field(default_factory=dict)  # by source episode

    @property
    def exit_code(self) -> int:
        """0: all done; 1: some episodes were skipped, or copies rejected; 2: nothing was made."""
        if not self.failures and not self.aborted and not self.rejected:
            return 0
        return 1 if self.copies or self.rejected else 2


def check(run: Run, resume: bool = False) -> None:
    """See that a run may start. Raises BadInput."""
    if run.ratio and any(synthetic(run.source, key) for key in run.keys):
        expected = "recorded ones, of which the ratio is"
        raise BadInput(run.source, "--ratio", found="synthetic episodes", expected=expected)
    assert run.keys  # raises for a dataset that is none, or a selection that is empty
    if run.target.resolve().is_relative_to(run.source.resolve()):
        raise BadInput(
            run.target, "--out", found="a path inside the dataset", expected="a path outside it"
        )
    if not run.target.exists():
        return
    if not resume:
        raise BadInput(
            run.target, "--out", found="something there already", expected="a new path, or --resume"
        )
    path = run.target / report.SUMMARY
    try:
        described = json.loads(path.read_bytes())
    except (OSError, ValueError):
        raise BadInput(
            path, "--resume", found="no run of rpaug here", expected="the --out of a stopped run"
        ) from None
    for name, value in ({"share": None, "ratio": None} | run.marker).items():
        if not isinstance(described, dict) or described.get(name) != value:
            raise BadInput(path, name, found=f"another {name}", expected="the one being resumed")


def execute(
    run: Run,
    *,
    workers: int = 1,
    resume: bool = False,
    progress: Progress = lambda done, total: None,
) -> Summary:
    """Augment a dataset. Raises BadInput for what is wrong before the first episode.

    A bad episode among good ones is skipped and named in the summary. Every finished episode appears by one rename,
    so a killed run leaves only whole ones and can be resumed. If nothing could be made, nothing is left behind.
    """
    check(run, resume)
    made_folders = _missing(run.target)
    write_atomic(run.target / report.SUMMARY, report.encode(run.marker))
    _sweep(run.target)
    written = [*_reports(run).items(), *_reports(run, REJECTED).items()]
    done = [(key, one["source"], one["copy"]) for key, one in written]
    todo = jobs(run, done)
    summary = Summary(resumed=len(done))
    total, finished = sum(len(job.copies) for job in todo), 0
    progress(0, total)
    for outcome in _outcomes(_staged(run, todo), workers):
        finished += len(outcome.reports)
        if outcome.fatal:
            summary.aborted = outcome.error
        elif outcome.error and outcome.job.copies:  # who borrows from it says so too
            summary.failures[outcome.job.key] = outcome.error
        progress(finished, total)
    kept, rejected = _keys(run), _keys(run, REJECTED)
    if kept or rejected:
        _close_gaps(run)
        for keys, root in ((kept, run.target), (rejected, run.target / REJECTED)):
            if keys:
                run.adapter.finish(run.source, root)
        _total(summary, run)
        _write_card(run)
        write_atomic(run.target / report.SUMMARY, report.encode(vars(summary) | run.marker))
    elif made_folders:
        shutil.rmtree(made_folders[-1], ignore_errors=True)
    return summary


def _write_card(run: Run) -> None:
    """The dataset card; it counts the episodes that are there."""
    told = card.text(
        run.source,
        run.adapter.name,
        run.recipe.source,
        _reports(run),
        rejected=len(_keys(run, REJECTED)),
        licence=run.licence,
        ratio=run.ratio and f"{run.ratio[0]}:{run.ratio[1]}",
    )
    write_atomic(run.target / card.NAME, told.encode())


def _sources_warned(run: Run, summary: Summary) -> None:
    """Warn of sources that are synthetic themselves, and of a run over several splits."""
    for key in run.keys:
        if synthetic(run.source, key):
            words = "it is synthetic itself: a copy of a copy"
            summary.warnings[key] = [*summary.warnings.get(key, []), words]
    held = {splits.kind(key) for key in run.keys} - {None, "train"}
    if held:
        named = " and ".join(sorted(str(one) for one in held))
        words = f"copies of {named} episodes are made too: evaluate on recorded ones, or select train alone"
        first = next(key for key in run.keys if splits.kind(key) in held)
        summary.warnings[first] = [*summary.warnings.get(first, []), words]


def synthetic(root: Path, key: str) -> bool:
    """Whether an episode of a dataset is one that rpaug made."""
    try:
        told = json.loads((root / key / report.NAME).read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(told, dict) and bool(told.get("synthetic"))


def _staged(run: Run, todo: Sequence[Job]) -> list[list[Job]]:
    """The jobs in turns: what lends Gaussians to others is fitted before them, and once."""
    if not run.share:
        return [list(todo)]
    lent = preparing.founders(run.adapter, run.source, [job.key for job in todo])
    lenders = dict.fromkeys(lent.values())
    own = {job.key: job for job in todo}
    first = [own.get(key) or _job(run, key, ()) for key in lenders]
    rest = [replace(job, founder=lent.get(job.key)) for job in todo if job.key not in lenders]
    return [first, rest]


def _outcomes(stages: Sequence[Sequence[Job]], workers: int) -> Iterator[local.Outcome]:
    for stage in stages:
        fatal = False
        for outcome in local.run(stage, workers):
            yield outcome
            fatal |= outcome.fatal
        if fatal:
            return


def jobs(run: Run, done: Sequence[tuple[str, str, int]]) -> list[Job]:
    """One job per source episode: its missing copies and the keys they get, numbered from 0 in each group.

    `done` are keys already given, to rejected copies too, with the source key and the copy of each.
    """
    taken = {key for key, _, _ in done}
    finished = {(source, copy) for _, source, copy in done}
    free: dict[str, int] = {}
    copies: dict[str, list[tuple[int, str]]] = {key: [] for key in run.keys}
    for copy in run.copies:
        for key in run.keys:
            if (key, copy) in finished or (key, copy) in run.spared:
                continue
            group = _group(run.adapter, key)
            while run.adapter.key_at(key, free.setdefault(group, 0)) in taken:
                free[group] += 1
            made = run.adapter.key_at(key, free[group])
            if splits.of(made) != splits.of(key):  # an adapter's mistake, and the worst of all
                found, expected = f"{made}, of another split", "a copy in its source's split"
                raise BadInput(run.source / key, "split", found=found, expected=expected)
            copies[key].append((copy, made))
            free[group] += 1
    return [_job(run, key, made) for key, made in copies.items() if made]


def _job(run: Run, key: str, copies: Sequence[tuple[int, str]]) -> Job:
    return Job(
        run.adapter.name,
        run.source,
        key,
        run.target,
        tuple(copies),
        run.recipe.source,
        run.tier,
        run.scenes,
        keep_invalid=run.keep_invalid,
    )


def _keys(run: Run, folder: str = "") -> list[str]:
    """The episodes in the target, or in a folder of it; rejected copies are none of the target's own."""
    root = run.target / folder
    keys = run.adapter.episodes(root) if root.is_dir() else ()
    return [key for key in keys if PurePosixPath(key).parts[0] != REJECTED]


def _reports(run: Run, folder: str = "") -> dict[str, dict[str, Any]]:
    """The report of every episode there. Raises BadInput for an episode without one."""
    found = {}
    for key in _keys(run, folder):
        path = run.target / folder / key / report.NAME
        try:
            found[key] = json.loads(path.read_bytes())
        except (OSError, ValueError):
            raise BadInput(
                path, "report", found="none that can be read", expected="an episode of this run"
            ) from None
    return found


def _missing(target: Path) -> list[Path]:
    """The folders that making `target` makes, innermost first; none if it is there."""
    missing = []
    while not target.exists():
        missing.append(target)
        target = target.parent
    return missing


def _sweep(target: Path) -> None:
    """Remove what a killed run had half written."""
    for folder, subfolders, files in os.walk(target):
        for name in [name for name in subfolders if name.startswith(".") and name.endswith(PART)]:
            shutil.rmtree(Path(folder) / name, ignore_errors=True)
            subfolders.remove(name)
        for name in files:
            if name.startswith(".") and name.endswith(PART):
                (Path(folder) / name).unlink(missing_ok=True)


def _group(adapter: Adapter, key: str) -> str:
    return PurePosixPath(adapter.key_at(key, 0)).parent.as_posix()


def _close_gaps(run: Run) -> None:
    """Renumber so that each group counts from 0 without holes: readers walk the numbers until one is missing."""
    counts: dict[str, int] = {}
    for key in _keys(run):
        group = _group(run.adapter, key)
        wanted = run.adapter.key_at(key, counts.get(group, 0))
        counts[group] = counts.get(group, 0) + 1
        if wanted != key:
            os.rename(run.target / key, run.target / wanted)


def _total(summary: Summary, run: Run) -> None:
    """Fill in what the reports in the target say."""
    reports = list(_reports(run).values())
    summary.copies = len(reports)
    for key, described in _reports(run, REJECTED).items():
        summary.rejected[key] = "; ".join(described["gates"]["faults"])
    for described in reports:
        if found := described["plan"].get("warnings"):
            summary.warnings[described["source"]] = list(found)
        for stage, seconds in described["seconds"].items():
            summary.seconds[stage] = round(summary.seconds.get(stage, 0.0) + seconds, 4)
    for name in sorted({name for described in reports for name in described["changed_share"]}):
        shares = [described["changed_share"].get(name, 0.0) for described in reports]
        summary.changed_share[name] = round(sum(shares) / len(shares), 6)
    _sources_warned(run, summary)
