"""Gaussians of a scene of color images alone: fitted to what rests, on a model's depth or on the stage's.

What moves is left out of the fit and shown as each frame has it (`rpaug.gaussians.untracked_gaussians`).
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float32, UInt8

from rpaug.core import sampling
from rpaug.core.errors import Unsupported
from rpaug.core.metrics import FITTED_ERROR, psnr
from rpaug.core.types import CameraView, Scene
from rpaug.providers import inpaint
from rpaug.scene.placement.free_space_rgb import together

Fit = Callable[[Scene], tuple[Scene, Mapping[str, Any]]]
FRAMES = 25  # that what rests is seen in
CHECKED = 6  # frames that the fitted scene is held against


def fitted(scene: Scene, fit: Fit) -> tuple[Scene, Mapping[str, Any]]:
    """The scene with what `fit` makes of it, and the report of that, decibels being those against recorded frames.

    Raises Unsupported for a camera that moves, which has no ground plane, and for several whose places are unknown.
    """
    if not any(view.proxy for view in scene.episode.views.values()):
        return fit(scene)
    from rpaug.gaussians import untracked_gaussians  # only here: it brings the rasteriser

    moving = untracked_gaussians.unsteady(scene)
    views = {
        name: _at_rest(view, scene.episode.length, moving)
        for name, view in together(scene, "Gaussians").items()
    }
    rests = tuple(body for body in scene.bodies if not body.instance_ids <= moving)
    if not rests:
        raise Unsupported("nothing was seen to rest, so there is nothing to fit Gaussians to")
    plain = replace(
        scene,
        episode=replace(scene.episode, views=views),
        cameras={name: view.camera for name, view in views.items()},
        bodies=rests,
    )
    made, facts = fit(plain)
    made = replace(made, episode=scene.episode, cameras=scene.cameras, bodies=scene.bodies)
    seen = {name: _decibels(made, name) for name in views}
    given = {"per_camera_db": seen, "train_db": float(np.mean(list(seen.values())))}
    return made, {**facts, **given, "held_out_db": None}


def _at_rest(view: CameraView, length: int, moving: frozenset[int]) -> CameraView:
    """The view as if nothing ever moved in it: middle colors of what rests, painted where that was never seen."""
    assert view.ids is not None
    depth = view.proxy.depth if view.proxy else None
    if depth is None:
        raise Unsupported("Gaussians need depth, and a camera that moves has no ground plane")
    times = sampling.frames(length, FRAMES)
    shown = np.stack([view.rgb(t) for t in times])
    ids = np.stack([view.ids(t) for t in times])
    hidden = np.isin(ids, sorted(moving))
    colors = np.ma.masked_array(shown, np.repeat(hidden[..., None], 3, -1))
    image = np.ma.median(colors, axis=0).filled(0).astype(np.uint8)
    # The instance id seen most often; where none was, that of the nearest pixel is as good as any.
    names = np.unique(ids[~hidden])
    votes = np.stack([((ids == name) & ~hidden).sum(0) for name in names])
    instance_ids = names[votes.argmax(0)].astype(np.int32)
    never = np.all(hidden, axis=0)
    if never.any():
        image = inpaint.paint("telea", image, never)
        instance_ids[never] = names[np.bincount(votes.argmax(0)[~never].reshape(-1)).argmax()]
    return replace(
        view, rgb=lambda t: image, depth=lambda t: depth, ids=lambda t: instance_ids, proxy=None
    )


def _decibels(scene: Scene, name: str) -> float:
    """PSNR of the scene's Gaussians against recorded frames of a camera."""
    from rpaug.gaussians import gaussian_view

    view = scene.episode.views[name]
    off = [
        _squares(gaussian_view.blended(scene, name, t)[0], view.rgb(t))
        for t in sampling.frames(scene.episode.length, CHECKED)
    ]
    return psnr(float(np.mean(off)), FITTED_ERROR)


def _squares(one: UInt8[np.ndarray, "h w 3"], other: UInt8[np.ndarray, "h w 3"]) -> float:
    away: Float32[np.ndarray, "h w 3"] = one.astype(np.float32) - other
    return float((away**2).mean())
