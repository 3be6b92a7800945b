"""Pixels nobody ever saw, filled by continuing the background that lies behind what hid them.

A hole opens where something near moved aside in the image, so what belongs there continues the farther of its two
sides. From a hole pixel we walk in eight directions to the first drawn pixel and continue its plane (1/z is affine
on a plane); of two opposite walks the farther surface counts. This invents smooth surfaces, not texture: the hole
mask stays with the picture so that nobody takes it for a recording.
"""

from dataclasses import replace

import numpy as np
from numba import njit

from rpaug.render.zbuffer import Rendered

FARNESS = 4  # a surface half as far must be 2**4 times closer in the image to be preferred
SAME_LAYER = 0.03  # of 1/z: walks that end on planes this close blend their colours


def fill(view: Rendered) -> Rendered:
    """The view with its holes filled in colour, depth and ids; `hole` and `source` stay as they were.

    A view in which nothing was drawn stays black with depth 0.
    """
    if not view.hole.any() or view.hole.all():
        return view
    depth = view.depth.astype(np.float64)
    near = np.divide(1.0, depth, out=np.zeros_like(depth), where=depth > 0)
    rgb, ids, open_still = view.rgb.copy(), view.ids.copy(), view.hole
    while open_still.any():  # twice where no walk from a pixel reaches a drawn one
        hole, open_still = open_still, open_still.copy()
        _fill(rgb.copy(), near.copy(), ids.copy(), hole, rgb, near, ids, open_still)
    filled = np.divide(1.0, near, out=np.zeros_like(near), where=near > 0)
    return replace(
        view, rgb=rgb, ids=ids, depth=np.where(view.hole, filled, view.depth).astype(np.float32)
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _walk(near, ids, hole, row, column, down, right):
    """First drawn pixel that way: row, column, steps, and its plane continued back to the start; -1 steps if none."""
    height, width = hole.shape
    i, j, steps = row, column, 0
    while hole[i, j]:
        i, j, steps = i + down, j + right, steps + 1
        if not (0 <= i < height and 0 <= j < width):
            return i, j, -1, 0.0
    edge = near[i, j]
    a, b = i + down, j + right
    if not (0 <= a < height and 0 <= b < width) or hole[a, b] or ids[a, b] != ids[i, j]:
        return i, j, steps, edge
    onward = edge + (edge - near[a, b]) * steps
    believable = 0.5 * edge < onward < 2.0 * edge
    return i, j, steps, onward if believable else edge


@njit(cache=True, nogil=True, error_model="numpy")
def _fill(rgb, near, ids, hole, out_rgb, out_near, out_ids, open_still):
    downs = (0, 1, 1, 1)
    rights = (1, 0, 1, -1)
    at = np.zeros((4, 2), np.int64)
    away = np.zeros(4)
    plane = np.zeros(4)
    for row in range(hole.shape[0]):
        for column in range(hole.shape[1]):
            if not hole[row, column]:
                continue
            for pair in range(4):
                away[pair] = np.inf
                plane[pair] = np.inf
                for side in (-1, 1):
                    down, right = side * downs[pair], side * rights[pair]
                    i, j, steps, onward = _walk(near, ids, hole, row, column, down, right)
                    if steps > 0 and onward < plane[pair]:
                        plane[pair] = onward
                        away[pair] = steps * np.sqrt(1.0 * down * down + right * right)
                        at[pair, 0], at[pair, 1] = i, j
            chosen = _choose(away, plane)
            if chosen < 0:
                continue
            open_still[row, column] = False
            i, j = at[chosen]
            out_near[row, column] = plane[chosen]
            out_ids[row, column] = ids[i, j]
            total = 0.0
            red = green = blue = 0.0
            for pair in range(4):
                if not away[pair] < np.inf:
                    continue
                i, j = at[pair]
                if abs(plane[pair] - plane[chosen]) > SAME_LAYER * plane[chosen]:
                    continue
                weight = 1.0 / away[pair] ** 2
                total += weight
                red += weight * rgb[i, j, 0]
                green += weight * rgb[i, j, 1]
                blue += weight * rgb[i, j, 2]
            out_rgb[row, column, 0] = red / total
            out_rgb[row, column, 1] = green / total
            out_rgb[row, column, 2] = blue / total


@njit(cache=True, nogil=True, error_model="numpy")
def _choose(away, plane):
    """The walk that is both short and far: the least of steps * (1/z) ** FARNESS; -1 if there is none."""
    best, chosen = np.inf, -1
    farthest = plane.min()
    for pair in range(4):
        if not away[pair] < np.inf:
            continue
        nearness = (
            plane[pair] / farthest if farthest > 0.0 else (1.0 if plane[pair] == 0.0 else 1e3)
        )
        cost = away[pair] * nearness**FARNESS
        if cost < best:
            best, chosen = cost, pair
    return chosen
