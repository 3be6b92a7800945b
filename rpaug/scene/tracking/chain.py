"""Which instances are an arm's links, told together: links stand in a row, touch the next, and no two are one.

A link that is round about its own joint looks the same at rest, and one that hardly bends against its neighbour
looks like a part of it. Taken alone each of them is ambiguous; in the row there is one place for it.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from rpaug.scene.tracking.motion import GRIPPER, STATIC

FIRM = 2  # links that rest does not explain as well: fewer do not show that an arm moves
OFTEN = 0.5  # share of the frames that show both, in which links that follow one another touch


@dataclass(frozen=True)
class ChainPosition:
    """Where in the row an instance is: its label as in `motion`, and whether it could be elsewhere."""

    label: int
    certain: bool


@dataclass(frozen=True)
class _Row:
    """Instances in a row, the last at `end`; a longer row is better, then one that costs less."""

    instance_ids: tuple[int, ...]
    cost: float

    @property
    def rank(self) -> tuple[int, float]:
        return -len(self.instance_ids), self.cost


def places(
    fits: Mapping[int, Float64[np.ndarray, "m"]],
    as_well: Mapping[int, float],
    touch: Collection[frozenset[int]],
) -> dict[int, ChainPosition]:
    """Places of those instances that make up the longest row: rest, link 1, link 2, ..., the gripper.

    `fits[instance id][label]` is what a motion leaves unexplained, in any unit; up to `as_well[instance id]` it
    explains as
    much as the best. `touch` are the pairs that keep touching. Nothing is placed where too few links are seen to move.
    """
    count = len(next(iter(fits.values()), ()))
    order = [STATIC, *range(GRIPPER + 1, count), GRIPPER]
    if count <= GRIPPER + 1:
        return {}
    rows: list[tuple[int, _Row]] = []
    before: dict[int, _Row] = {}
    for position, label in enumerate(order):
        now: dict[int, _Row] = {}
        for instance_id, fit in fits.items():
            if fit[label] > as_well[instance_id]:
                continue
            found = [_Row((), 0.0)] + [
                row
                for last, row in before.items()
                if frozenset((last, instance_id)) in touch and instance_id not in row.instance_ids
            ]
            best = min(found, key=lambda row: row.rank)
            now[instance_id] = _Row(
                (*best.instance_ids, instance_id), best.cost + float(fit[label])
            )
            rows.append((position, now[instance_id]))
        before = now
    if not rows:
        return {}
    end, longest = min(rows, key=lambda row: row[1].rank)
    labels = order[end + 1 - len(longest.instance_ids) : end + 1]
    held = dict(zip(longest.instance_ids, labels, strict=True))
    firm = [h for h, label in held.items() if label > GRIPPER and fits[h][STATIC] > as_well[h]]
    if len(firm) < FIRM:
        return {}
    return {
        instance_id: ChainPosition(
            label, 0 < i < len(held) - 1 or _alone(fits, as_well, held, instance_id)
        )
        for i, (instance_id, label) in enumerate(held.items())
        if label != STATIC
    }


def _alone(
    fits: Mapping[int, Float64[np.ndarray, "m"]],
    as_well: Mapping[int, float],
    held: Mapping[int, int],
    instance_id: int,
) -> bool:
    """Is there no place that nothing else in the row holds and that would explain the instance as well?"""
    taken = {label for label in held.values() if label != STATIC}
    fit = fits[instance_id]
    return not any(fit[k] <= as_well[instance_id] for k in range(len(fit)) if k not in taken)
