"""Depth that a model gives of a still camera: one for all frames, bent onto what is known, and how far it may be off.

A network sees each frame by itself, so that its scale drifts, and the same place comes out nearer or farther now and
then. Here all frames are brought onto the resting scene's depth, which is their median. Things rest on a plane: where
the support is seen its depth is known, or that of the plane which explains it best, and the error that the network
makes there is taken to go on, smoothly, across what stands on it. How well that holds is measured: parts of the support
are left out and told by the rest. Outlines, which networks blur, are those of the instances.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, UInt8

from rpaug.core import sampling
from rpaug.core.types import Camera, CameraView
from rpaug.scene.instances.backdrop import Backdrop
from rpaug.scene.instances.ground_plane import rays_of

if TYPE_CHECKING:
    from rpaug.providers.depth import DepthModel

SAMPLED = 9  # frames that the resting scene's depth is the median of
KEPT = 64  # frames
FARTHEST = 1e4  # metres
REACHES = 0.03, 0.05, 0.08, 0.12  # of the image's width: so smooth may the error be
FAR_FROM = 0.01  # weight of no error at all, in shares of support all around
BLOCKS = (
    10  # across the image: parts of the support that are left out, about as large as things are
)
FEWEST = 30  # pixels of support that a plane is told by
RIM = 0.016  # of the image's width: so near to an outline a network blurs
ROUNDS = 8  # of a fit that outliers lose their say in
DEVIATION = 1.4826  # of a normal distribution, by its median absolute deviation

Image = UInt8[np.ndarray, "h w 3"]
Map = Float64[np.ndarray, "h w"]
Mask = Bool[np.ndarray, "h w"]
Ids = Int32[np.ndarray, "h w"]


@dataclass(frozen=True)
class ModelledDepth:
    """Depth of one camera: of its resting scene, and of each frame; `spread` is the share that it may be off by.

    `spread` is the deviation of parts of the support from what the rest of it tells, infinite where no support tells
    anything.
    """

    resting: Float32[np.ndarray, "h w"]
    at: Callable[[int], Float32[np.ndarray, "h w"]]
    spread: float


@dataclass(frozen=True)
class StillCamera:
    """A camera that stands still: its images, its backdrop, and the ids of what rests in it; `support` among them."""

    view: CameraView
    length: int
    backdrop: Backdrop
    resting: Ids
    support: Sequence[int]
    ids: Callable[[int], Ids]


def of(still: StillCamera, model: "DepthModel", camera: Camera) -> ModelledDepth:
    """The depth of a still camera; where `camera` is placed its support is the world's plane z = 0."""
    inverse = _over_time(still, model)
    on = np.isin(still.resting, list(still.support))
    flat, inverse = _plane(inverse, on, camera, model.relative)
    bend, spread = _bend(inverse, flat, on)
    resting = _depth(_outlined(inverse * np.exp(bend), still.resting, on, flat))

    @lru_cache(KEPT)
    def at(t: int) -> Float32[np.ndarray, "h w"]:
        image = still.view.rgb(t)
        changed = still.backdrop.changed(image)
        if not changed.any():
            return resting
        now = _onto(1 / np.maximum(model(image), 1e-6), inverse, ~changed, model.relative)
        ids = still.ids(t)
        shown = _outlined(now * np.exp(bend), ids, np.isin(ids, list(still.support)), flat)
        return np.where(changed, _depth(shown), resting).astype(np.float32)

    return ModelledDepth(resting, at, spread)


def _over_time(still: StillCamera, model: "DepthModel") -> Map:
    """1 / depth of the resting scene: the median of the backdrop's and of frames that were brought onto it."""
    first = 1 / np.maximum(model(still.backdrop.image).astype(float), 1e-6)
    seen = [first]
    for t in sampling.frames(still.length, SAMPLED):
        image = still.view.rgb(t)
        same = ~still.backdrop.changed(image)
        now = _onto(1 / np.maximum(model(image).astype(float), 1e-6), first, same, model.relative)
        seen.append(np.where(same, now, np.nan))
    return np.nanmedian(np.stack(seen), 0)


def _onto(now: Map, known: Map, same: Mask, relative: bool) -> Map:
    """1 / depth in the scale, and with a relative model in the shift, that suit what is known best where both are."""
    if same.sum() < FEWEST:
        return now
    if not relative:
        return now * np.median(known[same] / now[same])
    columns = np.column_stack([now[same], np.ones(int(same.sum()))])
    factor, shift = _fitted(columns, known[same])
    return np.maximum(factor * now + shift, 1 / FARTHEST)


