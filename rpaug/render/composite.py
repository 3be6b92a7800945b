"""Appearance edits in a fixed camera: only the pixels an edit covers change, the rest keep their bytes.

Where the source is anti-aliased, a pixel on an object's outline is a mixture a F + (1 - a) B of the object's colour
F and what lies behind, B. There the share a is found from the nearest pixels that are wholly inside and wholly
outside, and the edit adds a (F' - F), so that no rim of the old colour is left and B stays what it was.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8
from numba import njit

from rpaug.types import Appearance

REACH = 2  # pixels: how far to look for an unmixed colour
LEAST_CONTRAST = 0.02  # squared colour distance below which a mixture cannot be told


def composite(
    rgb: UInt8[np.ndarray, "h w 3"],
    ids: Int32[np.ndarray, "h w"] | None,
    appearance: Sequence[Appearance],
    antialiased: bool,
) -> UInt8[np.ndarray, "h w 3"]:
    """The recorded image with appearance edits applied in order. Pixels no edit covers come back bit for bit."""
    colour = rgb.astype(np.float32) / np.float32(255)
    touched = np.zeros(rgb.shape[:2], bool)
    for edit in appearance:
        if edit.handles is None:
            colour = edit(colour.reshape(-1, 3)).reshape(colour.shape)
            touched[:] = True
        elif ids is not None:
            inside = np.isin(ids, list(edit.handles))
            if inside.any():
                touched |= _apply(edit, colour, inside, antialiased)
    quantised = np.rint(np.clip(colour[touched], 0, 1) * 255).astype(np.uint8)
    out = rgb.copy()
    out[touched] = quantised
    return out


def _apply(
    edit: Appearance,
    colour: Float32[np.ndarray, "h w 3"],
    inside: Bool[np.ndarray, "h w"],
    antialiased: bool,
) -> Bool[np.ndarray, "h w"]:
    """Edit `colour` in place where `inside`, and on the outline by its mixture; the pixels touched."""
    if not antialiased:
        colour[inside] = edit(colour[inside])
        return inside
    share, foreground = matte(colour, inside)
    whole, mixed = share == 1, (share > 0) & (share < 1)
    front = foreground[mixed]
    change = edit(front) - front
    colour[whole] = edit(colour[whole])
    colour[mixed] += share[mixed, None] * change
    return whole | mixed


@njit(cache=True, nogil=True)
def matte(
    colour: Float32[np.ndarray, "h w 3"], inside: Bool[np.ndarray, "h w"]
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w 3"]]:
    """The object's share of each pixel, 0..1, and its own colour there.

    Only pixels with a 4-neighbour across the outline can be mixed. Where no unmixed pixel is near, or both sides
    look alike, the mask itself is the share.
    """
    height, width = inside.shape
    share = np.zeros((height, width), np.float32)
    foreground = colour.copy()
    rim = np.zeros((height, width), np.bool_)
    for y in range(height):
        for x in range(width):
            here = inside[y, x]
            rim[y, x] = (
                (y > 0 and inside[y - 1, x] != here)
                or (y + 1 < height and inside[y + 1, x] != here)
                or (x > 0 and inside[y, x - 1] != here)
                or (x + 1 < width and inside[y, x + 1] != here)
            )
    for y in range(height):
        for x in range(width):
            share[y, x] = 1.0 if inside[y, x] else 0.0
            if not rim[y, x]:
                continue
            near = np.full(2, 1 << 20)
            at = np.zeros((2, 2), np.int64)
            for j in range(max(0, y - REACH), min(height, y + REACH + 1)):
                for i in range(max(0, x - REACH), min(width, x + REACH + 1)):
                    if rim[j, i]:
                        continue
                    side = 1 if inside[j, i] else 0
                    distance = (j - y) ** 2 + (i - x) ** 2
                    if distance < near[side]:
                        near[side], at[side, 0], at[side, 1] = distance, j, i
            if near[0] == 1 << 20 or near[1] == 1 << 20:
                continue
            along = contrast = 0.0
            for c in range(3):
                back = colour[at[0, 0], at[0, 1], c]
                step = colour[at[1, 0], at[1, 1], c] - back
                along += (colour[y, x, c] - back) * step
                contrast += step * step
            if contrast < LEAST_CONTRAST:
                continue
            share[y, x] = min(1.0, max(0.0, along / contrast))
            foreground[y, x] = colour[at[1, 0], at[1, 1]]
    return share, foreground
