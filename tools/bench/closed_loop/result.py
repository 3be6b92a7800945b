"""Success by condition and arm, differences with paired intervals, and a table of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from tools.bench.closed_loop.looks import CONDITIONS, SINGLE

DRAWS = 2000  # of the bootstrap

Outcomes = Mapping[
    tuple[str, str, int], float
]  # (task, condition, episode): share of the seeds that succeeded


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


def table(arms: Mapping[str, Outcomes]) -> str:
    """Conditions down, arms across, then the mean of the single factors with its lead over `plain`."""
    names = list(arms)
    lines = ["| success % | " + " | ".join(names) + " |", "|---|" + "---|" * len(names)]
    for condition in CONDITIONS:
        cells = [f"{rate(arms[name], [condition]):.0f}" for name in names]
        lines.append(f"| {condition} | " + " | ".join(cells) + " |")
    means = [f"{rate(arms[name], SINGLE):.1f}" for name in names]
    lines.append("| **mean of factors** | " + " | ".join(means) + " |")
    if "plain" in arms:
        for conditions, label in ((SINGLE, "mean"), (["all"], "all"), (["none"], "unperturbed")):
            leads = [ahead(arms[name], arms["plain"], conditions) for name in names]
            cells = [f"{one.mean:+.1f} ({one.low:+.1f}, {one.high:+.1f})" for one in leads]
            lines.append(f"| {label} over plain | " + " | ".join(cells) + " |")
    return "\n".join(lines)
