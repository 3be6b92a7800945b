"""What came of every episode, success by condition and arm, differences with paired intervals, a table of them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from tools.bench.closed_loop.looks import CONDITIONS, SINGLE

DRAWS = 2000  # of the bootstrap

Outcomes = Mapping[
    tuple[str, str, int], float
]  # (task, condition, episode): share of the seeds that succeeded


Packed = dict[str, dict[str, str]]  # task, condition: "1" or "0" for each episode
Kept = dict[str, dict[str, Packed]]  # by arm and seed


def packed(rows: Iterable[Sequence[Any]]) -> Packed:
    """Rows of (task, condition, episode, success), short enough to be kept with the code."""
    out: Packed = {}
    for task, condition, _, success in rows:
        by_condition = out.setdefault(task, {})
        by_condition[condition] = by_condition.get(condition, "") + str(int(success))
    return out


def outcomes(kept: Mapping[str, Packed], seeds: Sequence[int]) -> Outcomes:
    """The share of those seeds that succeeded in each episode."""
    every = [kept[str(seed)] for seed in seeds]
    return {
        (task, condition, number): float(
            np.mean([one[task][condition][number] == "1" for one in every])
        )
        for task, conditions in every[0].items()
        for condition, flags in conditions.items()
        for number in range(len(flags))
    }


@dataclass(frozen=True)
class Difference:
    """Percentage points by which one arm is ahead, and the 95 % interval of that."""

    mean: float
    low: float
    high: float


def rate(outcomes: Outcomes, conditions: Sequence[str]) -> float:
    """Success in percent over those conditions."""
    return float(100 * np.mean([value for key, value in outcomes.items() if key[1] in conditions]))


def ahead(arm: Outcomes, other: Outcomes, conditions: Sequence[str], seed: int = 0) -> Difference:
    """How far `arm` is ahead of `other` on the same episodes.

    Episodes are drawn anew with replacement within each task and condition (paired bootstrap).
    """
    strata: dict[tuple[str, str], list[float]] = {}
    for (task, condition, episode), value in arm.items():
        if condition in conditions:
            other_value = other[task, condition, episode]
            strata.setdefault((task, condition), []).append(value - other_value)
    rows = np.array(list(strata.values()))
    rng = np.random.default_rng(seed)
    means = np.array([_resampled(rows, rng) for _ in range(DRAWS)])
    low, high = np.percentile(100 * means, [2.5, 97.5])
    return Difference(float(100 * rows.mean()), float(low), float(high))


def _resampled(rows: Float[np.ndarray, "s e"], rng: np.random.Generator) -> float:
    drawn = rng.integers(rows.shape[1], size=rows.shape)
    return float(np.take_along_axis(rows, drawn, 1).mean())


def table(kept: Kept, names: Sequence[str], seeds: Sequence[int]) -> str:
    """Conditions down, arms across, the mean of the single factors, and how far each arm is ahead of each other."""
    arms = {name: outcomes(kept[name], seeds) for name in names}
    lines = ["| success % | " + " | ".join(names) + " |", "|---|" + "---|" * len(names)]
    for condition in CONDITIONS:
        cells = [f"{rate(arms[name], [condition]):.0f}" for name in names]
        lines.append(f"| {condition} | " + " | ".join(cells) + " |")
    means = [f"{rate(arms[name], SINGLE):.1f}" for name in names]
    lines.append("| **mean of factors** | " + " | ".join(means) + " |")
    apart = [
        ", ".join(f"{rate(outcomes(kept[name], [seed]), SINGLE):.1f}" for seed in seeds)
        for name in names
    ]
    lines.append("| the same by seed | " + " | ".join(apart) + " |")
    lines += ["", "| ahead by | unperturbed | mean of factors | all |", "|---|---|---|---|"]
    for number, other in enumerate(names):
        for name in names[number + 1 :]:
            leads = [ahead(arms[name], arms[other], c) for c in (["none"], SINGLE, ["all"])]
            cells = [f"{one.mean:+.1f} ({one.low:+.1f}, {one.high:+.1f})" for one in leads]
            lines.append(f"| {name} over {other} | " + " | ".join(cells) + " |")
    return "\n".join(lines)
