"""What stands on the table in an image without a mask, and which of it the robot is to act on.

The table is what the commonest, most spread-out colors show; the rest are things. Each training recording is a
roster of what usually stands there. The one to act on is told by elimination: it is where such a thing usually is, or
looks like it, and nothing else that the recordings show explains it. So it is found also when its color, size or place
have changed. Where it touches other things, it may be what is left without their colors.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int32

from rpaug.diagnosis import parts

CLUSTERS = 8
SPREAD = 0.30  # share of the cells in which a color is found, if it is the table's
CELLS = 8  # a side
CLOSE = 11.0  # Lab units: as near as this to a color of the table is table
EXPLAINED = (
    9.0  # Lab units, lightness halved: as near as this to a color of other things, it may be theirs
)
DARKENED = np.array([0.5, 1, 1], np.float32)
COLORS = 600  # that stand for all of the other things
MOST = 0.9  # share of a region: more than this is the region itself
FULL = 0.7  # share of its convex outline that a piece must fill
COLOR, SIZE, PLACE = (
    14.0,
    0.35,
    0.07,
)  # usual differences: Lab units, logarithm, share of the width
WORST = 3.0  # in usual differences: what is further off counts no more
LIKE = 2.75  # of color and size together: what is less like is another thing
LOOKS = 0.6  # what color and size of the thing to act on count for, beside its place: they may have changed


@dataclass(frozen=True)
class TableInstance:
    """Something on the table: its pixels, mean Lab color, logarithm of its area's root, and middle."""

    mask: Bool[np.ndarray, "h w"]
    color: Float32[np.ndarray, "3"]
    size: float
    place: Float32[np.ndarray, "2"]  # right and down, shares of the width


def thing(mask: Bool[np.ndarray, "h w"], lab: Float32[np.ndarray, "h w 3"]) -> TableInstance:
    """What a mask shows of an image in Lab."""
    rows, columns = np.nonzero(mask)
    place = np.array([columns.mean(), rows.mean()], np.float32) / mask.shape[1]
    return TableInstance(
        mask, np.median(lab[mask], 0).astype(np.float32), 0.5 * float(np.log(mask.sum())), place
    )


def by_ids(
    ids: Int32[np.ndarray, "h w"],
    within: Bool[np.ndarray, "h w"],
    lab: Float32[np.ndarray, "h w 3"],
) -> dict[int, TableInstance]:
    """Everything that a mask tells apart within a region."""
    counts = {int(i): int((within & (ids == i)).sum()) for i in np.unique(ids[within]) if i}
    return {
        i: thing(within & (ids == i), lab) for i, count in counts.items() if count >= parts.LEAST
    }


def by_color(
    lab: Float32[np.ndarray, "h w 3"],
    within: Bool[np.ndarray, "h w"],
    known: Float32[np.ndarray, "n 3"],
) -> tuple[list[TableInstance], list[TableInstance]]:
    """Connected regions that differ from the table's colors, parted where two things touch; and what else of them may
    be one thing: those that were parted, whole, since they may be patterned, and what is left of each without the
    colors of the recordings' other things."""
    found, others = [], []
    for whole in parts.regions(parts.opened(within & ~table(lab, within))):
        pieces = [one for one in parts.parted(whole, lab) if not parts.thin(one)]
        found += [thing(one, lab) for one in pieces]
        others += [thing(whole, lab)] if len(pieces) > 1 else []
        others += [thing(one, lab) for one in _unexplained(whole, lab, known)]
    return found, others


