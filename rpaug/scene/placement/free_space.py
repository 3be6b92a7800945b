"""Free space on a support, looked at from above: where a thing of some outline and height may be put."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int

CELL = 0.01  # metres
AROUND = (
    0.2  # metres: what stands with its middle in a part of the room reaches no farther out of it
)
MARGIN = 0.05  # metres to other things, as COLOSSEUM keeps them apart
ASKED = 0.02  # metres of the same where somebody asked for the very place
EDGE = 0.02  # metres to where the support ends or was not seen: cells at its rim hold half a pixel of it


@dataclass(frozen=True)
class FreeSpace:
    """The support from above; cell (row, column) has its middle at `origin + CELL * (column, row)`.

    `seen` is where the support itself was seen, `still` the height from which a standing thing takes the cell, and
    `swept` that of what moves: both inf where there is none, in metres above the support at world z = `level`.
    """

    origin: Float64[np.ndarray, "2"]
    level: float
    seen: Bool[np.ndarray, "r c"]
    still: Float32[np.ndarray, "r c"]
    swept: Float32[np.ndarray, "r c"]

    def spots(
        self, outline: Float[np.ndarray, "k 2"], height: float, margin: float = MARGIN
    ) -> Bool[np.ndarray, "r c"]:
        """Cells onto which the middle of a thing may be put; `outline` is convex, in metres around that middle.

        It keeps `margin` metres from what stands and from the way of what moves, and `EDGE` on the support.
        """
        close = (self.still < height) | (self.swept < height + margin)
        taken = cv2.dilate(close.astype(np.uint8), disc(margin))
        shape = _stamp(outline)
        blocked = cv2.dilate(taken, shape, borderValue=1)
        rim = cv2.dilate((~self.seen).astype(np.uint8), disc(EDGE), borderValue=1)
        beside = cv2.dilate(rim, shape, borderValue=1)
        return (blocked == 0) & (beside == 0)

    def free(
        self, outline: Float[np.ndarray, "k 2"], height: float, middle: Float[np.ndarray, "2"]
    ) -> bool:
        """Whether there is room for a thing at that very place, which somebody asked for."""
        column, row = np.rint((middle - self.origin) / CELL).astype(int)
        inside = 0 <= row < self.seen.shape[0] and 0 <= column < self.seen.shape[1]
        return inside and bool(self.spots(outline, height, ASKED)[row, column])

    def near(self, points: Float[np.ndarray, "n k"], within: float) -> Bool[np.ndarray, "r c"]:
        """Cells whose middle is at most so many metres from one of the points, seen from above."""
        rim = int(np.ceil(within / CELL)) + 1
        clear = np.ones([side + 2 * rim for side in self.seen.shape], np.uint8)
        rows, columns, inside = cells_of(points, self.origin - CELL * rim, clear.shape)
        clear[rows[inside], columns[inside]] = 0
        if clear.all():
            return np.zeros(self.seen.shape, bool)
        away = cv2.distanceTransform(clear, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        return away[rim:-rim, rim:-rim] * CELL <= within

    def at(self, cells: np.ndarray) -> Float64[np.ndarray, "n 2"]:
        """World (x, y) of (row, column) cells."""
        return self.origin + CELL * cells[:, ::-1]

    def draw(
        self,
        outline: Float[np.ndarray, "k 2"],
        height: float,
        rng: np.random.Generator,
        near: tuple[Float[np.ndarray, "2"] | Float[np.ndarray, "c 2"], float] | None = None,
    ) -> Float64[np.ndarray, "2"] | None:
        """A place for the thing's middle, any free one as likely; if given, within a distance of a point or of an
        outline's edge."""
        cells = np.argwhere(self.spots(outline, height))
        if near is not None:
            cells = cells[_distances(self.at(cells), np.atleast_2d(near[0])) <= near[1]]
        if not len(cells):
            return None
        return self.at(cells[rng.integers(len(cells)), None])[0]

    def covered(self, outline: Float[np.ndarray, "k 2"]) -> Bool[np.ndarray, "r c"]:
        """The cells that a thing with a convex outline, in world metres, stands on."""
        corners = np.rint((outline - self.origin) / CELL).astype(np.int32)
        mask = np.zeros(self.seen.shape, np.uint8)
        cv2.fillConvexPoly(mask, corners, 1)
        return mask > 0

    def with_thing(self, outline: Float[np.ndarray, "k 2"]) -> "FreeSpace":
        """The room once something stands there; `outline` is convex, in world metres."""
        return replace(self, still=np.where(self.covered(outline), np.float32(0), self.still))


def cells_of(
    points: Float[np.ndarray, "n k"], origin: Float[np.ndarray, "2"], shape: tuple[int, ...]
) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
    """Rows and columns of the points' cells, and which of them lie in the room."""
    columns, rows = np.rint((points[:, :2] - origin) / CELL).astype(int).T
    return rows, columns, (rows >= 0) & (columns >= 0) & (rows < shape[0]) & (columns < shape[1])


def _distances(
    points: Float[np.ndarray, "n 2"], corners: Float[np.ndarray, "c 2"]
) -> Float64[np.ndarray, "n"]:
    """Metres from each point to the nearest edge of a closed outline, or to its one corner."""
    out = np.full(len(points), np.inf)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = end - start
        share = np.clip((points - start) @ along / max(float(along @ along), 1e-12), 0, 1)
        out = np.minimum(out, np.linalg.norm(points - start - share[:, None] * along, axis=1))
    return out


def disc(radius: float) -> np.ndarray:
    """The cells within a radius in metres, as a structuring element."""
    size = 2 * int(np.ceil(radius / CELL)) + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))


def _stamp(outline: Float[np.ndarray, "k 2"]) -> np.ndarray:
    """The cells that a thing covers around its middle, a little too many."""
    reach = int(np.ceil(np.abs(outline).max() / CELL)) + 1
    mask = np.zeros((2 * reach + 1, 2 * reach + 1), np.uint8)
    cv2.fillConvexPoly(mask, np.rint(outline / CELL).astype(np.int32) + reach, 1)
    return cv2.dilate(mask, np.ones((3, 3), np.uint8))
