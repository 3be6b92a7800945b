"""Colors at outlines, which an anti-aliased recording mixed from the two things that meet there.

From another place one of the two is not there any more, and the mixture is neither's color: a rim of the arm's red
would lie on the floor behind it. Such pixels get the mean of those around them that show the same thing unmixed.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float32, Int32

from rpaug.core.jit import inlined, kernel
from rpaug.render.holes import SAME_LAYER, Witness
from rpaug.render.pinhole import NEAR, intrinsics, map_pixel, relative
from rpaug.render.zbuffer import Rendered, Source, nearness


def plain(source: Source) -> Source:
    """A recording for other places than its own: no color of it is mixed with that of what lies before it.

    What peeks out from behind something and is nowhere wider than its outline is not used.
    """
    mixed = np.zeros(source.ids.shape, np.bool_)
    _outlines(np.maximum(nearness(source), 0.0), source.ids, mixed)
    rgb, left = _spread(source.rgb.astype(np.float32), source.ids, mixed, mixed)
    use = ~left if source.use is None else source.use & ~left
    return replace(source, rgb=np.rint(rgb).astype(np.uint8), use=use)


def slits(
    depth: Float32[np.ndarray, "h w"], ids: Int32[np.ndarray, "h w"]
) -> Bool[np.ndarray, "h w"]:
    """Pixels that show what peeks out from behind something and is nowhere wider than its outline: most of their color
    is that of what lies before it."""
    mixed = np.zeros(ids.shape, np.bool_)
    near = np.divide(1.0, depth, out=np.zeros(depth.shape), where=depth > 0)
    _outlines(near, ids, mixed)
    nothing = np.zeros((*ids.shape, 3), np.float32)
    return _spread(nothing, ids, mixed, mixed)[1]


def unmixed(view: Rendered, witness: Witness) -> Rendered:
    """The view without outlines of what moved aside: colors that the witness, source 0, recorded mixed with a nearer
    thing's beside them, and that no nearer thing is beside any more, are those of their neighbours, or for want of one
    of what is nearest of the same thing."""
    depth = view.depth.astype(np.float64)
    near = np.divide(1.0, depth, out=np.zeros_like(depth), where=depth > 0)
    near[view.hole] = -1.0
    mixed = np.zeros(near.shape, np.bool_)
    seen, source = np.maximum(nearness(witness.source), 0.0), witness.source
    back = relative(witness.cam_to_world, source.cam_to_world)
    _beside(near, view.source, intrinsics(witness.K), back, intrinsics(source.K), seen, mixed)
    rgb, left = _spread(view.rgb, view.ids, mixed, mixed | view.hole)
    for instance_id in np.unique(view.ids[left]):
        here = view.ids == instance_id
        good = np.argwhere(here & ~left & ~view.hole)
        for row, column in np.argwhere(here & left) if len(good) else ():
            rgb[row, column] = rgb[tuple(good[((good - (row, column)) ** 2).sum(1).argmin()])]
    return replace(view, rgb=rgb)


def _spread(
    rgb: Float32[np.ndarray, "h w 3"],
    ids: Int32[np.ndarray, "h w"],
    mixed: Bool[np.ndarray, "h w"],
    bad: Bool[np.ndarray, "h w"],
) -> tuple[Float32[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"]]:
    """Colors with the mixed ones replaced from their neighbours, from where these are good on, and those left over."""
    rgb, bad, left = rgb.copy(), bad.copy(), mixed.copy()
    while left.any():
        rows, columns = np.nonzero(left)
        done = _cleaned(rgb.copy(), ids, bad, rows, columns, rgb)
        if not done.any():
            break
        for image in (bad, left):
            image[rows[done], columns[done]] = False
    return rgb, left


@kernel
def _outlines(near, ids, out):
    """Pixels beside one of another thing that lies before them."""
    height, width = ids.shape
    for v in range(height):
        for u in range(width):
            for i in range(max(0, v - 1), min(height, v + 2)):
                for j in range(max(0, u - 1), min(width, u + 2)):
                    before = near[v, u] < near[i, j] * (1.0 - SAME_LAYER)
                    if before and ids[i, j] != ids[v, u]:
                        out[v, u] = True


@kernel
def _beside(near, source, target, back, lens, seen, out):
    """Pixels of source 0 that were recorded beside something nearer, and are not beside it now."""
    height, width = seen.shape
    for v in range(near.shape[0]):
        for u in range(near.shape[1]):
            if source[v, u] != 0:
                continue
            here = near[v, u] * (1.0 + SAME_LAYER)
            x, y, ahead = map_pixel(u, v, near[v, u], target, back, lens)
            if not (ahead > NEAR and -0.5 <= x < width - 0.5 and -0.5 <= y < height - 0.5):
                continue
            if _largest(seen, int(y + 0.5), int(x + 0.5)) * ahead > here:
                out[v, u] = _largest(near, v, u) <= here


@inlined
def _largest(image, row, column):
    """The largest value of a pixel and those around it."""
    largest = image[row, column]
    for i in range(max(0, row - 1), min(image.shape[0], row + 2)):
        for j in range(max(0, column - 1), min(image.shape[1], column + 2)):
            largest = max(largest, image[i, j])
    return largest


@kernel
def _cleaned(rgb, ids, bad, rows, columns, out):
    """Means of the colors around these pixels that show the same thing and are not bad; whether there are any."""
    done = np.zeros(len(rows), np.bool_)
    for n in range(len(rows)):
        row, column, count, total = rows[n], columns[n], 0, np.zeros(3)
        for i in range(max(0, row - 1), min(bad.shape[0], row + 2)):
            for j in range(max(0, column - 1), min(bad.shape[1], column + 2)):
                if not bad[i, j] and ids[i, j] == ids[row, column]:
                    count += 1
                    for channel in range(3):
                        total[channel] += rgb[i, j, channel]
        done[n] = count > 0
        if count:
            for channel in range(3):
                out[row, column, channel] = total[channel] / count
    return done
