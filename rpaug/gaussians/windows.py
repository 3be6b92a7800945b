"""Recorded views of one thing, cut out around it, and its Gaussians rendered into them in colors of one's own."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int, Int32
from torch import Tensor

from rpaug.core.sampling import frames
from rpaug.core.types import Gaussians, Scene
from rpaug.gaussians import frame_residuals
from rpaug.gaussians.gaussian_view import sharp, standing, view_of
from rpaug.gaussians.gaussians import SH0, Placement
from rpaug.render.splat import Splats, View
from rpaug.render.splat.autograd import Images, rasterise
from rpaug.scene.recorded import surface

MARGIN = 8  # pixels around the target
LEAST = 48  # pixels of the target that make a view worth a look
LOOKED = 16  # times among which those that show most of it are found
OPAQUE = 0.3  # alpha of the target alone, below which its color is not known


@dataclass(frozen=True)
class TargetWindow:
    """What one camera shows of the target at one time; the cut's first pixel is `corner` (row, column)."""

    camera: str
    t: int
    corner: tuple[int, int]
    view: View
    splats: Splats  # of the whole scene, in the world at t
    lit: Float32[np.ndarray, "m"]  # how bright even-light colors of the target's Gaussians are at t
    mask: Bool[np.ndarray, "h w"]
    recorded: Float32[np.ndarray, "h w 3"]
    ids: Int32[np.ndarray, "p"]  # of the mask's pixels, row by row
    points: Float32[np.ndarray, "p 3"]  # where they lie in their bodies' frames
    footprint: float  # metres that a pixel is wide there, median


def windows(
    scene: Scene, instance_ids: frozenset[int], rows: Int[np.ndarray, "m"], times: int
) -> list[TargetWindow]:
    """For each camera and each of `times` parts of the episode the frame that shows most of the target."""
    assert scene.gaussians is not None
    found = []
    for name, view in scene.episode.views.items():
        assert view.ids is not None
        looked = frames(scene.episode.length, LOOKED)
        seen = {t: int(np.isin(view.ids(t), list(instance_ids)).sum()) for t in looked}
        for part in np.array_split(np.array(looked), times):
            t = max(part.tolist(), key=seen.__getitem__, default=None)
            if t is not None and seen[t] >= LEAST:
                found.append(_cut(scene, scene.gaussians, name, t, instance_ids, rows))
    return found


def _cut(
    scene: Scene,
    gaussians: Gaussians,
    name: str,
    t: int,
    instance_ids: frozenset[int],
    rows: Int[np.ndarray, "m"],
) -> TargetWindow:
    view = scene.episode.views[name]
    assert view.ids is not None
    mask = np.isin(view.ids(t), list(instance_ids))
    height, width = _span(np.any(mask, axis=1)), _span(np.any(mask, axis=0))
    whole = view_of(standing(scene, name), t)
    K = whole.K.copy()
    K[:2, 2] -= width.start, height.start
    splats = Splats.of(frame_residuals.at(gaussians, t))
    placement = Placement.of(gaussians.ids, scene.bodies, scene.irradiance)
    white = replace(splats, sh=np.full_like(splats.sh, 0.5 / SH0))
    lit = colors_of(placement.place(white, t).sh[rows])[:, 0]
    size = width.stop - width.start, height.stop - height.start
    where = surface.of_view(view, t, scene.bodies, view.ids(t))(np.flatnonzero(mask))
    return TargetWindow(
        camera=name,
        t=t,
        corner=(height.start, width.start),
        view=View(K, whole.world_to_camera, *size),
        splats=placement.place(splats, t),
        lit=lit,
        mask=mask[height, width],
        recorded=view.rgb(t)[height, width].astype(np.float32) / 255,
        ids=where.ids,
        points=where.points,
        footprint=float(np.median(where.footprint)),
    )


def _span(used: Bool[np.ndarray, "n"]) -> slice:
    where = np.flatnonzero(used)
    return slice(max(0, int(where[0]) - MARGIN), min(len(used), int(where[-1]) + 1 + MARGIN))


def colors_of(sh: Float32[np.ndarray, "m k 3"]) -> Float32[np.ndarray, "m 3"]:
    """The constant color of each Gaussian."""
    return (0.5 + SH0 * sh[:, 0]).astype(np.float32)


def render(
    window: TargetWindow, rows: Int[np.ndarray, "m"], colors: Float[Tensor, "m 3"]
) -> Float[Tensor, "h w 3"]:
    """The whole scene in the window, the target's Gaussians `rows` in these colors, lit as they were then."""
    s = window.splats
    sh = torch.from_numpy(s.sh).clone()
    sh[torch.from_numpy(rows), 0] = (colors * torch.from_numpy(window.lit)[:, None] - 0.5) / SH0
    return _drawn(s, np.arange(len(s)), sh, window.view).color


def samples(
    looked: Sequence[TargetWindow],
    rows: Int[np.ndarray, "m"],
    colors: Float32[np.ndarray, "m 3"],
) -> tuple[
    Int32[np.ndarray, "n"],
    Float32[np.ndarray, "n 3"],
    Float32[np.ndarray, "n 3"],
]:
    """What the target's pixels would show if its Gaussians had these colors and nothing else were mixed in.

    Instance ids, points in the bodies' frames, and colors, all windows together.
    """
    sh = torch.from_numpy((colors - 0.5) / SH0)[:, None]
    found = []
    for window in looked:
        images = _drawn(window.splats, rows, sh, window.view)
        alpha = images.alpha.numpy().reshape(window.mask.shape)[window.mask]
        known = alpha > OPAQUE
        own = images.color.numpy()[window.mask][known] / alpha[known, None]
        found.append((window.ids[known], window.points[known], own))
    ids, points, own = (np.concatenate(part) for part in zip(*found, strict=True))
    return ids, points, own


def _drawn(
    splats: Splats, rows: Int[np.ndarray, "m"], sh: Float[Tensor, "m k 3"], view: View
) -> Images:
    assert splats.quats is not None
    assert splats.scales is not None
    means, opacities, quats, scales = (
        torch.from_numpy(array[rows])
        for array in (splats.means, splats.opacities, splats.quats, splats.scales)
    )
    return rasterise(means, opacities, sh, view, quats=quats, scales=scales, settings=sharp(splats))
