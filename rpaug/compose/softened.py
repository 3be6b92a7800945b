"""Things that deform, drawn into a finished view: their Gaussians at that time, cut where nearer things hide them."""

import numpy as np
from jaxtyping import Float32, Int32, UInt8

from rpaug.core.types import Camera, Gaussians
from rpaug.gaussians import frame_residuals, gaussian_view
from rpaug.render.splat import Rasteriser, Splats

SOLID = 0.5  # of a pixel: what covers more of it is what the pixel shows
CLEAR = 1 / 255

Image = tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"], Int32[np.ndarray, "h w"]]


def draw(gaussians: Gaussians, antialiased: bool, camera: Camera, t: int, before: Image) -> Image:
    """Color, depth in metres (0: nothing there) and instance ids once the Gaussians stand there too.

    Where a recording's outlines are smooth, a pixel shows as much of the thing as covers it; where they are sharp, all
    or nothing.
    """
    rgb, depth, ids = before
    now = frame_residuals.at(gaussians, t)
    splats = Splats.of(now)
    drawn = Rasteriser(gaussian_view.sharp(splats)).forward(
        splats, gaussian_view.view_of(camera, t)
    )
    surface = gaussian_view.plane_depth(drawn, splats, camera, t)
    share = np.minimum(drawn.alpha, 1.0)
    near = np.where(surface > 0, surface, drawn.depth_expected)
    front = (share > CLEAR) & ((depth <= 0) | (near < depth))
    solid = front & (share > SOLID) & (drawn.surface_index >= 0)
    if not front.any():
        return before
    if antialiased:
        mixed = 255 * np.clip(drawn.color, 0, 1) + (1 - share[..., None]) * rgb
        rgb = np.where(front[..., None], np.rint(np.clip(mixed, 0, 255)), rgb).astype(np.uint8)
    else:
        whole = 255 * np.clip(drawn.color / np.maximum(share, SOLID)[..., None], 0, 1)
        rgb = np.where(solid[..., None], np.rint(whole), rgb).astype(np.uint8)
    names = now.ids[np.maximum(drawn.surface_index, 0)]
    return (
        rgb,
        np.where(solid, surface, depth).astype(np.float32),
        np.where(solid, names, ids).astype(np.int32),
    )
