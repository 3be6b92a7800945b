"""Colors kept where they lie on bodies: a sparse volume of cells, with coarser copies for whoever stands far away.

Each cell corner averages the samples around it, weighted trilinearly, and a point reads the eight corners around it the
same way. Every level has cells twice as wide as the one before: a pixel reads the coarsest level whose cells are no
wider than what it covers, as with mip maps (Williams 1983), and a point in cells that no sample reached reads a coarser
one.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64, Int32, Int64

LEVELS = 12
ENOUGH = 0.05  # of a sample: less weight than this around a point is taken for none
BITS = 17  # of each coordinate in a cell's key


@dataclass(frozen=True)
class Level:
    """Cells by ascending key: summed values and weights of their corners."""

    keys: Int64[np.ndarray, "m"]
    values: Float64[np.ndarray, "m c"]
    weights: Float64[np.ndarray, "m"]


@dataclass(frozen=True)
class Painting:
    """`c` numbers for every point near the samples it was made of. `cell` is the finest cell's width in metres."""

    levels: tuple[Level, ...]
    cell: float
    instance_ids: Int32[np.ndarray, "k"]

    @classmethod
    def of(
        cls,
        ids: Int32[np.ndarray, "n"],
        points: Float32[np.ndarray, "n 3"],
        values: Float32[np.ndarray, "n c"],
        cell: float,
    ) -> "Painting":
        """Samples at points of the bodies' frames; `cell` is how wide the finest cells are, in metres.

        Raises ValueError without samples.
        """
        if not len(points):
            raise ValueError("a painting needs samples")
        instance_ids = np.unique(ids)
        levels = []
        for number in range(LEVELS):
            levels.append(_level(instance_ids, ids, points, values, cell * 2.0**number))
            if len(levels[-1].keys) <= 8 * len(instance_ids):
                break
        return cls(tuple(levels), cell, instance_ids)

    def at(
        self,
        ids: Int32[np.ndarray, "n"],
        points: Float32[np.ndarray, "n 3"],
        footprint: Float32[np.ndarray, "n"],
    ) -> tuple[Float64[np.ndarray, "n c"], Float64[np.ndarray, "n"]]:
        """Values at points, and their weight: 0 where nothing was ever sampled nearby, on that instance id."""
        out = np.zeros((len(points), self.levels[0].values.shape[1]))
        found = np.zeros(len(points))
        wanted = np.log2(np.maximum(footprint, 1e-9) / self.cell)
        start = np.clip(np.floor(wanted), 0, len(self.levels) - 1).astype(int)
        for number, level in enumerate(self.levels):
            rows = np.flatnonzero((start <= number) & (found < ENOUGH))
            if not len(rows):
                continue
            keys, shares = corners(
                self.instance_ids, ids[rows], points[rows], self.cell * 2.0**number
            )
            at = np.minimum(np.searchsorted(level.keys, keys), len(level.keys) - 1)
            shares = np.where(level.keys[at] == keys, shares, 0.0)
            weight = (shares * level.weights[at]).sum(0)
            total = (shares[..., None] * level.values[at]).sum(0)
            good = weight >= ENOUGH
            out[rows[good]] = total[good] / weight[good, None]
            found[rows[good]] = weight[good]
        return out, found


def _level(
    instance_ids: Int32[np.ndarray, "k"],
    ids: Int32[np.ndarray, "n"],
    points: Float32[np.ndarray, "n 3"],
    values: Float32[np.ndarray, "n c"],
    cell: float,
) -> Level:
    keys, shares = corners(instance_ids, ids, points, cell)
    unique, where = np.unique(keys.ravel(), return_inverse=True)
    where = where.reshape(keys.shape)
    weights = np.bincount(where.ravel(), shares.ravel(), len(unique))
    sums = [
        np.bincount(where.ravel(), (shares * column).ravel(), len(unique)) for column in values.T
    ]
    return Level(unique, np.stack(sums, -1), weights)


def corners(
    instance_ids: Int32[np.ndarray, "k"],
    ids: Int32[np.ndarray, "n"],
    points: Float32[np.ndarray, "n 3"],
    cell: float,
) -> tuple[Int64[np.ndarray, "8 n"], Float64[np.ndarray, "8 n"]]:
    """Keys of the eight corners around each point, and the point's share of each. Unknown instance ids have key -1."""
    scaled = points.astype(np.float64) / cell
    low = np.floor(scaled).astype(np.int64)
    part = scaled - low
    half = 1 << (BITS - 1)
    known = np.minimum(np.searchsorted(instance_ids, ids), len(instance_ids) - 1)
    base = np.where(instance_ids[known] == ids, known, -1).astype(np.int64)
    keys, shares = [], []
    for corner in np.ndindex(2, 2, 2):
        at = np.clip(low + corner + half, 0, 2 * half - 1)
        key = base
        for axis in range(3):
            key = (key << BITS) | at[:, axis]
        keys.append(np.where(base < 0, -1, key))
        shares.append(np.where(corner, part, 1 - part).prod(-1))
    return np.stack(keys), np.stack(shares)


def places(
    instance_ids: Int32[np.ndarray, "k"], keys: Int64[np.ndarray, "m"], cell: float
) -> tuple[Int32[np.ndarray, "m"], Float32[np.ndarray, "m 3"]]:
    """Handle and point of each corner, from its key."""
    half, mask = 1 << (BITS - 1), (1 << BITS) - 1
    whole = np.stack([(keys >> (BITS * (2 - axis))) & mask for axis in range(3)], -1) - half
    return instance_ids[keys >> (3 * BITS)], (whole * cell).astype(np.float32)
