"""A sheet that waves over a table, cast exactly: an episode with something no rigid motion explains."""

import numpy as np

from rpaug.core import geometry
from rpaug.core.types import Body, Camera, CameraView, Episode, Robot, Scene
from rpaug.gaussians.gaussians import LiftedImage, joined, lifted

TABLE, SHEET = 3, 9
SIZE = 48
EYES = {"above": ((0.0, 0.0, 1.0), 0.0), "aside": ((0.35, 0.0, 0.95), 0.35)}


def height(x: np.ndarray, t: int) -> np.ndarray:
    """Of the sheet over the table, metres."""
    return 0.14 + 0.05 * np.sin(9.0 * x + 0.6 * t)


def cast(camera: Camera, t: int, only: str | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth, handles and colors of one image."""
    rays = geometry.unproject(np.ones((SIZE, SIZE)), camera.K) @ camera.cam_to_world[t, :3, :3].T
    eye = camera.cam_to_world[t, :3, 3]
    depth = (0.12 - eye[2]) / rays[..., 2]
    for _ in range(40):
        x = eye[0] + depth * rays[..., 0]
        depth = 0.5 * depth + 0.5 * (height(x, t) - eye[2]) / rays[..., 2]
    x, y = eye[0] + depth * rays[..., 0], eye[1] + depth * rays[..., 1]
    on = (np.abs(x) < 0.16) & (np.abs(y) < 0.14) & (only is None)
    flat = -eye[2] / rays[..., 2]
    u, v = eye[0] + flat * rays[..., 0], eye[1] + flat * rays[..., 1]
    wood = 0.5 + 0.1 * np.sin(20 * u) + 0.1 * np.cos(17 * v)
    cloth = 0.5 + 0.4 * np.sin(50 * x) * np.cos(35 * y)
    rgb = np.where(
        on[..., None], cloth[..., None] * [1.0, 0.5, 0.9], wood[..., None] * [0.9, 0.8, 0.4]
    )
    ids = np.where(on, SHEET, TABLE).astype(np.int32)
    return np.where(on, depth, flat).astype(np.float32), ids, (255 * rgb).astype(np.uint8)


def scene(
    length: int = 9,
    *,
    eyes: tuple[str, ...] = ("above", "aside"),
    shown_to: str | None = None,
    scale: float = 1.0,
    shift: float = 0.0,
) -> Scene:
    """The world scaled and shifted, with rigid Gaussians of its first frame; `shown_to` one camera only."""
    K = np.array([[60.0, 0, SIZE / 2], [0, 60.0, SIZE / 2], [0, 0, 1.0]])
    views = {}
    for name in eyes:
        at, lean = EYES[name]
        pose = geometry.rigid(np.array([0.0, -lean, 0.0]), np.array(at)) @ np.diag([1.0, -1, -1, 1])
        inside = Camera(K, np.tile(pose, (length, 1, 1)), SIZE, SIZE)
        hidden = "hidden" if shown_to not in (None, name) else None
        seen = [cast(inside, t, hidden) for t in range(length)]
        outside = inside.cam_to_world.copy()
        outside[:, :3, 3] = scale * outside[:, :3, 3] + shift
        views[name] = CameraView(
            Camera(K, outside, SIZE, SIZE),
            lambda t, seen=seen: seen[t][2],
            lambda t, seen=seen: np.float32(scale) * seen[t][0],
            lambda t, seen=seen: seen[t][1],
        )
    rest = np.zeros((length, 7))
    robot = Robot(rest, rest, np.tile(np.eye(4), (length, 1, 1)), np.ones(length))
    episode = Episode("waves", views, robot, ("wave",), length)
    still = np.tile(np.eye(4), (length, 1, 1))
    bodies = (Body(frozenset([TABLE]), still, "static"), Body(frozenset([SHEET]), still, "unknown"))
    parts = [
        lifted(
            LiftedImage(v.rgb(0), v.depth(0), v.ids(0), K, v.camera.cam_to_world[0], v.depth(0) > 0)
        )
        for v in views.values()
    ]
    table = lifted(LiftedImage(*(a[0] for a in _table(views, K, scale, shift, length))))
    cameras = {name: view.camera for name, view in views.items()}
    return Scene(episode, cameras, bodies, {}, False, ("wave",), gaussians=joined([*parts, table]))


def _table(views, K, scale, shift, length):
    """The bare table from above, as a fixed camera's plate would show it."""
    at, lean = EYES["above"]
    pose = geometry.rigid(np.array([0.0, -lean, 0.0]), np.array(at)) @ np.diag([1.0, -1, -1, 1])
    depth, ids, rgb = cast(Camera(K, pose[None], SIZE, SIZE), 0, "bare")
    pose[:3, 3] = scale * pose[:3, 3] + shift
    return [[rgb], [np.float32(scale) * depth], [ids], [K], [pose], [depth > 0]]
