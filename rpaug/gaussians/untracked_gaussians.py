"""What moves and nothing says how: Gaussians of a moment, one for each pixel that shows it in a camera's own frame."""

from dataclasses import replace

import numpy as np

from rpaug.core.types import Gaussians, Scene
from rpaug.gaussians.gaussians import LiftedImage, lifted
from rpaug.scene.recorded.surface import depth_of

NEARER = 0.98  # of its depth: guessed, it may lie in what is behind it
OPAQUE = 0.99


def of(scene: Scene, camera: str, t: int) -> Gaussians | None:
    """What moves in this camera's image at t; None in scenes whose depth was recorded, where tracks say how."""
    view = scene.episode.views.get(camera)  # an eye may have recorded nothing
    if view is None or view.proxy is None or view.ids is None:
        return None
    depth, ids = depth_of(view, t), view.ids(t)
    use = np.isin(ids, sorted(unsteady(scene)))
    if depth is None or not use.any():
        return None
    eye = view.camera
    nearer = (NEARER * depth).astype(np.float32)
    made = lifted(LiftedImage(view.rgb(t), nearer, ids, eye.K, eye.cam_to_world[t], use))
    return replace(made, opacities=np.full(len(made), OPAQUE, np.float32))


def unsteady(scene: Scene) -> frozenset[int]:
    """Handles of what moves in an unknown way."""
    found = (body.instance_ids for body in scene.tracked if body.motion == "unknown")
    return frozenset().union(*found)
