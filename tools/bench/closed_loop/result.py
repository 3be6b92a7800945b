"""What came of every episode: success by condition and arm, leads with intervals by seed and layout, tables of them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from tools.bench.closed_loop.looks import CONDITIONS, SINGLE
from tools.bench.harness.pages import Cell, Table, stamp

DRAWS = 10_000  # of the bootstrap
SLIGHT = 5.0  # percentage points: a smaller loss is none, and a smaller gain is none

Packed = dict[str, dict[str, str]]  # task, condition: "1" or "0" for each layout
Kept = dict[str, dict[str, Packed]]  # by arm and seed


def packed(rows: Iterable[Sequence[Any]]) -> Packed:
    """Rows of (task, condition, episode, success), short enough to be kept with the code."""
    out: Packed = {}
    for task, condition, _, success in rows:
        by_condition = out.setdefault(task, {})
        by_condition[condition] = by_condition.get(condition, "") + str(int(success))
    return out


@dataclass(frozen=True)
class Outcomes:
    """What one arm's policies succeeded in; every seed is tested on the same layouts, under every condition."""

    tasks: tuple[str, ...]
    conditions: tuple[str, ...]
    success: Bool[np.ndarray, "seed task condition layout"]

    def of(self, conditions: Sequence[str], without: str = "") -> Float[np.ndarray, "s t e"]:
        """Mean over those conditions, for each seed, task (but for one) and layout."""
        tasks = [number for number, task in enumerate(self.tasks) if task != without]
        wanted = [self.conditions.index(condition) for condition in conditions]
        return self.success[:, tasks][:, :, wanted].mean(2)

    def rate(self, conditions: Sequence[str]) -> float:
        """Success in percent over those conditions."""
        return float(100 * self.of(conditions).mean())


def outcomes(kept: Mapping[str, Packed], seeds: Sequence[int]) -> Outcomes:
    """Those of an arm's policies with these seeds."""
    first = kept[str(seeds[0])]
    tasks, conditions = tuple(first), tuple(next(iter(first.values())))
    every = [[[list(kept[str(s)][t][c]) for c in conditions] for t in tasks] for s in seeds]
    return Outcomes(tasks, conditions, np.array(every) == "1")


@dataclass(frozen=True)
class Lead:
    """Percentage points by which one arm is ahead, and the 95 % interval of that."""

    mean: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.mean:+.1f} ({self.low:+.1f}, {self.high:+.1f})"


def ahead(arm: Outcomes, other: Outcomes, conditions: Sequence[str], without: str = "") -> Lead:
    """How far `arm` is ahead of `other`, paired by seed and layout (hierarchical bootstrap).

    Seeds are drawn anew with replacement, then layouts within each task, the same ones for all seeds and conditions,
    since all of them share the layouts. With one seed the interval knows nothing of what another training would give.
    """
    gap = 100 * (arm.of(conditions, without) - other.of(conditions, without))
    rng = np.random.default_rng(0)
    seeds = rng.integers(len(gap), size=(DRAWS, len(gap)))
    layouts = rng.integers(gap.shape[2], size=(DRAWS, *gap.shape[1:]))
    means = np.take_along_axis(gap[seeds].mean(1), layouts, 2).mean((1, 2))
    low, high = np.percentile(means, [2.5, 97.5])
    return Lead(float(gap.mean()), float(low), float(high))


def unchanged(kept: Kept, factor: str) -> tuple[int, int]:
    """How many outcomes under the factor are those of the same layout unperturbed, of how many: all that is kept."""
    pairs = [
        one == other
        for seeds in kept.values()
        for tasks in seeds.values()
        for task in tasks.values()
        for one, other in zip(task[factor], task["none"], strict=True)
    ]
    return sum(pairs), len(pairs)


def dead(arms: Mapping[str, Outcomes], factor: str) -> str:
    """Why the factor cannot tell the arms apart from the first one, or nothing where it can."""
    first, *others = arms.values()
    if all((arm.of([factor]) == arm.of(["none"])).mean() >= 0.99 for arm in arms.values()):
        return "dead: as unperturbed"
    if first.rate(["none"]) - first.rate([factor]) < SLIGHT:
        return f"dead: {next(iter(arms))} loses nothing"
    if all(arm.rate([factor]) - first.rate([factor]) < SLIGHT for arm in others):
        return f"dead: nothing beats {next(iter(arms))}"
    return ""


def tables(kept: Kept, names: Sequence[str], seeds: Sequence[int], command: str) -> list[Table]:
    """Success by condition; leads; leads without one task each."""
    arms = {name: outcomes(kept[name], seeds) for name in names}
    why = {factor: dead(arms, factor) for factor in SINGLE}
    live = [factor for factor in SINGLE if not why[factor]]
    groups = {
        "unperturbed": ["none"],
        "live factors": live,
        "all nine": list(SINGLE),
        "all at once": ["all"],
    }
    groups = {name: conditions for name, conditions in groups.items() if conditions}
    pairs = [(one, other) for n, one in enumerate(names) for other in names[:n]]

    success: list[list[Cell]] = []
    for condition in CONDITIONS:
        cells = [f"{arm.rate([condition]):.0f}" for arm in arms.values()]
        same = "{} of {}".format(*unchanged(kept, condition)) if condition in SINGLE else ""
        success.append(
            [condition, *cells, why.get(condition) or ("live" if condition in live else ""), same]
        )
    for name in ("live factors", "all nine"):
        if name in groups:
            means = [f"{arm.rate(groups[name]):.1f}" for arm in arms.values()]
            success.append([f"mean of {name}", *means, "", ""])
    if len(seeds) > 1:
        apart = [[outcomes(kept[name], [seed]).rate(SINGLE) for seed in seeds] for name in names]
        cells = [", ".join(f"{rate:.1f}" for rate in rates) for rates in apart]
        success.append(["all nine, by seed", *cells, "", ""])
    leads: list[list[Cell]] = [
        [f"{one} over {other}", *(str(ahead(arms[one], arms[other], c)) for c in groups.values())]
        for one, other in pairs
    ]
    tasks = next(iter(arms.values())).tasks
    tasks = tasks if len(tasks) > 1 else ()
    left_out: list[list[Cell]] = [
        [
            f"{one} over {other}",
            *(f"{ahead(arms[one], arms[other], SINGLE, task).mean:+.1f}" for task in tasks),
        ]
        for one, other in pairs
    ]
    policies = ("seed " if len(seeds) == 1 else "seeds ") + ", ".join(map(str, seeds))
    origin = {"command": command, "seeds": policies, **stamp()}
    made: list[tuple[str, str, list[str], list[list[Cell]]]] = [
        ("success", "Success, %", ["condition", *names, "factor", "as unperturbed"], success),
        ("leads", "Ahead by, points (95 % by seed and layout)", ["arms", *groups], leads),
        ("without", "Ahead by over all nine without one task, points", ["arms", *tasks], left_out),
    ]  # fmt: skip
    return [Table(id=i, title=t, columns=c, rows=r, **origin) for i, t, c, r in made]
