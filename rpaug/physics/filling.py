"""What is inside a thing of which only the surface was seen: particles in columns from its foot to its top."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64

from rpaug.core.errors import Unsupported

CLOSED = 3  # cells: gaps between seen points that are closed
RIM = 0.8  # cells from the nearest cell outside: cells on the outline are half empty
FINEST = 0.001  # metres: the least side of a column
FOOT = 0.02  # share of the points that may lie below the foot: noise
NOWHERE = -1e3


@dataclass(frozen=True)
class Columns:
    """A thing from above: cell (row, column) is about `origin + cell * (column, row)`, its top at `top` where
    `inside`, its foot at height `bottom`; metres in the world."""

    origin: Float64[np.ndarray, "2"]
    cell: float
    top: Float32[np.ndarray, "r c"]
    inside: Bool[np.ndarray, "r c"]
    bottom: float

    @property
    def volume(self) -> float:
        """In cubic metres."""
        return float(self.filled(self.cell)[1].sum())

    def filled(self, spacing: float) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n"]]:
        """Particles about `spacing` metres apart, and the volume of each."""
        size = self.cell * np.array(self.inside.shape[::-1])
        columns, rows = np.maximum(np.round(size / spacing), 1).astype(int)
        step = size / [columns, rows]
        x, y = np.meshgrid((np.arange(columns) + 0.5) * step[0], (np.arange(rows) + 0.5) * step[1])
        at = np.minimum(
            (np.stack([y, x], -1) / self.cell).astype(int), np.array(self.inside.shape) - 1
        )
        inside = self.inside[at[..., 0], at[..., 1]]
        within = inside & (self._depth(x / self.cell - 0.5, y / self.cell - 0.5) > RIM)
        inside = within if within.any() else inside
        height = self.top[at[..., 0], at[..., 1]][inside].astype(float) - self.bottom
        counts = np.maximum(np.round(height / spacing), 1).astype(int)
        owner = np.repeat(np.arange(len(counts)), counts)
        number = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
        low = self.origin - self.cell / 2
        z = self.bottom + (number + 0.5) * (height / counts)[owner]
        places = np.stack([low[0] + x[inside][owner], low[1] + y[inside][owner], z], -1)
        return places, step.prod() * (height / counts)[owner]

    def _depth(self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> np.ndarray:
        """How many cells inside of the outline points are, given in cells."""
        depth = cv2.distanceTransform(self.inside.astype(np.uint8), cv2.DIST_L2, 5)
        return cv2.remap(depth, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR)


def columns(
    points: Float[np.ndarray, "n 3"], footprint: float, level: float | None, lifted: float
) -> Columns:
    """The columns under surface points that are about `footprint` metres apart.

    A thing whose foot is within `lifted` of the support at height `level` stands on it. Raises Unsupported for a thing
    that is seen too little of to have an inside.
    """
    cell = max(footprint, FINEST)
    low, high = points[:, :2].min(0), points[:, :2].max(0)
    width, depth = (np.round((high - low) / cell).astype(int) + 1).tolist()
    top = np.full((depth, width), NOWHERE, np.float32)
    column, row = np.round((points[:, :2] - low) / cell).astype(int).T
    np.maximum.at(top, (row, column), points[:, 2].astype(np.float32))
    top = np.pad(top, CLOSED, constant_values=NOWHERE)
    top = cv2.morphologyEx(top, cv2.MORPH_CLOSE, np.ones((CLOSED, CLOSED), np.uint8))
    inside = top > NOWHERE / 2
    foot = float(np.quantile(points[:, 2], FOOT))
    bottom = level if level is not None and abs(foot - level) < lifted else foot
    inside &= top > bottom
    found = Columns(low - CLOSED * cell, cell, top, inside, bottom)
    if inside.sum() < 2 or found.volume <= 0:
        raise Unsupported("simulating: too little of the thing was seen to fill it")
    return found
