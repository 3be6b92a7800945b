"""What counts as right, and how sure a share is: pure functions of counts."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

SLACK = 0.05  # share of a role's pixels that may be missed, and that may be another's
SURE = 0.9  # confidence from which a belief is high
DRAWS = 2000  # of the bootstrap
RIGHT, ABSENT, WRONG, INVENTED = "right", "absent", "wrong", "invented"


def grade(
    truth: Mapping[str, Collection[int]], found: Collection[int], weights: Mapping[int, int]
) -> str:
    """One role of one episode: right, absent (none was given), wrong, or invented where truly none exists.

    `truth` has `must` and `may`; `weights` are the pixels by instance id that the cameras show. A role whose bodies no
    camera shows does not exist. At most SLACK of the true pixels may be missing, and of the found ones belong to what
    is neither.
    """
    must, may = set(truth["must"]), set(truth["may"])
    true = sum(weights.get(one, 0) for one in must)
    total = sum(weights.get(one, 0) for one in found)
    extra = sum(weights.get(one, 0) for one in set(found) - must - may)
    if not found:
        return ABSENT if true else RIGHT
    if not true:
        return INVENTED if extra else RIGHT
    missed = sum(weights.get(one, 0) for one in must - set(found))
    return RIGHT if missed <= SLACK * true and extra <= SLACK * total else WRONG


@dataclass(frozen=True)
class Share:
    """A share of episodes in percent and its 95 % interval."""

    percent: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.percent:.1f} ({self.low:.1f} to {self.high:.1f})"


def share(tasks: Sequence[Sequence[bool]]) -> Share:
    """The share of true episodes (hierarchical bootstrap: tasks are drawn anew, then episodes within each)."""
    tasks = [np.asarray(task, float) for task in tasks if len(task)]
    if not tasks:
        return Share(float("nan"), float("nan"), float("nan"))
    rng = np.random.default_rng(0)
    means = []
    for _ in range(DRAWS):
        drawn = [tasks[k] for k in rng.integers(len(tasks), size=len(tasks))]
        means.append(np.concatenate([rng.choice(task, len(task)) for task in drawn]).mean())
    low, high = np.percentile(means, [2.5, 97.5])
    return Share(*(round(100 * float(x), 1) for x in (np.concatenate(tasks).mean(), low, high)))
