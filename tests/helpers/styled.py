"""The analytic scene with Gaussians lifted from its own images, so that nothing needs a fit."""

from dataclasses import replace

import numpy as np
from analytic import scene

from rpaug.core.types import Scene
from rpaug.gaussians.gaussians import LiftedImage, joined, lifted

EYES = {"front": (1.1, 0.2, 0.7), "side": (0.2, 1.1, 0.6)}


def with_gaussians(length: int = 2) -> Scene:
    """Two cameras, a table with a box on it, one Gaussian for each pixel of the first frame."""
    bare = scene(EYES, length=length, ball=False)
    parts = []
    for view in bare.episode.views.values():
        ids, depth = view.ids(0), view.depth(0)
        pose = view.camera.cam_to_world[0]
        parts.append(lifted(LiftedImage(view.rgb(0), depth, ids, view.camera.K, pose, ids > 0)))
    return replace(bare, gaussians=joined(parts))


def stripes(size: int = 48) -> np.ndarray:
    """A style picture: slanted bands of red and white."""
    r, c = np.mgrid[:size, :size]
    band = ((r + c) // 6 % 2).astype(bool)
    return np.where(band[..., None], np.uint8([200, 40, 40]), np.uint8([240, 240, 230]))
