"""What a run came to: what is kept of each episode's report, and all of them added up."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from rpaug.core import splits
from rpaug.pipeline import plan, report, role_facts
from rpaug.pipeline.copies import ORIGINAL
from rpaug.pipeline.recipe import Option, Recipe, Step
from rpaug.pipeline.run import Run, Summary, alike, group_of


def facts(described: Mapping[str, Any], recipe: Recipe) -> dict[str, Any]:
    """What the summary needs of a report made by the recipe, as plain values."""
    drawn = []
    for draw in described["draws"]:
        options = () if draw.get("skipped") else recipe.steps[draw["step"]].options
        for number, option in enumerate(options):
            if (option.name, option.fields) == (draw["op"], draw["fields"]):
                edit = draw.get("edit")
                short = {} if edit is None else option.operator.falls_short(edit)
                drawn.append([draw["step"], number, draw.get("left_out"), short])
                break
    kept: dict[str, Any] = {
        "draws": drawn,
        "painted_over": [
            words for draw in described["draws"] for words in draw.get("painted_over", ())
        ],
        "unedited": described["copy"] != ORIGINAL and not described["synthetic"],
        "roles": described.get("roles"),
        "warnings": described["plan"].get("warnings"),
        "faults": (described.get("gates") or {}).get("faults"),
        "seconds": described["seconds"],
        "changed_share": described["changed_share"],
        "mean_change": described.get("mean_change"),
    }
    return {name: value for name, value in kept.items() if value}


def add_up(
    summary: Summary,
    run: Run,
    kept: Iterable[tuple[str, Mapping[str, Any]]],
    rejected: Iterable[tuple[str, Mapping[str, Any]]],
) -> None:
    """Fill in what the copies come to, by the journal's line of each; one line is in memory at a time."""
    outcomes = {
        (number, one): EditOutcomes(number, option)
        for number, step in enumerate(run.recipe.steps)
        for one, option in enumerate(step.options)
    }
    roles: dict[str, dict[str, Any]] = {}  # by group, by source
    changed, levels = dict[str, float](), dict[str, float]()

    def add(line: Mapping[str, Any], kept: bool) -> Mapping[str, Any]:
        source, found = line["source"], line["facts"]
        for step, option, left_out, short in found.get("draws", ()):
            outcomes[step, option].add(source, left_out, short if kept else {})
        if "roles" in found:
            group = roles.setdefault(group_of(run.adapter, source), {})
            group[source] = role_facts.compared(found["roles"])
        return found

    for _, line in kept:
        found = add(line, True)
        summary.copies += 1
        lacking = any(left_out for _, _, left_out, _ in found.get("draws", ()))
        summary.as_recorded += lacking and found.get("unedited", False)
        if "warnings" in found:
            summary.warnings[line["source"]] = list(found["warnings"])
        for words in found.get("painted_over", ()):
            summary.painted_over[words] = summary.painted_over.get(words, 0) + 1
        for stage, seconds in found.get("seconds", {}).items():
            summary.seconds[stage] = round(summary.seconds.get(stage, 0.0) + seconds, 4)
        for name, share in found.get("changed_share", {}).items():
            changed[name] = changed.get(name, 0.0) + share
        for name, mean in found.get("mean_change", {}).items():
            levels[name] = levels.get(name, 0.0) + mean
    for key, line in rejected:
        summary.rejected[key] = "; ".join(add(line, False)["faults"])
    summary.roles = role_facts.disagreements(roles)
    summary.left_out = [words for one in outcomes.values() for words in one.left_out()]
    summary.unmet = any(
        _unmet(outcomes, number, step) for number, step in enumerate(run.recipe.steps)
    )
    summary.fell_short = [words for one in outcomes.values() for words in one.fell_short()]
    for name in sorted(changed):
        summary.changed_share[name] = round(changed[name] / summary.copies, 6)
    for name in sorted(levels):
        summary.mean_change[name] = round(levels[name] / summary.copies, 3)
    _sources_warned(run, summary)


@dataclass
class EditOutcomes:
    """What came of one edit of a recipe in the copies that drew it."""

    step: int
    option: Option
    drawn_in: set[str] = field(default_factory=set)  # source episodes
    lacked_in: dict[str, str] = field(default_factory=dict)  # source episodes, with the reasons
    copies: int = 0  # that drew it
    lacking: int = 0  # of them
    short: dict[str, tuple[int, int]] = field(default_factory=dict)  # things of how many, by what
    short_in: dict[str, dict[str, None]] = field(default_factory=dict)  # source episodes, by what

    def add(self, source: str, left_out: str | None, short: Mapping[str, list[int]]) -> None:
        """Count one copy of a source episode."""
        self.drawn_in.add(source)
        self.copies += 1
        if left_out:
            self.lacking += 1
            self.lacked_in.setdefault(source, left_out)
        for words, (missed, asked) in short.items():
            before = self.short.get(words, (0, 0))
            self.short[words] = before[0] + missed, before[1] + asked
            if missed:
                self.short_in.setdefault(words, {})[source] = None

    @property
    def nowhere(self) -> bool:
        """Whether no copy that drew it has it."""
        return self.lacking == self.copies

    def left_out(self) -> Iterator[dict[str, Any]]:
        """Where episodes had nothing for it: in how many of those that drew it, in how many copies, if in all that drew
        it, the reasons with the episodes that each holds for, the most frequent first."""
        if self.lacking:
            of = ", ".join(map(str, plan.targets(self.option.operator)))
            reasons = [
                {"episodes": len(keys), "reason": one} for keys, one in alike(self.lacked_in)
            ]
            yield {
                "step": self.step,
                "edit": f"{self.option.name} of {of}" if of else self.option.name,
                "episodes": len(self.lacked_in),
                "drawn_in": len(self.drawn_in),
                "copies": self.lacking,
                "nowhere": self.nowhere,
                "reasons": sorted(reasons, key=lambda one: -one["episodes"]),
            }

    def fell_short(self) -> Iterator[dict[str, Any]]:
        """What it could not do as asked, over all copies that were kept."""
        for words, (missed, asked) in self.short.items():
            if missed:
                counts = {"count": missed, "of": asked, "episodes": list(self.short_in[words])}
                yield {"step": self.step, "edit": self.option.name, "what": words, **counts}


def _unmet(outcomes: Mapping[tuple[int, int], EditOutcomes], number: int, step: Step) -> bool:
    """Whether all copies were to have this step and, of those that drew it, none does."""
    drawn = [one for n in range(len(step.options)) if (one := outcomes[number, n]).copies]
    return step.probability == 1 and bool(drawn) and all(one.nowhere for one in drawn)


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
