"""How well a scene's Gaussians show what was recorded: PSNR, SSIM and depth, view by view."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Float64, UInt8

from rpaug.core import metrics
from rpaug.core.types import Scene
from rpaug.gaussians import frame_residuals
from rpaug.gaussians.descent import shot_of
from rpaug.gaussians.gaussian_view import plane_depth, sharp, standing, to_bytes, view_of
from rpaug.gaussians.gaussians import Placement
from rpaug.render.splat import Rasteriser, Splats, engine

LEAST = 255.0**2 * 1e-10  # squared grey levels: 100 dB
REACH = 5  # pixels that SSIM's window reaches


def judged(
    scene: Scene, times: Sequence[int], threads: int
) -> Float64[np.ndarray, "times cameras 3"]:
    """PSNR in decibels, SSIM, and the median error of the surface's depth in metres, of each recorded view."""
    assert scene.gaussians is not None
    usual, names = scene.gaussians, list(scene.episode.views)
    placement = Placement.of(usual.ids, scene.bodies, scene.irradiance)

    def look(t: int) -> list[tuple[float, float, float]]:
        placed = placement.place(Splats.of(frame_residuals.at(usual, t)), t)
        found = []
        for name in names:
            eye, shot = standing(scene, name), shot_of(scene.episode, name, t)
            drawn = Rasteriser(sharp(placed)).forward(placed, view_of(eye, t))
            depth = plane_depth(drawn, placed, eye, t)
            off = np.abs(depth - shot.depth)[(depth > 0) & (shot.depth > 0)]
            truth, image = to_bytes(shot.rgb), to_bytes(drawn.color)
            wrong = float(np.median(off)) if len(off) else 0.0
            found.append((psnr(image, truth), ssim(image, truth), wrong))
        return found

    with ThreadPoolExecutor(threads) as pool:
        return np.array(list(pool.map(look, times))).reshape(len(times), len(names), 3)


def colors_db(
    scene: Scene, times: Sequence[int], threads: int, backend: str = "auto"
) -> Float64[np.ndarray, "times cameras"]:
    """The first of these alone, drawn by any backend."""
    assert scene.gaussians is not None
    usual, names = scene.gaussians, list(scene.episode.views)
    placement = Placement.of(usual.ids, scene.bodies, scene.irradiance)

    def look(t: int) -> list[float]:
        placed = placement.place(Splats.of(frame_residuals.at(usual, t)), t)
        eye, found = engine(backend, sharp(placed)), []
        for name in names:
            drawn = eye.forward(placed, view_of(standing(scene, name), t), surface=False)
            found.append(psnr(to_bytes(drawn.color), scene.episode.views[name].rgb(t)))
        return found

    with ThreadPoolExecutor(threads) as pool:
        return np.array(list(pool.map(look, times))).reshape(len(times), len(names))


def fixed_cameras(scene: Scene) -> list[int]:
    """Which of the episode's cameras stand still, by their place; all if none does."""
    views = list(scene.episode.views.values())
    return [k for k, view in enumerate(views) if view.camera.fixed] or list(range(len(views)))


def psnr(image: UInt8[np.ndarray, "h w 3"], truth: UInt8[np.ndarray, "h w 3"]) -> float:
    """Peak signal-to-noise ratio in decibels, at most 100."""
    return metrics.psnr(float(np.mean((image.astype(np.float64) - truth) ** 2)), LEAST)


def ssim(image: UInt8[np.ndarray, "h w 3"], truth: UInt8[np.ndarray, "h w 3"]) -> float:
    """Structural similarity, mean over the pixels whose whole window lies in the image; 1 if there are none."""
    whole = metrics.ssim(image, truth)[REACH:-REACH, REACH:-REACH]
    return float(whole.mean()) if whole.size else 1.0
