"""The output folder of a run: the episodes that are there, their reports, numbers without gaps, totals and card."""

import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain, repeat
from pathlib import Path, PurePosixPath
from typing import Any

from rpaug.core import splits
from rpaug.core.errors import BadInput
from rpaug.core.files import PART, REJECTED, flush, write_atomic
from rpaug.pipeline import card, plan, report, role_facts
from rpaug.pipeline.recipe import Option
from rpaug.pipeline.run import Run, Summary, group_of


def keys(run: Run, folder: str = "") -> list[str]:
    """The episodes in the target, or in a folder of it; rejected copies are none of the target's own."""
    root = run.target / folder
    held = run.adapter.episodes(root) if root.is_dir() else ()
    return [key for key in held if PurePosixPath(key).parts[0] != REJECTED]


class Reports(Mapping[str, dict[str, Any]]):
    """The report of every episode in the target, or in a folder of it, each read when it is asked for: however many
    there are, one is in memory. Raises BadInput for an episode without one."""

    def __init__(self, run: Run, folder: str = "") -> None:
        self._root = run.target / folder
        self._keys = dict.fromkeys(keys(run, folder))

    def __iter__(self) -> Iterator[str]:
        return iter(self._keys)

    def __len__(self) -> int:
        return len(self._keys)

    def __getitem__(self, key: str) -> dict[str, Any]:
        own = self._root / key
        given = report.of(own)
        if given is None:
            found, expected = "none that can be read", "an episode of this run"
            raise BadInput(own / report.NAME, "report", found=found, expected=expected)
        return given


def missing(target: Path) -> list[Path]:
    """The folders that making `target` makes, innermost first; none if it is there."""
    found = []
    while not target.exists():
        found.append(target)
        target = target.parent
    return found


def sweep(target: Path) -> None:
    """Remove what a killed run had half written."""
    for folder, subfolders, files in os.walk(target):
        for name in [name for name in subfolders if name.startswith(".") and name.endswith(PART)]:
            shutil.rmtree(Path(folder) / name, ignore_errors=True)
            subfolders.remove(name)
        for name in files:
            if name.startswith(".") and name.endswith(PART):
                (Path(folder) / name).unlink(missing_ok=True)


def drop_unreported(run: Run) -> None:
    """Remove episodes whose report a power cut left empty: they are made again. What has none at all is not ours."""
    for folder in ("", REJECTED):
        for key in keys(run, folder):
            own = run.target / folder / key
            if (own / report.NAME).is_file() and not (own / report.NAME).stat().st_size:
                shutil.rmtree(own)


def flush_reports(run: Run, folder: str = "") -> None:
    """See reports onto the disk before episodes are gathered: one that shares files cannot be made again alone."""
    for key in keys(run, folder):
        path = run.target / folder / key / report.NAME
        if path.is_file():
            flush(path)


def close_gaps(run: Run, folder: str = "") -> None:
    """Renumber so that each group counts from 0 without holes: readers walk the numbers until one is missing."""
    counts: dict[str, int] = {}
    for key in keys(run, folder):
        group = group_of(run.adapter, key)
        wanted = run.adapter.key_at(key, counts.get(group, 0))
        counts[group] = counts.get(group, 0) + 1
        if wanted != key:
            run.adapter.rename(run.target / folder, key, wanted)


