"""What particles run into: things that stand still, as distances on a grid, and boxes that follow recorded tracks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Float, Float32, Float64

from rpaug.core.errors import Unsupported
from rpaug.physics.contact import COLUMNS

MOST_NODES = 4_000_000
FAR = 1e3  # metres: of what is not there


@dataclass(frozen=True)
class Still:
    """Distances in metres to what stands still, negative inside, and the ways out of it, on the nodes of a grid.

    Node (i, j, n) lies at `origin + cell * (i, j, n)`.
    """

    origin: Float64[np.ndarray, "3"]
    cell: float
    distance: Float32[np.ndarray, "i j n"]
    normals: Float32[np.ndarray, "i j n 3"]

    @property
    def most(self) -> Float64[np.ndarray, "3"]:
        """The last node's place."""
        return self.origin + self.cell * (np.array(self.distance.shape) - 1)


def still(
    low: Float64[np.ndarray, "3"],
    high: Float64[np.ndarray, "3"],
    cell: float,
    level: float | None = None,
    points: Float[np.ndarray, "n 3"] | None = None,
) -> Still:
    """A box of the world with a floor at height `level` and surface points, each as a ball that closes the gaps.

    The floor lies on nodes exactly. Raises Unsupported for a box of too many cells.
    """
    low = np.array(low, float)
    if level is not None:
        low[2] = level - cell * np.ceil((level - low[2]) / cell - 1e-9)
    shape = np.ceil((high - low) / cell - 1e-9).astype(int) + 1
    if np.prod(shape.astype(float)) > MOST_NODES:
        raise Unsupported(
            f"simulating {' x '.join(f'{s * cell:.2f}' for s in shape)} m in cells of {1000 * cell:.1f} mm: "
            f"{np.prod(shape.astype(float)):.3g} cells, at most {MOST_NODES:.3g}; ask for larger cells"
        )
    distance = np.full(shape, FAR, np.float32)
    normals = np.zeros((*shape, 3), np.float32)
    normals[..., 2] = 1.0
    if points is not None and len(points):
        _balls(distance, normals, low, cell, points)
    if level is not None:
        # On the floor's own nodes as well: what rests there rests there.
        height = low[2] + cell * np.arange(shape[2]) - level - 1e-6 * cell
        lower = height[None, None] < distance
        distance = np.where(lower, np.float32(height), distance)
        normals[lower] = [0, 0, 1]
    return Still(low, cell, distance, normals)


def _balls(
    distance: Float32[np.ndarray, "i j n"],
    normals: Float32[np.ndarray, "i j n 3"],
    low: Float64[np.ndarray, "3"],
    cell: float,
    points: Float[np.ndarray, "n 3"],
) -> None:
    """Fill in distances to balls around points, one cell wide: nothing slips between them."""
    shape = np.array(distance.shape)
    place = (points - low) / cell
    kept = np.unique(np.round(2 * place).astype(int), axis=0) / 2
    nearest = np.round(kept).astype(int)
    for step in np.ndindex(3, 3, 3):
        node = nearest + np.array(step) - 1
        away = node - kept
        length = np.linalg.norm(away, axis=1)
        inside = ((node >= 0) & (node < shape)).all(1)
        order = np.flatnonzero(inside)[np.argsort(-length[inside], kind="stable")]
        i, j, n = node[order].T
        near = (cell * (length[order] - 1.0)).astype(np.float32)
        closer = near < distance[i, j, n]
        order, i, j, n = order[closer], i[closer], j[closer], n[closer]
        distance[i, j, n] = near[closer]  # the nearest comes last and stays
        out = away[order] / np.maximum(length[order], 1e-6)[:, None]
        normals[i, j, n] = np.where(length[order, None] > 1e-6, out, [0.0, 0.0, 1.0])


Track = Callable[[float], Float64[np.ndarray, "b columns"]]
"""Boxes as they are and move at a time in seconds, rows as `rpaug.physics.contact` describes them."""


def nothing(seconds: float) -> Float64[np.ndarray, "b columns"]:
    """No boxes."""
    return np.zeros((0, COLUMNS))


