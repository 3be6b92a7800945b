"""Where on a stage's support there is room, told by lines of sight.

What moves may be anywhere along the lines of sight on which a camera sees it. A thing is put only where none of these
passes through it: then nothing that moves is ever seen before or behind it, and no order has to be guessed. Where a
model gave depth it is near that depth, as far as that may be off, and the order is told by it.
"""

import numpy as np
from jaxtyping import Bool, Float32, Float64

from rpaug.core import geometry, sampling
from rpaug.core.errors import SourceLacks, TargetError
from rpaug.core.types import Camera, CameraView, Scene
from rpaug.scene.instances.ground_plane import rays_of, seen_at
from rpaug.scene.placement.free_space import CELL, FreeSpace
from rpaug.scene.placement.swept import THICK

Mask = Bool[np.ndarray, "h w"]
Reach = Float32[np.ndarray, "h w"]

SWEEPS = 64  # frames looked at for what moves
HIGHEST = 0.3  # metres over the support up to which lines of sight are followed
STEP = 0.01
FARTHEST = 1.5  # metres around the middle of the support
SURE = 3.0  # deviations of a model's depth within which what moves is


def find_free_space(scene: Scene, leaving: frozenset[int]) -> FreeSpace:
    """The room on the support. Raises SourceLacks where cameras' places are not known to one another."""
    views = together(scene, "a new thing")
    support = scene.roles.get("table", frozenset())
    covered = {
        name: _ever(scene, view, frozenset(support | leaving)) for name, view in views.items()
    }
    flat = np.concatenate([_hits(view, covered[name][0]) for name, view in views.items()])
    if not len(flat):
        raise TargetError("the table was never seen, so there is nowhere to put things")
    low = np.maximum(flat.min(0), np.median(flat, 0) - FARTHEST)
    high = np.minimum(flat.max(0), np.median(flat, 0) + FARTHEST)
    columns, rows = np.ceil((high - low) / CELL).astype(int) + 1
    shape = int(rows), int(columns)
    at = low + CELL * np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2)
    seen = np.zeros(len(at), bool)
    still = np.full(len(at), np.inf, np.float32)
    swept = np.full(len(at), np.inf, np.float32)
    for name, view in views.items():
        free, thing, near, far = covered[name]
        foot = np.column_stack([at, np.zeros(len(at))])
        seen |= seen_at(view.camera, foot, free)[0]
        still[seen_at(view.camera, foot, thing)[0]] = 0.0
        for height in np.arange(HIGHEST, -STEP / 2, -STEP):
            over = np.column_stack([at, np.full(len(at), height)])
            # What leaves the image may leave the thing's picture cut off, which is as it should be.
            swept[_between(view.camera, over, near, far)] = height
    return FreeSpace(low, 0.0, seen.reshape(shape), still.reshape(shape), swept.reshape(shape))


def together(scene: Scene, what: str) -> dict[str, CameraView]:
    """The cameras that can show a thing in one world. Raises SourceLacks, saying `what` they cannot share."""
    able = {}
    for name, view in scene.episode.views.items():
        proxy = view.proxy
        if proxy is None or proxy.depth is not None:
            able[name] = view
        elif not proxy.blank:
            raise SourceLacks(
                f"{name} moves, and nothing says where it is: give its depth and poses in cameras.yaml, "
                f"or leave it out there (views: [...])"
            )
    lost = [n for n, v in able.items() if v.proxy is not None and not v.proxy.camera.placed]
    if len(able) > 1 and lost:
        raise SourceLacks(
            f"nothing says where {', '.join(lost)} stand to one another, so {what} could not be shown in all "
            f"of them alike: give cam_to_world for each in cameras.yaml (z up, the support at z = 0), or name the "
            f"one camera to edit there (views: [{lost[0]}])"
        )
    return able


def _ever(
    scene: Scene, view: CameraView, support: frozenset[int]
) -> tuple[Mask, Mask, Reach, Reach]:
    """Pixels that show the support in most frames, those that show a thing, and from what to what depth something that
    moves may ever be on each one's line of sight."""
    assert view.ids is not None
    unsteady = [h for body in scene.tracked if body.motion != "static" for h in body.instance_ids]
    around = scene.roles.get("background", frozenset())
    times = sampling.frames(scene.episode.length, SWEEPS)
    free = np.zeros((view.camera.height, view.camera.width))
    thing = np.zeros(free.shape, bool)
    near, far = np.full(free.shape, np.inf, np.float32), np.full(free.shape, -np.inf, np.float32)
    for t in times:
        ids = view.ids(t)
        free += np.isin(ids, list(support))
        thing |= ~np.isin(ids, [*support, *around, *unsteady, 0])
        moving = np.isin(ids, unsteady)
        first, last = _depths(view, t)
        near = np.where(moving, np.minimum(near, first), near)
        far = np.where(moving, np.maximum(far, last), far)
    return free > len(times) / 2, thing, near, far


def _depths(view: CameraView, t: int) -> tuple[Reach | np.float32, Reach | np.float32]:
    """From where to where what is seen may be: anywhere, or where a model puts its front and as far behind as an arm is
    thick."""
    if view.depth is None or view.proxy is None:
        return np.float32(0), np.float32(np.inf)
    depth, off = view.depth(t), SURE * view.proxy.spread
    return depth - np.float32(off), depth + np.float32(THICK + off)


def _between(
    camera: Camera, points: Float64[np.ndarray, "n 3"], near: Reach, far: Reach
) -> Bool[np.ndarray, "n"]:
    """Whether world points lie between two depths of the pixels that they fall on."""
    local = geometry.local_points(points, camera, 0)
    row, column, inside = geometry.in_image(local, camera.K, near.shape, near=1e-3)
    away = local[:, 2]
    return inside & (away >= near[row, column]) & (away <= far[row, column])


def _hits(view: CameraView, mask: Bool[np.ndarray, "h w"]) -> Float64[np.ndarray, "n 2"]:
    """Where lines of sight through the pixels meet the support."""
    camera: Camera = view.camera
    rays = rays_of(camera)[mask] @ camera.cam_to_world[0, :3, :3].T
    falling = rays[:, 2] < -1e-3
    depth = -camera.cam_to_world[0, 2, 3] / rays[falling, 2]
    local = rays_of(camera)[mask][falling] * depth[:, None]
    return geometry.transform(camera.cam_to_world[0], local)[:, :2]
