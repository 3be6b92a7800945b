"""Plates: what a fixed camera saw of static things over a whole episode, whatever hid them at times."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int, Int32, Shaped, UInt8

from rpaug.core.jit import kernel
from rpaug.core.types import CameraView
from rpaug.render.denoise import smooth
from rpaug.render.unmix import plain
from rpaug.render.zbuffer import Source, lift

PLATE_SAMPLES = (
    9  # recordings of a static pixel, spread over the episode, whose median is its plate
)
FEW = 16  # instance ids: comparing with each is faster than looking all up
SAME_DEPTH = 0.01  # of depth: a plate's samples agree this well or are another surface


@dataclass(frozen=True)
class Plate:
    """What one fixed camera saw of static bodies over the whole episode; `known` where it ever saw any."""

    rgb: UInt8[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]
    ids: Int32[np.ndarray, "h w"]
    known: Bool[np.ndarray, "h w"]
    source: Source  # the same, ready to be drawn


def source_at(
    view: CameraView,
    t: int,
    noise: float = 0.0,
    distant: bool = False,
    carved: bool = False,
    mixed: bool = False,
) -> Source:
    """One recorded image as surfels, its depth smoothed if noisy; a source without masks has instance id 0 everywhere.

    Colors that are `mixed` at outlines are cleaned, for other places than the camera's own.
    """
    assert view.depth is not None  # build() refuses sources without depth
    depth = view.depth(t)
    ids = view.ids(t) if view.ids is not None else np.zeros(depth.shape, np.int32)
    source = Source(
        K=view.camera.K,
        cam_to_world=view.camera.cam_to_world[t],
        rgb=view.rgb(t),
        depth=smooth(depth, ids, noise),
        ids=ids,
        distant=distant,
        carved=carved,
    )
    return plain(source) if mixed else source


def among(ids: Int32[np.ndarray, "h w"], instance_ids: frozenset[int]) -> Bool[np.ndarray, "h w"]:
    """Which pixels show one of the instance ids."""
    if len(instance_ids) > FEW:
        return np.isin(ids, np.fromiter(instance_ids, np.int32, len(instance_ids)))
    shown = np.zeros(ids.shape, bool)
    for instance_id in instance_ids:
        shown |= ids == instance_id
    return shown


def spread(length: int) -> list[int]:
    """All frames, ordered so that any first few of them are spread over the episode (van der Corput)."""
    bits = max(1, (length - 1).bit_length())
    turned = (int(f"{i:0{bits}b}"[::-1], 2) for i in range(1 << bits))
    return [t for t in turned if t < length]


def plate(
    view: CameraView,
    length: int,
    static: frozenset[int],
    noise: float,
    tolerance: float,
    mixed: bool = False,
) -> Plate:
    """Per pixel, the median of its first few static recordings in spread order; stops when all have enough."""
    size = (view.camera.height, view.camera.width)
    count = np.zeros(size, np.int64)
    ids = np.zeros(size, np.int32)
    depths = np.zeros((PLATE_SAMPLES, *size), np.float32)
    colors = np.zeros((PLATE_SAMPLES, *size, 3), np.uint8)
    for t in spread(length):
        wanted = count < PLATE_SAMPLES
        if view.ids is not None:  # told by the mask alone, most frames need not be looked at
            now_ids = view.ids(t)
            wanted &= among(now_ids, static) & ((count == 0) | (now_ids == ids))
        if not wanted.any():
            continue
        now = source_at(view, t, mixed=mixed)
        good = wanted & among(now.ids, static) & np.isfinite(now.depth) & (now.depth > 0)
        good &= True if now.use is None else now.use
        near = np.float32(max(SAME_DEPTH, 5 * noise))
        _collect(good, now.depth, now.rgb, now.ids, near, count, ids, depths, colors)
        if (count == PLATE_SAMPLES).all():
            break
    depth, rgb = _middle(depths[..., None], count)[..., 0], _middle(colors, count)
    depth = smooth(depth, ids, noise)
    known = count > 0
    source = Source(
        K=view.camera.K, cam_to_world=view.camera.cam_to_world[0], rgb=rgb,
        depth=depth, ids=ids, use=known, carved=True,
    )  # fmt: skip
    return Plate(rgb, depth, ids, known, lift(source, tolerance))


@kernel
def _collect(
    good: Bool[np.ndarray, "h w"],
    depth: Float32[np.ndarray, "h w"],
    rgb: UInt8[np.ndarray, "h w 3"],
    seen: Int32[np.ndarray, "h w"],
    near: float,
    count: Int[np.ndarray, "h w"],
    ids: Int32[np.ndarray, "h w"],
    depths: Float32[np.ndarray, "s h w"],
    colors: UInt8[np.ndarray, "s h w 3"],
) -> None:
    """Add an image's good pixels to the samples, but what is of another thing or `near`, a share of depth, off the
    first."""
    for y in range(good.shape[0]):
        for x in range(good.shape[1]):
            n = count[y, x]
            if not good[y, x] or n == len(depths):
                continue
            first = depths[0, y, x]
            if n > 0 and (ids[y, x] != seen[y, x] or not abs(depth[y, x] - first) < near * first):
                continue
            depths[n, y, x], ids[y, x], count[y, x] = depth[y, x], seen[y, x], n + 1
            for channel in range(3):
                colors[n, y, x, channel] = rgb[y, x, channel]


@kernel
def _middle(
    samples: Shaped[np.ndarray, "s h w c"], count: Int[np.ndarray, "h w"]
) -> Shaped[np.ndarray, "h w c"]:
    """Per pixel, the lower median of its first `count` samples, each channel by itself; 0 of none."""
    out = np.zeros(samples.shape[1:], samples.dtype)
    some = np.empty(len(samples), samples.dtype)
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            if count[y, x] == 0:
                continue
            for channel in range(out.shape[2]):
                for n in range(count[y, x]):
                    value, place = samples[n, y, x, channel], n
                    while place > 0 and some[place - 1] > value:
                        some[place] = some[place - 1]
                        place -= 1
                    some[place] = value
                out[y, x, channel] = some[(count[y, x] - 1) // 2]
    return out
