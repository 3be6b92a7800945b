"""What a depth camera measured, repaired before anything is built on it: noise, flying pixels and holes.

Depth that was rendered has no noise and stays as it is. Of a camera that stands still, the frames in which a pixel
shows the same place are averaged, and holes show what other frames saw there; what is left is smoothed, and filled from
the plane through neighbours of the same instance. Holes too far from any stay holes. How far filled depth may be off is
measured on pixels that are known: each told by others around it. A copy gets its recorded depth back wherever an edit
did not change it.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
from jaxtyping import Float32, Int32

from rpaug.core import memo, sampling
from rpaug.core.jit import kernel
from rpaug.core.types import CameraView, Episode, SensedDepth
from rpaug.render import denoise
from rpaug.scene.recorded import pooled

SAMPLED = 3  # frames that tell how noisy a camera is
MIDDLE = 512  # pixels a side of a large image tell it
KEPT = 64  # frames
REACH = 0.12  # of the image's width: holes farther from what is known stay holes
ROUNDS = 2  # of smoothing: half of the noise stays in all frames, and neighbours share it
HOLE = 2  # pixels: half the width of the holes by which filling is tried
WITHIN = 0.9  # of what was filled is off by less than is said
AGREE = 0.05  # of depth by which another time and the plane around a hole may differ

Depth = Float32[np.ndarray, "h w"]
Ids = Int32[np.ndarray, "h w"]


@memo.once
def repaired(episode: Episode) -> Episode:
    """The episode with the depth of its noisy cameras repaired (`CameraView.sensed`); as it is where none is noisy."""
    views = dict(episode.views)
    for name, view in episode.views.items():
        level = noise(episode, name)
        if level >= denoise.NOISY:
            views[name] = _repaired(episode, view, level)
    return replace(episode, views=views) if views != dict(episode.views) else episode


def noise(episode: Episode, name: str) -> float:
    """Deviation of a camera's depth as a share of depth, by noise or steps, the median of a few frames; 0 without."""
    view = episode.views[name]
    if view.depth is None:
        return 0.0
    frames = sampling.frames(episode.length, SAMPLED)
    found = list[float]()
    for t in frames:
        depth, ids = _middle(view.depth(t)), _middle(_ids(view, t))
        found.append(max(denoise.noise(depth, ids), denoise.steps(depth, ids)))
    return float(np.median(found))


def _middle(image: np.ndarray) -> np.ndarray:
    row, column = (max(0, (side - MIDDLE) // 2) for side in image.shape)
    return image[row : row + MIDDLE, column : column + MIDDLE]


def told(episode: Episode) -> tuple[str, ...]:
    """What was repaired, in sentences."""
    return tuple(
        f"{name}: its depth is a sensor's, {1000 * s.noise:.1f} mm of noise; {s.missing:.1%} of its pixels "
        f"were missing, {s.unknown:.1%} still are; what was filled may be off by {1000 * s.spread:.0f} mm"
        for name, view in episode.views.items()
        if (s := view.sensed)
    )


def _repaired(episode: Episode, view: CameraView, level: float) -> CameraView:
    cleaned = replace(view, depth=partial(_cleaned, view, level))
    alone = replace(episode, views={"": cleaned})
    pool = pooled.of_camera(alone, "")
    reach = max(HOLE + 2, round(REACH * view.camera.width))

    @lru_cache(KEPT)
    def at(t: int) -> Depth:
        ids = _ids(view, t)
        depth = cleaned.depth(t)  # type: ignore[misc]
        around = denoise.filled(depth, ids, reach)
        rested = _rested(depth, around, ids, pool.ids, pool.depths, pool.tolerance)
        return denoise.filled(_smooth(rested, ids, level), ids, reach)

    return replace(view, depth=at, sensed=_judged(episode, view, at, level, reach))


def _judged(
    episode: Episode, view: CameraView, at: Callable[[int], Depth], level: float, reach: int
) -> SensedDepth:
    """How much was missing, is still, and how far off what was filled may be."""
    assert view.depth is not None
    off, missing, unknown, far = list[np.ndarray](), list[float](), list[float](), list[float]()
    for t in sampling.frames(episode.length, SAMPLED):
        ids, depth, now = _ids(view, t), _cleaned(view, level, t), at(t)
        guess = denoise.filled(depth, ids, reach, HOLE)
        both = (depth > 0) & (guess > 0)
        off.append(np.abs(guess - now)[both])
        far.append(float(np.median(depth[both])) if both.any() else 0.0)
        missing.append(float((depth == 0).mean()))
        unknown.append(float((now == 0).mean()))
    apart = np.concatenate(off)
    spread = float(np.quantile(apart, WITHIN)) if len(apart) else float("inf")
    return SensedDepth(
        view.depth,
        level * float(np.median(far)),
        spread,
        float(np.mean(missing)),
        float(np.mean(unknown)),
    )


def _smooth(depth: Depth, ids: Ids, level: float) -> Depth:
    for _ in range(ROUNDS):
        depth = denoise.smooth(depth, ids, level)
    return depth


def _cleaned(view: CameraView, level: float, t: int) -> Depth:
    """A frame's depth without what flies."""
    assert view.depth is not None
    return denoise.grounded(view.depth(t), _ids(view, t), level)


def _ids(view: CameraView, t: int) -> Ids:
    return view.ids(t) if view.ids else np.zeros((view.camera.height, view.camera.width), np.int32)


@kernel
def _rested(
    depth: Depth,
    around: Depth,
    ids: Ids,
    slots: Int32[np.ndarray, "h w slots"],
    depths: Float32[np.ndarray, "h w slots 9"],
    tolerance: float,
) -> Depth:
    """Depth as the mean of all frames that show the same place; in holes, of one near to what is `around`, else 0."""
    out = depth.copy()
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            here = depth[row, column]
            near = here if here > 0 else around[row, column]
            if near <= 0:
                continue
            share = tolerance if here > 0 else AGREE
            slot = pooled.find(
                slots[row, column], depths[row, column], ids[row, column], near, share
            )
            if slot >= 0:
                out[row, column] = depths[row, column, slot, 0]
    return out
