"""A piece of a camera's image, and of each recording the part that can show it: the rest need not be drawn."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64

from rpaug.core.jit import kernel
from rpaug.core.pixels import bounds
from rpaug.render.outlines import RADIUS, Footprints
from rpaug.render.pinhole import NEAR, intrinsics, map_pixel, relative
from rpaug.render.zbuffer import Source, nearness

RIM = RADIUS + 1  # pixels more on each side: outlines and colors are told by neighbours
AROUND = 16  # pixels around what is drawn anew, by which recordings are matched in color


@dataclass(frozen=True)
class Window:
    """The pixels `rows`, `columns` of the image of a camera `K` at `cam_to_world`."""

    rows: slice
    columns: slice
    K: Float64[np.ndarray, "3 3"]
    cam_to_world: Float64[np.ndarray, "4 4"]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.columns.stop - self.columns.start, self.rows.stop - self.rows.start

    @property
    def own(self) -> Float64[np.ndarray, "3 3"]:
        """The intrinsics of the piece as an image of its own."""
        return _moved(self.K, self.rows, self.columns)

    def of(self, source: Source) -> Source:
        """The piece of a recording that this very camera made."""
        return _cut(source, self.rows, self.columns)

    def part(self, source: Source) -> Source | None:
        """The piece of a recording whose used pixels can be seen through the window, None if none can."""
        near = nearness(source) if source.lifted is None else source.lifted.near
        use = np.ones(near.shape, bool) if source.use is None else source.use
        top, bottom, left, right = _bounds(
            near, use, intrinsics(source.K), relative(source.cam_to_world, self.cam_to_world),
            intrinsics(self.own), *self.size,
        )  # fmt: skip
        if bottom < top:
            return None
        height, width = near.shape
        rows = slice(max(0, top - RIM), min(height, bottom + RIM + 1))
        return _cut(source, rows, slice(max(0, left - RIM), min(width, right + RIM + 1)))


def around(
    mask: Bool[np.ndarray, "h w"],
    K: Float64[np.ndarray, "3 3"],
    cam_to_world: Float64[np.ndarray, "4 4"],
) -> Window | None:
    """The window on all marked pixels of a camera's image and some around them, None if there are none."""
    return Window(*bounds(mask, AROUND), K, cam_to_world) if mask.any() else None


def trimmed(source: Source, rim: int = RIM) -> Source:
    """The piece of a recording that holds its used pixels, and at least `rim` more on each side.

    It begins at an even row and column, so that who looks at every other pixel sees the same ones. A recording of which
    nothing is used stays whole.
    """
    if source.use is None or not source.use.any():
        return source
    rows, columns = (
        slice(max(0, int(used[0]) - rim) // 2 * 2, int(used[-1]) + rim + 1)
        for used in (np.flatnonzero(source.use.any(axis)) for axis in (1, 0))
    )
    return _cut(source, rows, columns)


def _cut(source: Source, rows: slice, columns: slice) -> Source:
    prints = source.lifted
    if prints is not None:
        parts = (prints.near, prints.slope, prints.edge, prints.line)
        prints = Footprints(*(np.ascontiguousarray(part[rows, columns]) for part in parts))
    return replace(
        source,
        K=_moved(source.K, rows, columns),
        rgb=np.ascontiguousarray(source.rgb[rows, columns]),
        depth=np.ascontiguousarray(source.depth[rows, columns]),
        ids=np.ascontiguousarray(source.ids[rows, columns]),
        use=None if source.use is None else np.ascontiguousarray(source.use[rows, columns]),
        lifted=prints,
    )


def _moved(
    K: Float64[np.ndarray, "3 3"], rows: slice, columns: slice
) -> Float64[np.ndarray, "3 3"]:
    """Intrinsics of a piece of an image, its first pixel (0, 0)."""
    moved = K.copy()
    moved[:2, 2] -= columns.start, rows.start
    return moved


@kernel
def _bounds(near, use, lens, pose, target, width, height):
    """First and last row and column of used pixels whose surfels may reach into the target; last < first if none do."""
    top, bottom, left, right = near.shape[0], -1, near.shape[1], -1
    grown = max(target[0] / lens[0], target[1] / lens[1])
    for row in range(near.shape[0]):
        for column in range(near.shape[1]):
            if near[row, column] < 0.0 or not use[row, column]:
                continue
            x, y, ahead = map_pixel(column, row, near[row, column], lens, pose, target)
            if not ahead > NEAR:  # what reaches behind the camera is not drawn
                continue
            # A pixel's own size on the target, turned however it may be.
            reach = 1.0 + 2.0 * grown / ahead
            if not (-reach <= x < width + reach and -reach <= y < height + reach):
                continue
            top, bottom = min(top, row), max(bottom, row)
            left, right = min(left, column), max(right, column)
    return top, bottom, left, right
