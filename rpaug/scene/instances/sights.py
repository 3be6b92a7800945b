"""A few frames of the fixed cameras of an episode without masks, with all that a point is held against."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, Float64, Int

from rpaug.core.types import CameraView, Episode
from rpaug.scene.sampled_frames import MOST_PIXELS

BLOCK = np.ones((3, 3), np.uint8)


@dataclass(frozen=True)
class Sights:
    """Depth and color of `frames` (ascending) from every fixed camera that has depth, thinned to one size.

    `depth` is in metres, 0 where unknown; `nearest` and `farthest` are the same over each pixel and those of
    its eight neighbours that are known; `darkest` and `brightest` the colors there in 0..1.
    Smaller images are padded with unknown depth.
    """

    frames: Int[np.ndarray, "s"]
    cameras: tuple[str, ...]
    K: Float64[np.ndarray, "c 3 3"]
    world_to_camera: Float64[np.ndarray, "c 4 4"]
    depth: Float32[np.ndarray, "s c h w"]
    nearest: Float32[np.ndarray, "s c h w"]
    farthest: Float32[np.ndarray, "s c h w"]
    darkest: Float32[np.ndarray, "s c h w 3"]
    brightest: Float32[np.ndarray, "s c h w 3"]


def step_of(view: CameraView) -> int:
    """Every how many pixels a camera's image is looked at."""
    return max(1, round(view.camera.width / MOST_PIXELS))


def images(view: CameraView, t: int) -> tuple[np.ndarray, np.ndarray]:
    """Thinned depth (0 where unknown) and color in 0..1."""
    assert view.depth is not None
    step = step_of(view)
    depth = np.nan_to_num(view.depth(t)[::step, ::step], nan=0.0, posinf=0.0, neginf=0.0)
    return depth, view.rgb(t)[::step, ::step].astype(np.float32) / 255


def see(episode: Episode, frames: Sequence[int]) -> Sights:
    """Decode the fixed cameras' frames."""
    views = {
        name: view
        for name, view in episode.views.items()
        if view.depth is not None and view.camera.fixed
    }
    sizes = [
        (-(-v.camera.height // step_of(v)), -(-v.camera.width // step_of(v)))
        for v in views.values()
    ]
    shape = (
        len(frames),
        len(views),
        max((h for h, _ in sizes), default=1),
        max((w for _, w in sizes), default=1),
    )
    depths, nearest, farthest = (np.zeros(shape, np.float32) for _ in range(3))
    darkest, brightest = (np.zeros((*shape, 3), np.float32) for _ in range(2))
    K, poses = np.zeros((len(views), 3, 3)), np.zeros((len(views), 4, 4))
    for c, view in enumerate(views.values()):
        step = step_of(view)
        # Integer pixel centres: every step-th pixel is the image of a camera with K / step, exactly.
        K[c] = np.diag([1 / step, 1 / step, 1.0]) @ view.camera.K
        poses[c] = np.linalg.inv(view.camera.cam_to_world[0])
        for s, t in enumerate(frames):
            depth, color = images(view, t)
            h, w = depth.shape
            known = depth > 0
            near = cv2.erode(np.where(known, depth, np.inf).astype(np.float32), BLOCK)
            depths[s, c, :h, :w] = depth
            nearest[s, c, :h, :w] = np.where(known, near, 0)
            farthest[s, c, :h, :w] = np.where(known, cv2.dilate(depth, BLOCK), 0)
            darkest[s, c, :h, :w], brightest[s, c, :h, :w] = (
                cv2.erode(color, BLOCK),
                cv2.dilate(color, BLOCK),
            )
    return Sights(
        np.array(frames), tuple(views), K, poses, depths, nearest, farthest, darkest, brightest
    )
