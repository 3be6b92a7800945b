"""What stands on the table in an image without a mask, and which of it the robot is to act on.

The table is what the commonest, most spread-out colours show; the rest are things. Each training recording is a
roster of what usually stands there: the thing that takes the manipulated one's place in the best-fitting roster is it,
also when its colour, size or place have changed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8

CLUSTERS = 8
SPREAD = 0.30  # share of the cells in which a colour is found, if it is the table's
CELLS = 8  # a side
CLOSE = 11.0  # Lab units: as near as this to a colour of the table is table
LEAST = 14  # pixels of a thing
SOLID = 0.84  # share of its convex outline that a thing fills
COLOUR, SIZE, PLACE = (
    14.0,
    0.35,
    0.07,
)  # usual differences: Lab units, logarithm, share of the width
WORST = 3.0  # in usual differences: what is further off counts no more


@dataclass(frozen=True)
class Thing:
    """Something on the table: its pixels, mean Lab colour, logarithm of its area's root, and middle."""

    mask: Bool[np.ndarray, "h w"]
    colour: Float32[np.ndarray, "3"]
    size: float
    place: Float32[np.ndarray, "2"]  # right and down, shares of the width


def thing(mask: Bool[np.ndarray, "h w"], lab: Float32[np.ndarray, "h w 3"]) -> Thing:
    """What a mask shows of an image in Lab."""
    rows, columns = np.nonzero(mask)
    place = np.array([columns.mean(), rows.mean()], np.float32) / mask.shape[1]
    return Thing(
        mask, np.median(lab[mask], 0).astype(np.float32), 0.5 * float(np.log(mask.sum())), place
    )


def by_ids(
    ids: Int32[np.ndarray, "h w"],
    within: Bool[np.ndarray, "h w"],
    lab: Float32[np.ndarray, "h w 3"],
) -> dict[int, Thing]:
    """Everything that a mask tells apart within a region."""
    counts = {int(i): int((within & (ids == i)).sum()) for i in np.unique(ids[within]) if i}
    return {i: thing(within & (ids == i), lab) for i, count in counts.items() if count >= LEAST}


