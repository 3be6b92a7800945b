"""Point clouds as an image from straight above: colors under the arm, heights under it and of all."""

from collections.abc import Iterable

import numba
import numpy as np
from jaxtyping import Float, Float32, UInt8

from rpaug.twin.tabletop import TABLE
from tools.bench.closed_loop.bench import View

GRID = 64  # pixels a side
SIDE = 0.68  # metres: of the cube that is looked at
# Its corner. The table's top is in the middle of a row of cells: on the edge of two the row would say least about it.
LOW = np.array([-0.12, -0.34, TABLE - 3.5 * SIDE / GRID])
UNDER = 0.28  # metres above that corner: things are lower, most of a raised arm is higher
CHANNELS = 6  # color, height and presence of the highest point that is lower than that; height of the highest of all


def cloud(views: Iterable[View]) -> tuple[Float32[np.ndarray, "n 3"], UInt8[np.ndarray, "n 3"]]:
    """Points of all cameras in the world, metres, with their colors; those that can enter the cube after a shift."""
    points, colors = [], []
    for view in views:
        h, w = view.depth.shape
        v, u = np.mgrid[:h, :w]
        rays = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(view.K).T
        world = (rays * view.depth[..., None]) @ view.cam_to_world[:3, :3].T
        world += view.cam_to_world[:3, 3]
        near = np.all((world > LOW - 0.1) & (world < LOW + SIDE + 0.1), -1) & (view.depth > 0)
        points.append(world[near].astype(np.float32))
        colors.append(view.rgb[near])
    return np.concatenate(points), np.concatenate(colors)


def project(
    points: Float32[np.ndarray, "n 3"], colors: UInt8[np.ndarray, "n 3"]
) -> Float32[np.ndarray, "c h w"]:
    """The image, rows along y and columns along x: color 0..1, height 0..1 of `UNDER`, presence, height 0..1."""
    out = np.zeros((CHANNELS, GRID, GRID), np.float32)
    _draw(cells(points).astype(np.float32), colors, UNDER * GRID / SIDE, out)
    return out


def cells(points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Metres in the world to cells of the cube: 0 to `GRID` inside, pixel centres at one half."""
    return (np.asarray(points, float) - LOW) * (GRID / SIDE)


def metres(inside: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Cells of the cube to metres in the world."""
    return np.asarray(inside, float) * (SIDE / GRID) + LOW


@numba.njit(cache=True)
def _draw(cell, colors, under, out):
    size = out.shape[1]
    for n in range(len(cell)):
        x, y = int(np.floor(cell[n, 0])), int(np.floor(cell[n, 1]))
        z = cell[n, 2]
        if not (0 <= x < size and 0 <= y < size and 0 <= z < size):
            continue
        out[5, y, x] = max(out[5, y, x], z / size)
        if z >= under or (out[4, y, x] > 0 and out[3, y, x] >= z / under):
            continue
        for c in range(3):
            out[c, y, x] = colors[n, c] / 255
        out[3, y, x] = z / under
        out[4, y, x] = 1
