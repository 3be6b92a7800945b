"""Fit moments: at each recorded time, what moving bodies' Gaussians differ by so that its images are shown.

Recorded images are point-sampled, so an outline that runs through a pixel shows one side or the other, anew at every
frame; no rigid thing follows that. Only pixels around what moves are looked at, and only what they show is drawn.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Int

from rpaug.core import geometry
from rpaug.core.types import FrameResidual, Scene
from rpaug.gaussians import frame_residuals
from rpaug.gaussians.descent import cosine, shot_of
from rpaug.gaussians.frame_residuals import PARTS
from rpaug.gaussians.gaussian_view import sharp, standing, view_of
from rpaug.gaussians.gaussians import Placement
from rpaug.render.splat import Adam, Gradients, Rates, Splats, View, engine

# Twice those of the fit before: few steps, each on all that is seen at a time.
RATES = Rates(means=0.16, quats=2e-2, scales=0.1, opacities=0.3, sh=0.14)
LAST_RATE = 0.1  # share of the rates left at the end
MARGIN = 2  # pixels around what moves
SEEN = 1e-4  # pixels' worth of light: what shows less in a window is left out of it


@dataclass(frozen=True)
class _ResidualWindow:
    """The part of one view around what moves, and the placed splats that it shows."""

    view: View
    rgb: Float32[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]
    rows: Int[np.ndarray, "m"]


def fit_frame_residuals(
    scene: Scene,
    times: Sequence[int],
    *,
    steps: int,
    depth_weight: float,
    threads: int,
    backend: str = "auto",
    progress: Callable[[float], None] = lambda share: None,
) -> Mapping[int, FrameResidual]:
    """Moments of the scene's Gaussians at `times`, going on from those they have; `threads` do not change them."""
    assert scene.gaussians is not None
    usual = scene.gaussians
    placement = Placement.of(usual.ids, scene.bodies, scene.irradiance)
    moving = np.zeros(len(usual), bool)
    for rows in placement.rows:
        moving[rows] = True
    found: dict[int, FrameResidual] = dict(usual.frame_residuals)

    def work(t: int) -> FrameResidual | None:
        then = placement.place(Splats.of(frame_residuals.at(usual, t)), t)
        windows = list(_windows(scene, t, then, moving, backend))
        if not windows:
            return None
        loose = np.unique(np.concatenate([window.rows for window in windows]))
        loose = loose[moving[loose]]
        settled = _descend(windows, then, loose, steps, depth_weight, backend)
        own = placement.take_back(settled, t)
        return frame_residuals.difference(usual, _part(own, loose), loose)

    with ThreadPoolExecutor(threads) as pool:
        for number, (t, moment) in enumerate(zip(times, pool.map(work, times), strict=True)):
            if moment is not None:
                found[t] = moment
            progress((number + 1) / len(times))
    return dict(sorted(found.items()))


def _windows(
    scene: Scene, t: int, then: Splats, moving: Bool[np.ndarray, "n"], backend: str
) -> Iterator[_ResidualWindow]:
    """One for each view that shows something moving: all of it if the camera moves."""
    assert scene.gaussians is not None
    instance_ids = np.unique(scene.gaussians.ids[moving])
    # Grey, for colors below black pass no gradient: it tells how much of each splat is seen.
    grey, eye = replace(then, sh=np.zeros_like(then.sh)), engine(backend, sharp(then))
    for name, recorded in scene.episode.views.items():
        assert recorded.ids is not None
        shown = np.isin(recorded.ids(t), instance_ids) | (not recorded.camera.fixed)
        if not shown.any():
            continue
        shot, view = shot_of(scene.episode, name, t), view_of(standing(scene, name), t)
        part = _around(shown | _projected(then.means[moving], view))
        K = view.K.copy()
        K[:2, 2] -= part[1].start, part[0].start
        rgb, depth = shot.rgb[part], shot.depth[part]
        window = View(K, view.world_to_camera, rgb.shape[1], rgb.shape[0])
        eye.prepare(grey, window)
        light = eye.backward(np.ones_like(rgb)).sh[:, 0, 0]
        yield _ResidualWindow(window, rgb, depth, np.flatnonzero(light > SEEN))


def _projected(points: Float32[np.ndarray, "n 3"], view: View) -> Bool[np.ndarray, "h w"]:
    """Pixels that the points fall on, hidden or not: what is hidden must stay so."""
    local = geometry.transform(view.world_to_camera, points.astype(np.float64))
    marked = np.zeros((view.height, view.width), bool)
    local = local[local[:, 2] > 0]
    pixels = np.rint(local @ view.K.T / local[:, 2:])[:, :2]
    inside = ((pixels >= 0) & (pixels < [view.width, view.height])).all(-1)
    column, row = pixels[inside].astype(int).T
    marked[row, column] = True
    return marked


def _around(shown: Bool[np.ndarray, "h w"]) -> tuple[slice, slice]:
    """Rows and columns of the smallest box that holds the marked pixels and a margin."""
    spans = []
    for axis in (1, 0):
        marked = np.flatnonzero(shown.any(axis))
        spans.append(slice(max(int(marked[0]) - MARGIN, 0), int(marked[-1]) + MARGIN + 1))
    return spans[0], spans[1]


def _descend(
    windows: Sequence[_ResidualWindow],
    then: Splats,
    loose: Int[np.ndarray, "m"],
    steps: int,
    depth_weight: float,
    backend: str,
) -> Splats:
    """The splats after `steps` of Adam on the loose ones, each on all windows."""
    assert then.scales is not None
    eye = engine(backend, sharp(then))
    adam = Adam(_part(then, loose), RATES, size=float(np.median(then.scales)))
    scenery = [_part(then, window.rows) for window in windows]
    # Which of a window's splats are loose, and which of the loose ones they are.
    here = [np.flatnonzero(np.isin(window.rows, loose)) for window in windows]
    there = [
        np.searchsorted(loose, window.rows[h]) for window, h in zip(windows, here, strict=True)
    ]
    whole = max(window.depth.size for window in windows)
    for step in range(steps):
        total = {name: np.zeros_like(getattr(adam.splats, name)) for name in PARTS}
        for window, splats, h, o in zip(windows, scenery, here, there, strict=True):
            for name in PARTS:
                getattr(splats, name)[h] = getattr(adam.splats, name)[o]
            eye.prepare(splats, window.view)
            # A mean over the window's pixels, so that a pixel weighs the same in all.
            weight = np.full(window.depth.shape, window.depth.size / whole, np.float32)
            _, _, gradients = eye.backward_squared_error(
                window.rgb, weight, window.depth, depth_weight
            )
            for name in PARTS:
                total[name][o] += getattr(gradients, name)[h]
        by = Gradients(**total, covariances=None, features=None, image_motion=total["opacities"])
        adam.step(by, cosine(step / steps, LAST_RATE))
    return _with(then, adam.splats, loose)


def _part(splats: Splats, rows: Int[np.ndarray, "m"]) -> Splats:
    return replace(splats, **{name: getattr(splats, name)[rows] for name in PARTS})


def _with(splats: Splats, part: Splats, rows: Int[np.ndarray, "m"]) -> Splats:
    """The splats with some rows replaced; quaternions brought to length 1."""
    arrays = {name: getattr(splats, name).copy() for name in PARTS}
    for name in PARTS:
        arrays[name][rows] = getattr(part, name)
    length = np.linalg.norm(arrays["quats"][rows], axis=-1, keepdims=True)
    arrays["quats"][rows] /= np.maximum(length, 1e-12)
    return replace(splats, **arrays)
