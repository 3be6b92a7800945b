"""A scene in closed form: a patterned table, a box on it, a ball that moves; exact from any camera."""

from dataclasses import replace

import numpy as np
from cast_once import cast_once

from rpaug.core.types import Body, Camera, CameraView, Episode, Robot, Scene

TABLE, BOX, BALL = 7, 0xABCDEF, 300  # one small handle, one that needs 24 bits
BOX_LOW, BOX_HIGH = np.array([-0.15, -0.1, 0.0]), np.array([0.15, 0.1, 0.25])
BALL_RADIUS = 0.12
TABLE_HALF = 0.8
EYES = {"front": (0.0, -0.8, 0.7), "side": (0.8, -0.2, 0.8), "wrist": (-0.3, -0.5, 0.8)}
LENGTH = 8


def look(eye, at) -> np.ndarray:
    """Pose of a camera at `eye` looking at `at`, +z up in the world (OpenCV axes)."""
    eye, at = np.asarray(eye, float), np.asarray(at, float)
    ahead = (at - eye) / np.linalg.norm(at - eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], 1)
    pose[:3, 3] = eye
    return pose


def pinhole(width: int = 96, height: int = 80, focal: float = 110.0) -> np.ndarray:
    return np.array([[focal, 0, width / 2 - 0.3], [0, focal * 1.05, height / 2 + 0.2], [0, 0, 1]])


def color(points: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """A smooth pattern on each thing (a period of some ten pixels), and black where nothing is."""
    x, y, z = np.moveaxis(points, -1, 0)
    wave = np.stack([np.sin(31 * x + 9 * z), np.sin(27 * y - 11 * z), np.sin(19 * (x + y + z))], -1)
    base = np.select(
        [ids == TABLE, ids == BOX, ids == BALL], [0.45, 0.6, 0.3], 0.0
    )  # fmt: skip
    return np.rint(255 * (base[..., None] + np.where(ids > 0, 0.2, 0.0)[..., None] * wave)).astype(
        np.uint8
    )


@cast_once
def shoot(K, pose, width, height, ball=None, origin=(0.0, 0.0, 0.0)):
    """Exact (rgb, depth, ids) of one view, by one ray through each pixel's centre."""
    rows, columns = np.mgrid[:height, :width]
    local = np.stack(
        [(columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1], np.ones((height, width))], -1
    )
    rays = local @ pose[:3, :3].T  # depth along a ray equals its z in the camera's frame
    eye = pose[:3, 3] - np.asarray(origin)
    with np.errstate(divide="ignore", invalid="ignore"):
        table = -eye[2] / rays[..., 2]
        low, high = (BOX_LOW - eye) / rays, (BOX_HIGH - eye) / rays
    spot = eye + np.nan_to_num(table, posinf=0.0, neginf=0.0)[..., None] * rays
    on = (np.abs(spot[..., :2]) < TABLE_HALF).all(-1) & (rays[..., 2] != 0) & (table > 0)
    table = np.where(on, table, np.inf)
    enter = np.nanmax(np.minimum(low, high), -1)
    leave = np.nanmin(np.maximum(low, high), -1)
    box = np.where((enter < leave) & (leave > 0), np.where(enter > 0, enter, leave), np.inf)
    sphere = np.full_like(table, np.inf)
    if ball is not None:
        a, b = (rays**2).sum(-1), rays @ (eye - ball)
        rest = b**2 - a * (((eye - ball) ** 2).sum() - BALL_RADIUS**2)
        with np.errstate(invalid="ignore"):
            sphere = np.where(rest > 0, (-b - np.sqrt(rest)) / a, np.inf)
        sphere = np.where(sphere > 0, sphere, np.inf)
    choices = np.stack([table, box, sphere], -1)
    depth = choices.min(-1)
    hit = np.isfinite(depth)
    ids = np.where(hit, np.array([TABLE, BOX, BALL])[choices.argmin(-1)], 0).astype(np.int32)
    depth = np.where(hit, depth, 0.0)
    rgb = color(eye + depth[..., None] * rays, ids)
    return rgb, depth.astype(np.float32), ids


def ball_at(t: int, length: int) -> np.ndarray:
    """The ball rolls across in front of the box."""
    return np.array([-0.4 + 0.8 * t / max(1, length - 1), -0.35, BALL_RADIUS])


def scene(eyes, length: int = 8, moving: str | None = None, ball: bool = True) -> Scene:
    """An episode of `length` frames seen by cameras {name: eye}, `moving` drifting 4 cm a frame."""
    robot = Robot(
        joint_positions=np.zeros((length, 7)), joint_velocities=np.zeros((length, 7)),
        gripper_to_world=np.tile(np.eye(4), (length, 1, 1)), gripper_open=np.ones(length),
    )  # fmt: skip
    views = {}
    for index, (name, eye) in enumerate(eyes.items()):
        width, height = 96 + 8 * index, 80  # no two cameras are of one size
        pose_correction = np.array([0.04, 0.0, 0.0]) if name == moving else np.zeros(3)
        track = np.stack(
            [look(np.array(eye) + t * pose_correction, (0, 0, 0.1)) for t in range(length)]
        )
        camera = Camera(K=pinhole(width, height), cam_to_world=track, width=width, height=height)

        def image(t, part, camera=camera):
            spot = ball_at(t, length) if ball else None
            return shoot(camera.K, camera.cam_to_world[t], camera.width, camera.height, spot)[part]

        views[name] = CameraView(
            camera,
            rgb=lambda t, image=image: image(t, 0),
            depth=lambda t, image=image: image(t, 1),
            ids=lambda t, image=image: image(t, 2),
        )
    still = np.tile(np.eye(4), (length, 1, 1))
    bodies = (
        Body(instance_ids=frozenset({TABLE, BOX}), to_world=still, motion="static"),
        Body(instance_ids=frozenset({BALL}), to_world=still, motion="unknown"),
    )
    return Scene(
        episode=Episode("episode0", views, robot, ("roll the ball",), length),
        cameras={name: view.camera for name, view in views.items()}, bodies=bodies, roles={},
        antialiased=False, descriptions=("roll the ball",),
    )  # fmt: skip


def tracked(plain: Scene) -> Scene:
    """The scene with its bodies as they truly move: the ball rolls in the gripper, the rest stands."""
    length = plain.episode.length
    still = np.tile(np.eye(4), (length, 1, 1))
    roll = still.copy()
    roll[:, :3, 3] = [ball_at(t, length) - ball_at(0, length) for t in range(length)]
    bodies = (
        Body(frozenset({TABLE, BOX}), still, "static"),
        Body(frozenset({BALL}), roll, "gripper"),
    )
    return replace(plain, bodies=bodies)


def seen_by(scene_, change):
    """The scene with each view's (rgb, depth, ids) at t changed by `change(name, t, rgb, depth, ids)`."""

    def altered(name, view):
        def image(t, part):
            return change(name, t, view.rgb(t).copy(), view.depth(t).copy(), view.ids(t).copy())[
                part
            ]

        return replace(
            view, rgb=lambda t: image(t, 0), depth=lambda t: image(t, 1), ids=lambda t: image(t, 2)
        )

    views = {name: altered(name, view) for name, view in scene_.episode.views.items()}
    return replace(scene_, episode=replace(scene_.episode, views=views))
