"""A drawn episode of color images alone: a blue table on a grey floor, a red block, a dark arm that moves."""

import numpy as np

from rpaug.core.types import Camera, CameraView, Episode, Robot

SIZE = 64
TABLE, FLOOR, BLOCK, ARM, PLATE = (
    (90, 140, 190),
    (120, 118, 115),
    (200, 30, 30),
    (15, 15, 18),
    (60, 170, 60),
)


def still(length: int, size: int = SIZE, **given) -> Camera:
    """A camera of which nothing is known unless told."""
    focal = 1.2 * size
    K = np.array([[focal, 0, (size - 1) / 2], [0, focal, (size - 1) / 2], [0, 0, 1]])
    return Camera(K, np.tile(np.eye(4), (length, 1, 1)), size, size, **({"assumed": True} | given))


def image(t: int, carried: bool = False, noise: float = 1.5) -> np.ndarray:
    """Frame t: the arm comes down from the top and moves right; the block goes with it if carried."""
    out = np.empty((SIZE, SIZE, 3), float)
    out[:] = FLOOR
    out[16:60, 6:58] = TABLE
    out[44:54, 40:52] = PLATE
    left = 14 + (2 * t if carried else 0)
    out[36:44, left : left + 8] = BLOCK
    out[0:30, 14 + 2 * t : 22 + 2 * t] = ARM
    out += np.random.default_rng(t).normal(0, noise, out.shape)
    return np.clip(np.rint(out), 0, 255).astype(np.uint8)


def episode(length: int = 12, carried: bool = False, views: int = 1, **given) -> Episode:
    """All of it; further views show the same mirrored."""
    images = [image(t, carried) for t in range(length)]
    mirrored = [one[:, ::-1].copy() for one in images]
    cameras = {
        f"image_{k}": CameraView(still(length, **given), (mirrored if k else images).__getitem__)
        for k in range(views)
    }
    robot = Robot(np.zeros((length, 0)), np.zeros((length, 0)), None, None)
    return Episode("drawn/0", cameras, robot, ("put the block on the plate",), length)