@dataclass(frozen=True)
class Boxes:
    """Rounded boxes fixed to bodies whose poses were recorded `pace` seconds apart; between, they go smoothly.

    Places are Hermite cubics that never go beyond what was recorded (Fritsch and Butland, "A Method for Constructing
    Local Monotone Piecewise Cubic Interpolants", SIAM J. Sci. Stat. Comput. 5(2), 1984): a speed that jumped at each
    frame would knock away what is pushed. They turn evenly from frame to frame.
    `places` are the boxes' poses in their bodies, `halves` half sizes without the `radius` around them.
    """

    tracks: Float64[np.ndarray, "b t 4 4"]
    halves: Float64[np.ndarray, "b 3"]
    radius: Float64[np.ndarray, "b"]
    pace: float

    @staticmethod
    def of(
        tracks: Sequence[Float64[np.ndarray, "t 4 4"]],
        places: Sequence[Float64[np.ndarray, "4 4"]],
        halves: Sequence[Float64[np.ndarray, "3"]],
        radius: Sequence[float],
        pace: float,
    ) -> "Boxes":
        """Boxes at `places` in bodies of these tracks."""
        world = [track @ place for track, place in zip(tracks, places, strict=True)]
        return Boxes(np.stack(world), np.stack(halves), np.array(radius, float), pace)

    @cached_property
    def _turns(self) -> Float64[np.ndarray, "b t 3"]:
        """Rotation vectors from each frame to the next."""
        steps = self.tracks[:, 1:, :3, :3] @ np.swapaxes(self.tracks[:, :-1, :3, :3], -1, -2)
        flat = [cv2.Rodrigues(step)[0][:, 0] for step in steps.reshape(-1, 3, 3)]
        return np.array(flat).reshape(*steps.shape[:2], 3)

    @cached_property
    def _slopes(self) -> Float64[np.ndarray, "b t 3"]:
        """Metres a frame at the frames: the harmonic mean of the steps around, nothing where it turns back."""
        steps = np.diff(self.tracks[:, :, :3, 3], axis=1)
        before = np.concatenate([steps[:, :1], steps], axis=1)
        after = np.concatenate([steps, steps[:, -1:]], axis=1)
        same = before * after > 0
        return np.where(same, 2 * before * after / np.where(same, before + after, 1.0), 0.0)

    def __call__(self, seconds: float) -> Float64[np.ndarray, "b columns"]:
        length = self.tracks.shape[1]
        at = min(max(seconds / self.pace, 0.0), length - 1.0)
        k = min(int(at), max(length - 2, 0))
        share, moving = at - k, length > 1 and seconds / self.pace < length - 1
        now = self.tracks[:, k]
        rows = np.zeros((len(now), COLUMNS))
        rows[:, :3], rows[:, 3:12] = now[:, :3, 3], now[:, :3, :3].reshape(-1, 9)
        rows[:, 12:15], rows[:, 15] = self.halves, self.radius
        if length > 1:
            turns = self._turns[:, k]
            rows[:, 3:12] = (_rotations(share * turns) @ now[:, :3, :3]).reshape(-1, 9)
            rows[:, :3], speeds = self._placed(k, share)
            if moving:
                rows[:, 16:19], rows[:, 19:22] = speeds / self.pace, turns / self.pace
        return rows

    def _placed(
        self, k: int, share: float
    ) -> tuple[Float64[np.ndarray, "b 3"], Float64[np.ndarray, "b 3"]]:
        """Where the boxes are, a share of the way from frame `k` to the next, and how far they go a frame."""
        first, last = self.tracks[:, k, :3, 3], self.tracks[:, k + 1, :3, 3]
        out, into, way = self._slopes[:, k], self._slopes[:, k + 1], last - first
        bend = out + into - 2 * way
        lean = 3 * way - 2 * out - into
        place = first + share * (out + share * (lean + share * bend))
        return place, out + share * (2 * lean + 3 * share * bend)


def _rotations(turns: Float64[np.ndarray, "b 3"]) -> Float64[np.ndarray, "b 3 3"]:
    """Rotation matrices of rotation vectors in radians (Rodrigues' formula)."""
    angle = np.linalg.norm(turns, axis=1)
    x, y, z = (turns / np.maximum(angle, 1e-12)[:, None]).T
    nil = np.zeros_like(x)
    cross = np.stack([nil, -z, y, z, nil, -x, -y, x, nil], -1).reshape(-1, 3, 3)
    sine, rest = np.sin(angle)[:, None, None], (1 - np.cos(angle))[:, None, None]
    return np.eye(3) + sine * cross + rest * (cross @ cross)