def total(summary: Summary, run: Run) -> None:
    """Fill in what the reports in the target say."""
    outcomes = [
        EditOutcomes(number, option)
        for number, step in enumerate(run.recipe.steps)
        for option in step.options
    ]
    roles: dict[str, dict[str, Any]] = {}  # by group, by source
    changed: dict[str, float] = {}
    made = Reports(run)
    copies = chain(
        zip(repeat(True), made.items()), zip(repeat(False), Reports(run, REJECTED).items())
    )
    for kept, (key, described) in copies:
        for one in outcomes:
            one.add(described, kept)
        if "roles" in described:
            group = roles.setdefault(group_of(run.adapter, described["source"]), {})
            group[described["source"]] = described["roles"]
        if not kept:
            summary.rejected[key] = "; ".join(described["gates"]["faults"])
            continue
        if found := described["plan"].get("warnings"):
            summary.warnings[described["source"]] = list(found)
        for stage, seconds in described["seconds"].items():
            summary.seconds[stage] = round(summary.seconds.get(stage, 0.0) + seconds, 4)
        for name, share in described["changed_share"].items():
            changed[name] = changed.get(name, 0.0) + share
    summary.copies = len(made)
    summary.roles = [words for group in roles.values() for words in role_facts.disagreement(group)]
    summary.left_out = [words for one in outcomes for words in one.left_out()]
    summary.fell_short = [words for one in outcomes for words in one.fell_short()]
    for name in sorted(changed):
        summary.changed_share[name] = round(changed[name] / len(made), 6)
    _sources_warned(run, summary)


@dataclass
class EditOutcomes:
    """What came of one edit of a recipe in the copies that drew it."""

    step: int
    option: Option
    drawn_in: set[str] = field(default_factory=set)  # source episodes
    lacked_in: dict[str, str] = field(default_factory=dict)  # source episodes, with the reasons
    lacking: int = 0  # copies
    short: dict[str, list[int]] = field(default_factory=dict)  # what: how many things of how many

    def add(self, described: Mapping[str, Any], kept: bool) -> None:
        """Count one copy by its report; a rejected copy counts as having drawn the edit alone."""
        for draw in described["draws"]:
            drawn = draw["step"], draw.get("op"), draw.get("fields")
            if drawn != (self.step, self.option.name, self.option.fields):
                continue
            self.drawn_in.add(described["source"])
            if draw.get("left_out"):
                self.lacking += 1
                self.lacked_in.setdefault(described["source"], draw["left_out"])
            if kept and draw.get("edit") is not None:
                for words, counts in self.option.operator.falls_short(draw["edit"]).items():
                    before = self.short.get(words, (0, 0))
                    self.short[words] = [a + b for a, b in zip(before, counts, strict=True)]

    def left_out(self) -> Iterator[dict[str, Any]]:
        """Where episodes had nothing for it: in how many of those that drew it, in how many copies, the reason."""
        if self.lacking:
            of = ", ".join(map(str, plan.targets(self.option.operator)))
            yield {
                "step": self.step,
                "edit": f"{self.option.name} of {of}" if of else self.option.name,
                "episodes": len(self.lacked_in),
                "drawn_in": len(self.drawn_in),
                "copies": self.lacking,
                "reason": next(iter(self.lacked_in.values())),
            }

    def fell_short(self) -> Iterator[dict[str, Any]]:
        """What it could not do as asked, over all copies that were kept."""
        for words, (missed, asked) in self.short.items():
            if missed:
                name = self.option.name
                yield {"step": self.step, "edit": name, "what": words, "count": missed, "of": asked}


def write_card(run: Run) -> None:
    """The dataset card; it counts the episodes that are there."""
    given = card.text(
        run.source,
        run.adapter.name,
        Reports(run),
        recipe=run.recipe.source,
        rejected=len(keys(run, REJECTED)),
        licence=run.licence,
        ratio=run.ratio and f"{run.ratio[0]}:{run.ratio[1]}",
    )
    write_atomic(run.target / card.NAME, given.encode())


def _sources_warned(run: Run, summary: Summary) -> None:
    """Warn of sources that are synthetic themselves, and of a run over several splits."""
    for key in run.keys:
        if report.synthetic(run.source, key):
            words = "it is synthetic itself: a copy of a copy"
            summary.warnings[key] = [*summary.warnings.get(key, []), words]
    held = {splits.kind(key) for key in run.keys} - {None, "train"}
    if held:
        named = " and ".join(sorted(str(one) for one in held))
        words = f"copies of {named} episodes are made too: evaluate on recorded ones, or select train alone"
        first = next(key for key in run.keys if splits.kind(key) in held)
        summary.warnings[first] = [*summary.warnings.get(first, []), words]
