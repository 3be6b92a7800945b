"""The output folder of a run: the episodes that are there, their reports, numbers without gaps, totals and card."""

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from rpaug.core import splits
from rpaug.core.errors import BadInput
from rpaug.core.files import PART, REJECTED, write_atomic
from rpaug.pipeline import card, plan, report, role_facts
from rpaug.pipeline.run import Run, Summary, group_of


def keys(run: Run, folder: str = "") -> list[str]:
    """The episodes in the target, or in a folder of it; rejected copies are none of the target's own."""
    root = run.target / folder
    held = run.adapter.episodes(root) if root.is_dir() else ()
    return [key for key in held if PurePosixPath(key).parts[0] != REJECTED]


def reports(run: Run, folder: str = "") -> dict[str, dict[str, Any]]:
    """The report of every episode there. Raises BadInput for an episode without one."""
    found = {}
    for key in keys(run, folder):
        own = run.target / folder / key
        given = report.of(own)
        if given is None:
            found_, expected = "none that can be read", "an episode of this run"
            raise BadInput(own / report.NAME, "report", found=found_, expected=expected)
        found[key] = given
    return found


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
    made, rejected = list(reports(run).values()), reports(run, REJECTED)
    summary.copies = len(made)
    for key, described in rejected.items():
        summary.rejected[key] = "; ".join(described["gates"]["faults"])
    summary.roles = _roles(run, [*made, *rejected.values()])
    summary.left_out = _left_out(run, [*made, *rejected.values()])
    summary.fell_short = _fell_short(run, made)
    for described in made:
        if found := described["plan"].get("warnings"):
            summary.warnings[described["source"]] = list(found)
        for stage, seconds in described["seconds"].items():
            summary.seconds[stage] = round(summary.seconds.get(stage, 0.0) + seconds, 4)
    for name in sorted({name for described in made for name in described["changed_share"]}):
        shares = [described["changed_share"].get(name, 0.0) for described in made]
        summary.changed_share[name] = round(sum(shares) / len(shares), 6)
    _sources_warned(run, summary)


def _left_out(run: Run, made: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Each edit that some episodes had nothing for: in how many of those that drew it, in how many copies, and the
    first reason."""
    found = []
    for number, step in enumerate(run.recipe.steps):
        for option in step.options:
            drawn = [
                (one["source"], draw.get("left_out"))
                for one in made
                for draw in one["draws"]
                if draw["step"] == number
                and (draw.get("op"), draw.get("fields")) == (option.name, option.fields)
            ]
            reasons = [(source, reason) for source, reason in drawn if reason]
            if reasons:
                of = ", ".join(map(str, plan.targets(option.operator)))
                found.append(
                    {
                        "step": number,
                        "edit": f"{option.name} of {of}" if of else option.name,
                        "episodes": len({source for source, _ in reasons}),
                        "drawn_in": len({source for source, _ in drawn}),
                        "copies": len(reasons),
                        "reason": reasons[0][1],
                    }
                )
    return found


def _fell_short(run: Run, made: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """What edits could not do as asked, over all copies: which edit, what, and how many things of how many."""
    found = []
    for number, step in enumerate(run.recipe.steps):
        for option in step.options:
            total: dict[str, list[int]] = {}
            for draw in (draw for one in made for draw in one["draws"] if draw["step"] == number):
                drawn = draw.get("op"), draw.get("fields")
                if draw.get("edit") is None or drawn != (option.name, option.fields):
                    continue
                for words, (missed, asked) in option.operator.falls_short(draw["edit"]).items():
                    before = total.setdefault(words, [0, 0])
                    total[words] = [before[0] + missed, before[1] + asked]
            found += [
                {"step": number, "edit": option.name, "what": words, "count": missed, "of": asked}
                for words, (missed, asked) in total.items()
                if missed
            ]
    return found


def _roles(run: Run, made: Sequence[Mapping[str, Any]]) -> list[str]:
    """In which roles the source episodes of one group differ."""
    groups: dict[str, dict[str, Any]] = {}
    for one in made:
        if "roles" in one:
            group = groups.setdefault(group_of(run.adapter, one["source"]), {})
            group[one["source"]] = one["roles"]
    return [words for group in groups.values() for words in role_facts.disagreement(group)]


def write_card(run: Run) -> None:
    """The dataset card; it counts the episodes that are there."""
    given = card.text(
        run.source,
        run.adapter.name,
        reports(run),
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
