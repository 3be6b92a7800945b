"""Recorded images of one moment as targets of a fit, with the pixels kept back, and Gaussians lifted from the rest."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32

from rpaug.core import geometry
from rpaug.core.errors import Unsupported
from rpaug.core.types import Episode
from rpaug.gaussians.gaussians import LiftedImage, joined, lifted
from rpaug.render.splat import Splats, View

SAME_DEPTH = 0.01  # relative difference up to which two cameras see the same point


@dataclass(frozen=True)
class TargetImage:
    """One image to fit: colors in 0..1; depth in metres, 0 where unknown, None where there is none.

    `held` marks pixels that are never fitted; `judged` those of them that tell how well unseen pixels are shown.
    """

    view: View
    color: Float32[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"] | None
    held: Bool[np.ndarray, "h w"]
    judged: Bool[np.ndarray, "h w"]

    @property
    def weight(self) -> Float32[np.ndarray, "h w"]:
        """1 where a pixel is fitted, else 0."""
        return (~self.held).astype(np.float32)


def shots_at(
    episode: Episode, t: int, *, stride: int = 2, hold_out: float = 0.1, seed: int = 0
) -> tuple[Splats, tuple[TargetImage, ...]]:
    """Gaussians to begin with and what to fit them to: all cameras of an episode at one time.

    A share `hold_out` of the pixels, drawn from `seed`, is kept back: from the fit, and from the start as well.
    Judged are those of them that another camera sees too. Every `stride`-th pixel of every `stride`-th row becomes
    a Gaussian on its recorded depth. Raises Unsupported without depth.
    """
    rng = np.random.default_rng(seed)
    shots, parts = [], []
    for name, recorded in episode.views.items():
        if recorded.depth is None:
            raise Unsupported(f"camera {name} has no depth to begin a fit from")
        camera, rgb, depth = recorded.camera, recorded.rgb(t), recorded.depth(t)
        held = rng.uniform(size=depth.shape) < hold_out
        lattice = np.zeros(depth.shape, bool)
        lattice[::stride, ::stride] = True
        ids = np.zeros(depth.shape, np.int32) if recorded.ids is None else recorded.ids(t)
        pose = camera.cam_to_world[t]
        parts.append(lifted(LiftedImage(rgb, depth, ids, camera.K, pose, lattice & ~held), stride))
        view = View(camera.K, geometry.inverse(pose), camera.width, camera.height)
        shots.append(TargetImage(view, rgb.astype(np.float32) / 255, depth, held, held))
    judged = [replace(shot, judged=shot.held & covisible(shot, shots)) for shot in shots]
    return Splats.of(joined(parts)), tuple(judged)


def covisible(shot: TargetImage, others: list[TargetImage]) -> Bool[np.ndarray, "h w"]:
    """Pixels whose point another of the shots sees as well: in its image and at its recorded depth."""
    assert shot.depth is not None
    rows, columns = np.nonzero(shot.depth > 0)
    rays = np.stack([columns, rows, np.ones_like(rows)], -1) @ np.linalg.inv(shot.view.K).T
    to_world = geometry.inverse(shot.view.world_to_camera)
    points = geometry.transform(to_world, rays * shot.depth[rows, columns, None])
    seen = np.zeros(len(points), bool)
    for other in others:
        if other is shot or other.depth is None:
            continue
        there = geometry.transform(other.view.world_to_camera, points)
        z = np.maximum(there[:, 2], 1e-9)
        at = np.rint((there @ other.view.K.T)[:, :2] / z[:, None])
        inside = (there[:, 2] > 0) & (at >= 0).all(-1)
        inside &= (at[:, 0] < other.view.width) & (at[:, 1] < other.view.height)
        column, row = np.where(inside, at.T, 0).astype(int)
        measured = other.depth[row, column]
        seen |= inside & (np.abs(measured - z) < SAME_DEPTH * z)
    result = np.zeros(shot.depth.shape, bool)
    result[rows, columns] = seen
    return result
