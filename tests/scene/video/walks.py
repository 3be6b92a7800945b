"""A walk past a textured table with a red and a blue sheet on it: every frame exact, poses known."""

import cv2
import numpy as np

from rpaug import Camera, CameraView, Episode, Robot
from rpaug.core import geometry
from rpaug.scene.video.model import Reconstruction

WIDTH, HEIGHT, FOCAL = 192, 144, 180.0
LEVEL = -0.4
WALL = 0.4


def poses(length: int) -> np.ndarray:
    """Cameras half a metre above the table that look down at it, and walk along x."""
    track = np.tile(np.eye(4), (length, 1, 1))
    for t in range(length):
        ahead = np.array([0.0, 0.8, -0.6])
        right = np.array([1.0, 0.0, 0.0])
        track[t, :3, :3] = np.stack([right, np.cross(ahead, right), ahead], 1)
        track[t, :3, 3] = [0.05 * t - 0.02 * length, -0.5 + 0.01 * t, 0.1]
    return track


def texture() -> np.ndarray:
    """The table from above, a millimetre a pixel: speckles, and two plain sheets."""
    rng = np.random.default_rng(3)
    rough = cv2.resize(rng.integers(90, 200, (300, 300), np.uint8), (2400, 2400))
    fine = cv2.resize(rng.integers(0, 60, (1200, 1200), np.uint8), (2400, 2400))
    image = np.repeat((rough // 2 + fine + 40)[..., None], 3, 2)
    image[1150:1350, 1000:1200] = (190, 25, 25)
    image[1150:1350, 1300:1450] = (30, 40, 190)
    return image.astype(np.uint8)


def K() -> np.ndarray:
    return np.array([[FOCAL, 0, (WIDTH - 1) / 2], [0, FOCAL, (HEIGHT - 1) / 2], [0, 0, 1]])


def frame(pose: np.ndarray, table: np.ndarray) -> np.ndarray:
    """What a pinhole camera sees of the table, and of a wall of the same stuff that stands where the table ends."""
    onto = np.array([[1e-3, 0, -1.2], [0, 1e-3, -1.2], [0, 0, LEVEL], [0, 0, 1]])
    up = np.array([[1e-3, 0, -1.2], [0, 0, WALL], [0, -1e-3, LEVEL + 2.4], [0, 0, 1]])
    images = []
    for plane in (onto, up):
        seen = K() @ (geometry.inverse(pose)[:3] @ plane)
        images.append(cv2.warpPerspective(table, seen, (WIDTH, HEIGHT), flags=cv2.INTER_AREA))
    return np.where(_beyond(pose)[..., None], images[1], images[0])


def _beyond(pose: np.ndarray) -> np.ndarray:
    """Pixels whose rays meet the wall before the table."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    rays = np.stack([columns, rows, np.ones_like(rows)], -1) @ np.linalg.inv(K()).T @ pose[:3, :3].T
    with np.errstate(divide="ignore"):
        table = (LEVEL - pose[2, 3]) / rays[..., 2]
        wall = (WALL - pose[1, 3]) / rays[..., 1]
    return (wall > 0) & ((table < 0) | (wall < table))


def walk(length: int = 10) -> Episode:
    """A video of which only images are known."""
    table = texture()
    images = [frame(pose, table) for pose in poses(length)]
    still = np.tile(np.eye(4), (length, 1, 1))
    camera = Camera(K(), still, WIDTH, HEIGHT, assumed=True)
    none = np.zeros((length, 0))
    robot = Robot(none, none, None, None, {"seconds": np.arange(length)[:, None] / 10})
    return Episode("walk", {"ego": CameraView(camera, images.__getitem__)}, robot, (), length)


def model(length: int, times: list[int] | None = None, radial: float = 0.0) -> Reconstruction:
    """What structure from motion should find: points on the table, in a world that is turned and scaled."""
    times = list(range(length)) if times is None else times
    rng = np.random.default_rng(1)
    points = np.stack(
        [rng.uniform(-0.5, 0.5, 600), rng.uniform(-0.2, 0.6, 600), np.full(600, LEVEL)], 1
    )
    track = poses(length)[times]
    seen = np.zeros((len(times), len(points)), bool)
    for k, pose in enumerate(track):
        local = geometry.transform(geometry.inverse(pose), points) @ K().T
        at = local[:, :2] / local[:, 2:]
        seen[k] = (local[:, 2] > 0) & (at > 0).all(1) & (at < [WIDTH - 1, HEIGHT - 1]).all(1)
    found = Reconstruction(
        np.array(times, np.int32), track, FOCAL, (float(K()[0, 2]), float(K()[1, 2])), radial, WIDTH,
        HEIGHT, points, np.full((len(points), 3), 128, np.uint8), seen, {"mapper": "exact"},
    )  # fmt: skip
    return found.moved(geometry.rigid(np.array([0.3, -0.2, 0.5]), np.array([1.0, 2.0, 3.0])), 4.0)
