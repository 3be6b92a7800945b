"""The space that moves through: what the robot and what it carries may fill at any time, told by lines of sight.

What moves may be anywhere behind its own picture, as deep as an arm is thick, and fingers anywhere around the
gripper's recorded tip. A camera that sees past a point at that time clears the point. What no camera sees past, as
undersides, counts as filled; the rest is free, however near to the arm it is.
"""

import cv2
import numpy as np
from jaxtyping import Float, Float32, Float64

from rpaug.core import geometry, sampling
from rpaug.core.jit import kernel
from rpaug.core.types import Episode, Scene
from rpaug.scene.placement.free_space import CELL, MARGIN, FreeSpace, cells_of, disc
from rpaug.scene.sampled_frames import frames_to_look_at

FRAMES = 128  # looked at
THICK = 0.2  # metres: a robot's hand seen from its narrow side is no deeper than this
FINGERS = 0.06  # metres around the gripper's tip, and below it, in which fingers may be
STEP = 0.02  # metres between the heights looked at
HIGHEST = 0.5  # metres over the support up to which lines of sight are followed
CLEAR = 0.005  # metres between a point and what was seen behind it, at least
STRIDE, SIDE = (
    0.015,
    0.1,
)  # metres: how far a hand goes between frames, and from its tip to its side
RIM = np.ones((3, 3), np.uint8)  # a picture is taken one pixel wider than it was seen


def lowest(room: FreeSpace, scene: Scene, gone: frozenset[int]) -> Float32[np.ndarray, "r c"]:
    """Metres above the support from which what moves ever fills a cell, inf where it never does.

    The robot and all that is not static count, but for the instance ids in `gone`, at so many `FRAMES` at most.
    """
    moving = {h for body in scene.tracked if body.motion != "static" for h in body.instance_ids}
    moving = (moving | scene.roles.get("robot", frozenset())) - gone
    found = np.full(room.seen.shape, np.inf, np.float32)
    poses = scene.episode.robot.gripper_to_world
    tips = np.zeros((0, 3)) if poses is None else poses[:, :3, 3]
    _lower(found, room, tips)
    cameras = [view.camera for view in scene.episode.views.values()]
    K = np.stack([camera.K for camera in cameras])
    matters = cv2.dilate(room.seen.astype(np.uint8), disc(MARGIN)) > 0
    for t in _frames(scene.episode) if moving else ():
        depth, front = _pictures(scene, list(moving), t)
        to_world = np.stack([camera.cam_to_world[t] for camera in cameras])
        points = np.concatenate([*map(_lifted, front, K, to_world), tips[t : t + 1]])
        points = points[points[:, 2] < room.level + HIGHEST + THICK]
        _lower(found, room, points)
        cells = np.argwhere(matters & room.near(points, THICK))
        rim = np.stack([cv2.erode(one, RIM) for one in front])
        at = np.append(room.origin, room.level)
        projection = K @ geometry.inverse(to_world)[:, :3]
        _fill(found, cells, at, tips[t : t + 1], depth, rim, projection)
    return found


def _frames(episode: Episode) -> list[int]:
    """Frames spread evenly, and those by which the gripper's tip or side went on by `STRIDE`; at most `FRAMES`."""
    chosen, poses = set(frames_to_look_at(episode).tolist()), episode.robot.gripper_to_world
    if poses is not None:
        held = poses[:, :3, 3], poses[:, :3, 3] + SIDE * poses[:, :3, 1]
        last = 0
        for t in range(episode.length):
            if max(np.linalg.norm(points[t] - points[last]) for points in held) > STRIDE:
                chosen.add(t)
                last = t
    every = sorted(chosen)
    return [every[k] for k in sampling.frames(len(every), FRAMES)]


def _pictures(
    scene: Scene, moving: list[int], t: int
) -> tuple[Float32[np.ndarray, "n h w"], Float32[np.ndarray, "n h w"]]:
    """Depth in all cameras, padded with 0 to one size, and the same of what moves alone, inf where that is not."""
    views = scene.episode.views.values()
    high, wide = (max(getattr(v.camera, side) for v in views) for side in ("height", "width"))
    depth = np.zeros((len(views), high, wide), np.float32)
    front = np.full(depth.shape, np.inf, np.float32)
    for n, view in enumerate(views):
        assert view.depth is not None
        assert view.ids is not None
        seen = np.nan_to_num(view.depth(t), posinf=np.inf)
        use = np.isin(view.ids(t), moving) & (seen > 0)
        at = np.s_[n, : seen.shape[0], : seen.shape[1]]
        depth[at], front[at] = seen, np.where(use, seen, np.float32(np.inf))
    return depth, front


def _lifted(
    depth: Float32[np.ndarray, "h w"],
    K: Float64[np.ndarray, "3 3"],
    to_world: Float64[np.ndarray, "4 4"],
) -> Float64[np.ndarray, "n 3"]:
    """World points of the pixels that have a finite depth."""
    rows, columns = np.nonzero(np.isfinite(depth))
    local = geometry.lifted(columns, rows, depth[rows, columns].astype(np.float64), K)
    return geometry.transform(to_world, local)


def _lower(
    heights: Float32[np.ndarray, "r c"], room: FreeSpace, points: Float[np.ndarray, "n 3"]
) -> None:
    """Bring the heights of cells down to those of points above them."""
    rows, columns, inside = cells_of(points, room.origin, heights.shape)
    over = (points[inside, 2] - room.level).astype(np.float32)
    np.minimum.at(heights, (rows[inside], columns[inside]), over)


@kernel
def _fill(heights, cells, origin, tips, depth, front, projection):
    """Bring the heights of cells down to the lowest point there that may be filled at one time.

    `origin` is (x, y, z) of cell (0, 0) on the support; `tips` holds the gripper's tip or nothing; `projection`
    (cameras, 3, 4) takes world points to pixels times depth.
    """
    cameras, high, wide = depth.shape
    foot = np.zeros((cameras, 3))
    for n in range(len(cells)):
        row, column = cells[n]
        x, y = origin[0] + CELL * column, origin[1] + CELL * row
        by_tip = len(tips) > 0 and (x - tips[0, 0]) ** 2 + (y - tips[0, 1]) ** 2 < FINGERS**2
        for c in range(cameras):
            for i in range(3):
                P = projection[c, i]
                foot[c, i] = P[0] * x + P[1] * y + P[2] * origin[2] + P[3]
        over = STEP
        while over <= HIGHEST and over - STEP < heights[row, column]:
            filled = by_tip and origin[2] + over > tips[0, 2] - FINGERS
            for c in range(cameras):
                away = foot[c, 2] + projection[c, 2, 2] * over
                if away <= 0:
                    continue
                u = int(np.floor((foot[c, 0] + projection[c, 0, 2] * over) / away + 0.5))
                v = int(np.floor((foot[c, 1] + projection[c, 1, 2] * over) / away + 0.5))
                if u < 0 or v < 0 or u >= wide or v >= high:
                    continue
                if front[c, v, u] < away + CLEAR:
                    filled |= away < front[c, v, u] + THICK
                elif depth[c, v, u] > away + CLEAR:
                    filled = False
                    break
            if filled:
                heights[row, column] = over - STEP
                break
            over += STEP