def _plane(inverse: Map, on: Mask, camera: Camera, relative: bool) -> tuple[Map | None, Map]:
    """1 / depth of the support's plane over the image, None where nothing tells it; and the scene's, in its scale."""
    if on.sum() < FEWEST:
        return None, inverse
    rays = rays_of(camera)
    if not camera.placed:
        return rays @ _fitted(rays[on], inverse[on]), inverse
    pose = camera.cam_to_world[0]
    flat = (
        -(rays @ pose[2, :3]) / pose[2, 3]
    )  # a ray that falls by so much a metre meets z = 0 there
    below = on & (flat > 1 / FARTHEST)
    if below.sum() < FEWEST:
        return None, inverse
    return flat, _onto(inverse, flat, below, relative)


def _bend(inverse: Map, flat: Map | None, on: Mask) -> tuple[Map, float]:
    """The logarithm of the factor that bends the scene onto the plane of its support, smooth, and going out to none far
    from it; and the deviation of parts that were left out from what the rest tells."""
    if flat is None:
        return np.zeros(inverse.shape), np.inf
    off = np.where(
        on & (flat > 1 / FARTHEST), np.log(np.maximum(flat, 1 / FARTHEST) / inverse), 0.0
    )
    middle = np.median(off[on])
    close = np.abs(off - middle) <= 3 * DEVIATION * np.median(np.abs(off[on] - middle)) + 1e-6
    known = on & close & (flat > 1 / FARTHEST)
    spreads = {reach: _left_out(off, on, known, reach) for reach in REACHES}
    best = min(spreads, key=lambda reach: spreads[reach])
    return _spread_out(off, known, best), spreads[best]


def _left_out(off: Map, on: Mask, known: Mask, reach: float) -> float:
    """The deviation of parts of the support from what the rest of it tells."""
    rows, columns = np.indices(on.shape) * BLOCKS // on.shape[1]
    left = list[np.ndarray]()
    for fold in range(4):
        out = (rows % 2 == fold // 2) & (columns % 2 == fold % 2)
        left.append((off - _spread_out(off, known & ~out, reach))[on & out])
    return DEVIATION * float(np.median(np.abs(np.concatenate(left))))


def _spread_out(off: Map, known: Mask, reach: float) -> Map:
    """What is known of a smooth map, carried on all around; the median of it is what holds far away."""
    middle = float(np.median(off[known])) if known.any() else 0.0
    sigma = reach * off.shape[1]
    weight = cv2.GaussianBlur(known.astype(float), (0, 0), sigma)
    total = cv2.GaussianBlur(np.where(known, off - middle, 0.0), (0, 0), sigma)
    return middle + total / (weight + FAR_FROM)


def _outlined(inverse: Map, ids: Ids, on: Mask, flat: Map | None) -> Map:
    """The map with each instance's rim as its inside is next to it, and the support on its plane."""
    reach = max(1, round(RIM * ids.shape[1]))
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    shown = ids.astype(np.float32)
    inside = (cv2.erode(shown, square) == shown) & (cv2.dilate(shown, square) == shown)
    out = inverse.copy()
    for one in np.unique(ids[~inside]).tolist():
        held = ids == one
        core = held & inside
        if not core.any():
            out[held] = np.median(inverse[held])
            continue
        _, label = cv2.distanceTransformWithLabels(
            (~core).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        values = np.zeros(label.max() + 1)
        values[label[core]] = inverse[core]
        rim = held & ~inside
        out[rim] = values[label[rim]]
    return out if flat is None else np.where(on & (flat > 1 / FARTHEST), flat, out)


def _fitted(columns: Float64[np.ndarray, "n k"], goal: Float64[np.ndarray, "n"]) -> np.ndarray:
    """The least absolute deviation's coefficients, by weights."""
    weight: np.ndarray = np.ones(len(goal))
    found = np.zeros(columns.shape[1])
    for _ in range(ROUNDS):
        found = np.linalg.lstsq(columns * weight[:, None], goal * weight, rcond=None)[0]
        off = np.abs(goal - columns @ found)
        weight = 1 / np.sqrt(np.maximum(off, 1e-3 * np.abs(goal) + 1e-9))
    return found


def _depth(inverse: Map) -> Float32[np.ndarray, "h w"]:
    return (1 / np.maximum(inverse, 1 / FARTHEST)).astype(np.float32)