def palette(pixels: Float32[np.ndarray, "n 3"], most: int = COLORS) -> Float32[np.ndarray, "k 3"]:
    """Some of many colors, evenly taken, lightness halved: it changes most as a thing turns in the light."""
    return pixels[:: max(1, len(pixels) // most)] * DARKENED


def _unexplained(
    whole: Bool[np.ndarray, "h w"],
    lab: Float32[np.ndarray, "h w 3"],
    known: Float32[np.ndarray, "n 3"],
) -> list[Bool[np.ndarray, "h w"]]:
    """The compact pieces of a region that are of no known color, if others of it are."""
    if not len(known):
        return []
    colors = lab[whole] * DARKENED
    left = np.zeros_like(whole)
    left[whole] = np.linalg.norm(colors[:, None] - known, axis=2).min(1) > EXPLAINED
    return [
        one
        for one in parts.regions(parts.opened(left))
        if one.sum() <= MOST * whole.sum() and parts.solid(one) >= FULL and not parts.thin(one)
    ]


def table(
    lab: Float32[np.ndarray, "h w 3"], within: Bool[np.ndarray, "h w"]
) -> Bool[np.ndarray, "h w"]:
    """Pixels of a region that show its commonest, most spread-out colors.

    What passes for table is looked at once more by itself: among all colors of the picture, a thing of nearly the
    table's color falls into one cluster with it.
    """
    return _common(lab, _common(lab, within))


def _common(
    lab: Float32[np.ndarray, "h w 3"], within: Bool[np.ndarray, "h w"]
) -> Bool[np.ndarray, "h w"]:
    """Pixels of a region in clusters of color that are found in many places of it, or near to such a cluster."""
    pixels = lab[within]
    if len(pixels) < 50 * CLUSTERS:
        return np.zeros_like(within)
    centres, labels = parts.clustered(pixels, CLUSTERS)
    h, w = within.shape
    rows, columns = np.nonzero(within)
    cell = (rows * CELLS // h) * CELLS + columns * CELLS // w
    whole = np.bincount(cell, minlength=CELLS * CELLS)
    there = whole > 0.2 * (h // CELLS) * (w // CELLS)
    spread = [
        np.mean((np.bincount(cell[labels == k], minlength=CELLS * CELLS) > 0.06 * whole)[there])
        for k in range(CLUSTERS)
    ]
    common = [k for k in range(CLUSTERS) if spread[k] >= SPREAD]
    common = common or [int(np.argmax(spread))]
    apart = np.min([np.linalg.norm(pixels - centres[k], axis=1) for k in common], 0)
    out = np.zeros_like(within)
    out[within] = np.isin(labels, common) | (apart < CLOSE)
    return out


@dataclass(frozen=True)
class Roster:
    """What stood on the table in one recording; `target` is the row of the thing the robot acts on, None if unseen."""

    things: Sequence[TableInstance]
    target: int | None

    def others(self) -> "Roster":
        """The same without the thing that the robot acts on."""
        return Roster([one for k, one in enumerate(self.things) if k != self.target], None)


def recognised(
    seen: Sequence[TableInstance], wholes: Sequence[TableInstance], rosters: Sequence[Roster]
) -> tuple[TableInstance | None, Sequence[TableInstance]]:
    """The thing to act on, which may be one of the `wholes`, and the things that no roster has."""
    mine = [one.things[one.target] for one in rosters if one.target is not None]
    rest = [one.others() for one in rosters]
    if not seen or not mine:
        return None, unknown(seen, rest)
    others = [one for roster in rest for one in roster.things]
    target = min((*seen, *wholes), key=lambda one: _as_target(one, mine) - _as_other(one, others))
    return target, unknown([one for one in seen if not (one.mask & target.mask).any()], rest)


def unknown(seen: Sequence[TableInstance], rosters: Sequence[Roster]) -> Sequence[TableInstance]:
    """The things that even the roster with the fewest such lacks."""
    left: Sequence[TableInstance] = seen
    for roster in rosters:
        taken = matched(seen, roster).values() if seen and roster.things else ()
        rest = [one for i, one in enumerate(seen) if i not in taken]
        left = min(left, rest, key=lambda some: sum(int(one.mask.sum()) for one in some))
    return left


def matched(seen: Sequence[TableInstance], roster: Roster) -> dict[int, int]:
    """Rows of `seen` by rows of the roster, the likest pair first; what is too unlike is no pair."""
    cost = np.array([[_unlike(a, b) for a in seen] for b in roster.things])
    taken: dict[int, int] = {}
    for flat in np.argsort(cost, axis=None):
        j, i = divmod(int(flat), len(seen))
        if cost[j, i] > LIKE:
            break
        if j not in taken and i not in taken.values():
            taken[j] = i
    return taken


def _as_target(one: TableInstance, mine: Sequence[TableInstance]) -> float:
    """How unlike the thing to act on it is, as any recording shows that, in usual differences."""
    away = min(float(np.linalg.norm(one.place - other.place)) for other in mine) / PLACE
    return min(WORST, away) + LOOKS * min(_unlike(one, other) for other in mine)


def _as_other(one: TableInstance, others: Sequence[TableInstance]) -> float:
    """How unlike everything else that the recordings show it is."""
    return min((_unlike(one, other) for other in others), default=2 * WORST)


def _unlike(a: TableInstance, b: TableInstance) -> float:
    """How unlike two things look, in usual differences of color and size."""
    color = min(WORST, float(np.linalg.norm(a.color - b.color)) / COLOR)
    return color + min(WORST, abs(a.size - b.size) / SIZE)
