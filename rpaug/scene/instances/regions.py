"""Pixels gathered: regions of space that hold together, and label images without specks."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, Float64, Int, Int32

WINDOW = np.ones((3, 3), np.float32)
SPECK = 3  # of nine: a pixel with fewer neighbours of its label, itself counted, takes theirs


@dataclass(frozen=True)
class Regions:
    """Cells of space, ascending, and the number of the region that each belongs to."""

    cell: float
    cells: Int[np.ndarray, "n"]
    number: Int[np.ndarray, "n"]

    @property
    def count(self) -> int:
        """How many regions there are."""
        return int(self.number.max()) + 1 if len(self.number) else 0

    def of(self, points: Float64[np.ndarray, "m 3"]) -> Int[np.ndarray, "m"]:
        """The region of each point in metres, -1 for none."""
        if not len(self.cells):
            return np.full(len(points), -1)
        packed = _packed(np.floor(points / self.cell).astype(np.int64))
        at = np.minimum(np.searchsorted(self.cells, packed), len(self.cells) - 1)
        return np.where(self.cells[at] == packed, self.number[at], -1)


def connected(points: Float64[np.ndarray, "n 3"], cell: float, fewest: int) -> Regions:
    """Regions of touching cells (corners count), those with `fewest` points or more, the fullest first."""
    grid, count = np.unique(np.floor(points / cell).astype(np.int64), axis=0, return_counts=True)
    packed = _packed(grid)
    order = np.argsort(packed)
    grid, count, packed = grid[order], count[order], packed[order]
    label = np.arange(len(packed))
    steps = np.array([(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)])
    pairs = []
    for step in steps[len(steps) // 2 + 1 :]:
        other = _packed(grid + step)
        at = np.minimum(np.searchsorted(packed, other), max(len(packed) - 1, 0))
        here = np.flatnonzero(packed[at] == other) if len(packed) else np.zeros(0, int)
        pairs.append(np.stack([here, at[here]], 1))
    links = np.concatenate(pairs)
    while True:  # labels run along the links until they are settled
        low = np.minimum(label[links[:, 0]], label[links[:, 1]])
        settled = label.copy()
        np.minimum.at(settled, links[:, 0], low)
        np.minimum.at(settled, links[:, 1], low)
        settled = settled[settled]
        if np.array_equal(settled, label):
            break
        label = settled
    held = np.bincount(label, count, len(label)) if len(label) else np.zeros(0)
    kept = np.flatnonzero(held >= fewest)
    number = np.full(len(label), -1)
    for k, one in enumerate(kept[np.argsort(-held[kept], kind="stable")]):
        number[label == one] = k
    use = number >= 0
    return Regions(cell, packed[use], number[use])


def tidied(
    instance_ids: Int32[np.ndarray, "h w"], depth: Float32[np.ndarray, "h w"]
) -> Int32[np.ndarray, "h w"]:
    """Handles with single pixels and pairs taken over by what most of their neighbours show."""
    found = np.unique(instance_ids[instance_ids > 0])
    if len(found) < 2:
        return instance_ids
    counts = np.stack(
        [
            cv2.filter2D(
                (instance_ids == one).astype(np.float32), -1, WINDOW, borderType=cv2.BORDER_CONSTANT
            )
            for one in found
        ]
    )
    own = np.take_along_axis(
        counts, np.searchsorted(found, np.maximum(instance_ids, found[0]))[None], 0
    )[0]
    speck = (own < SPECK) & (depth > 0) & (instance_ids > 0)
    return np.where(speck, found[counts.argmax(0)], instance_ids).astype(np.int32)


def _packed(cells: Int[np.ndarray, "n 3"]) -> Int[np.ndarray, "n"]:
    """One number for a cell: 21 bits an axis."""
    x, y, z = (cells & 0x1FFFFF).T
    return x << 42 | y << 21 | z
