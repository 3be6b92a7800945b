"""Appearance edits in a fixed camera: only the pixels an edit covers change, the rest keep their bytes.

Where the source is anti-aliased, a pixel on an object's outline is a mixture a F + (1 - a) B of the object's color
F and what lies behind, B. There the share a is found from the nearest pixels that are wholly inside and wholly
outside, and the edit adds a (F' - F), so that no rim of the old color is left and B stays what it was. Such a pixel
lies where its nearest pixel inside lies: what is recorded at the pixel itself may be the depth of B.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float32, Int, Int32, UInt8

from rpaug.core.jit import kernel
from rpaug.core.types import Appearance, Surface
from rpaug.render.headroom import Headroom
from rpaug.render.matting import matte

Surfaces = Callable[[Int[np.ndarray, "n"]], Surface]
"""What pixels of the image show, by their flat index."""


def composite(
    rgb: UInt8[np.ndarray, "h w 3"],
    ids: Int32[np.ndarray, "h w"] | None,
    appearance: Sequence[Appearance],
    antialiased: bool,
    surfaces: Surfaces,
    radiance: Float32[np.ndarray, "h w 3"] | None = None,
) -> UInt8[np.ndarray, "h w 3"]:
    """The recorded image with appearance edits applied in order. Pixels no edit covers come back bit for bit.

    `radiance` is what the light came to before white cut it off, where that is known.
    """
    color = rgb.astype(np.float32) / np.float32(255)
    touched = np.zeros(rgb.shape[:2], bool)
    headroom = None if radiance is None else Headroom(color, radiance)
    for edit in appearance:
        unlit = getattr(edit, "unlit", ()) if ids is not None else ()
        if edit.instance_ids is None and not unlit:
            everywhere = np.arange(touched.size)
            shown = surfaces(everywhere)
            edited = _edited(edit, color.reshape(-1, 3), shown, everywhere, headroom)
            color = edited.reshape(color.shape)
            touched[:] = True
        elif ids is not None:
            inside = _among(ids, np.array(sorted(edit.instance_ids or unlit), ids.dtype))
            inside = ~inside if edit.instance_ids is None else inside
            if inside.any():
                touched |= _apply(edit, color, inside, antialiased, surfaces, headroom)
    return _quantised(rgb, color, touched)


def _apply(
    edit: Appearance,
    color: Float32[np.ndarray, "h w 3"],
    inside: Bool[np.ndarray, "h w"],
    antialiased: bool,
    surfaces: Surfaces,
    headroom: Headroom | None,
) -> Bool[np.ndarray, "h w"]:
    """Edit `color` in place where `inside`, and on the outline by its mixture; the pixels touched."""
    if not antialiased:
        at, flat = np.flatnonzero(inside), color.reshape(-1, 3)
        _put(flat, at, _edited(edit, flat.take(at, 0), surfaces(at), at, headroom))
        return inside
    share, foreground = matte(color, inside)
    some = np.flatnonzero(share > 0)
    parts, flat = share.take(some), color.reshape(-1, 3)
    mixed, at = some[parts < 1], some[parts == 1]
    front = foreground.reshape(-1, 3).take(mixed, 0)
    beside = _nearest(inside, mixed)
    change = _edited(edit, front, surfaces(beside), beside, headroom, keep=False) - front
    changed = flat.take(mixed, 0) + parts[parts < 1, None] * change
    _put(flat, at, _edited(edit, flat.take(at, 0), surfaces(_nearest(inside, at)), at, headroom))
    _put(flat, mixed, changed)
    return share > 0


def _edited(
    edit: Appearance,
    color: Float32[np.ndarray, "n 3"],
    surface: Surface,
    at: Int[np.ndarray, "n"],
    headroom: Headroom | None,
    keep: bool = True,
) -> Float32[np.ndarray, "n 3"]:
    """Edited colors of surfaces that have the headroom of the pixels `at`; a thin line is all outline, with none."""
    if not len(color):
        return color
    return headroom.edited(edit, color, surface, at, keep) if headroom else edit(color, surface)


@kernel
def _put(
    color: Float32[np.ndarray, "p 3"], at: Int[np.ndarray, "n"], edited: Float32[np.ndarray, "n 3"]
) -> None:
    for n in range(len(at)):
        for k in range(3):
            color[at[n], k] = edited[n, k]


@kernel
def _quantised(
    rgb: UInt8[np.ndarray, "h w 3"],
    color: Float32[np.ndarray, "h w 3"],
    touched: Bool[np.ndarray, "h w"],
) -> UInt8[np.ndarray, "h w 3"]:
    """The image with the colors of touched pixels rounded to its levels."""
    out = rgb.copy()
    for y in range(rgb.shape[0]):
        for x in range(rgb.shape[1]):
            if touched[y, x]:
                for k in range(3):
                    value = min(max(color[y, x, k], np.float32(0)), np.float32(1))
                    out[y, x, k] = np.uint8(np.rint(value * np.float32(255)))
    return out


@kernel
def _among(
    ids: Int32[np.ndarray, "h w"], instance_ids: Int32[np.ndarray, "k"]
) -> Bool[np.ndarray, "h w"]:
    """Which pixels show one of the instance ids, which ascend."""
    out = np.zeros(ids.shape, np.bool_)
    if len(instance_ids) == 0 or ids.size == 0:
        return out
    last, found = ids[0, 0], False
    for y in range(ids.shape[0]):
        for x in range(ids.shape[1]):
            here = ids[y, x]
            if here != last or (y == 0 and x == 0):  # a row has few runs of one id
                place = min(np.searchsorted(instance_ids, here), len(instance_ids) - 1)
                last, found = here, instance_ids[place] == here
            out[y, x] = found
    return out


@kernel
def _nearest(inside: Bool[np.ndarray, "h w"], rows: Int[np.ndarray, "n"]) -> Int[np.ndarray, "n"]:
    """The pixel itself if it is inside, else the neighbour that is, straight ones first: flat indices."""
    height, width = inside.shape
    out = rows.copy()
    for n in range(len(rows)):
        y, x = rows[n] // width, rows[n] % width
        least = 0 if inside[y, x] else 3
        for j in range(max(0, y - 1), min(height, y + 2)):
            for i in range(max(0, x - 1), min(width, x + 2)):
                away = abs(j - y) + abs(i - x)
                if inside[j, i] and away < least:
                    least = away
                    out[n] = j * width + i
    return out