def by_colour(lab: Float32[np.ndarray, "h w 3"], within: Bool[np.ndarray, "h w"]) -> list[Thing]:
    """Connected regions that differ from the table's colours, within a region."""
    other = within & ~table(lab, within)
    other = cv2.morphologyEx(other.astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    return [thing(part, lab) for whole in _regions(other) for part in _parts(whole, lab)]


def _regions(mask: UInt8[np.ndarray, "h w"]) -> list[Bool[np.ndarray, "h w"]]:
    """Connected regions of enough pixels."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    return [labels == i for i in range(1, count) if stats[i, cv2.CC_STAT_AREA] >= LEAST]


def _parts(
    whole: Bool[np.ndarray, "h w"], lab: Float32[np.ndarray, "h w 3"]
) -> list[Bool[np.ndarray, "h w"]]:
    """The region itself if it fills its outline, as one thing does; else its parts of one hue each."""
    points = np.argwhere(whole)[:, ::-1].astype(np.int32)
    hull = cv2.convexHull(points)
    outline = np.zeros(whole.shape, np.uint8)
    cv2.fillConvexPoly(outline, hull, 1)
    if whole.sum() >= SOLID * outline.sum():
        return [whole]
    hues = lab[whole] * np.array([0.2, 1, 1], np.float32)
    _, near = clustered(hues, count=3)
    labels = np.full(whole.shape, -1)
    labels[whole] = near
    kernel = np.ones((2, 2), np.uint8)
    opened = [
        cv2.morphologyEx((labels == k).astype(np.uint8), cv2.MORPH_OPEN, kernel) for k in range(3)
    ]
    return [part for one in opened for part in _regions(one)] or [whole]


def table(
    lab: Float32[np.ndarray, "h w 3"], within: Bool[np.ndarray, "h w"]
) -> Bool[np.ndarray, "h w"]:
    """Pixels of a region that show its commonest, most spread-out colours."""
    pixels = lab[within]
    if len(pixels) < 50 * CLUSTERS:
        return np.zeros_like(within)
    centres, labels = clustered(pixels)
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


def clustered(
    pixels: Float32[np.ndarray, "n 3"], count: int = CLUSTERS, rounds: int = 12
) -> tuple[Float32[np.ndarray, "k 3"], Int32[np.ndarray, "n"]]:
    """k-means that begins at the pixels furthest from each other: the same every time (Lloyd 1982)."""
    some = pixels[:: max(1, len(pixels) // 3000)]
    centres = [np.median(some, 0)]
    for _ in range(count - 1):
        apart = np.min([np.linalg.norm(some - c, axis=1) for c in centres], 0)
        # Not the very furthest: that is a lone pixel on an outline.
        centres.append(some[int(np.argsort(apart)[int(0.98 * (len(some) - 1))])])
    middle = np.array(centres, np.float32)
    for _ in range(rounds):
        near = _nearest(some, middle)
        for k in range(count):
            if (near == k).any():
                middle[k] = some[near == k].mean(0)
    return middle, _nearest(pixels, middle)


def _nearest(
    pixels: Float32[np.ndarray, "n 3"], centres: Float32[np.ndarray, "k 3"]
) -> Int32[np.ndarray, "n"]:
    return np.argmin(((pixels[:, None] - centres) ** 2).sum(2), 1).astype(np.int32)


@dataclass(frozen=True)
class Roster:
    """What stood on the table in one recording; `target` is the row of the thing the robot acts on, None if unseen."""

    things: Sequence[Thing]
    target: int | None


def recognised(
    seen: Sequence[Thing], rosters: Sequence[Roster]
) -> tuple[Thing | None, Sequence[Thing]]:
    """The thing to act on, and the things that no roster has."""
    best: tuple[float, int | None, list[int]] = (np.inf, None, [])
    for roster in rosters:
        if roster.target is None or not seen:
            continue
        taken, cost = matched(seen, roster)
        row = taken.get(roster.target)
        left = [i for i in range(len(seen)) if i not in taken.values()]
        if row is not None and cost < best[0]:
            best = (cost, row, left)
    _, row, left = best
    return (None if row is None else seen[row]), [seen[i] for i in left]


def unknown(seen: Sequence[Thing], rosters: Sequence[Roster]) -> Sequence[Thing]:
    """The things that even the roster with the fewest such lacks."""
    left: Sequence[Thing] = seen
    for roster in rosters:
        taken = matched(seen, roster)[0].values() if seen and roster.things else ()
        rest = [one for i, one in enumerate(seen) if i not in taken]
        left = min(left, rest, key=lambda some: sum(int(one.mask.sum()) for one in some))
    return left


def matched(seen: Sequence[Thing], roster: Roster) -> tuple[dict[int, int], float]:
    """Rows of `seen` by rows of the roster, the likest pair first, and how unlike they are in all."""
    cost = np.array(
        [[_unlike(a, b, j == roster.target) for a in seen] for j, b in enumerate(roster.things)]
    )
    taken: dict[int, int] = {}
    total = 0.0
    for flat in np.argsort(cost, axis=None):
        j, i = divmod(int(flat), len(seen))
        if j in taken or i in taken.values():
            continue
        taken[j] = i
        total += float(cost[j, i])
    missing = len(roster.things) - len(taken)
    return taken, total + 2 * WORST * missing


def _unlike(a: Thing, b: Thing, placed: bool) -> float:
    """How unlike two things are; where the roster's one is the target, its place counts."""
    colour = min(WORST, float(np.linalg.norm(a.colour - b.colour)) / COLOUR)
    size = min(WORST, abs(a.size - b.size) / SIZE)
    place = min(WORST, float(np.linalg.norm(a.place - b.place)) / PLACE) if placed else 0.0
    return colour + size + place
