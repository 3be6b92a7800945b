"""A stage for a camera without depth: a level support seen at an angle, a floor below it and a wall behind.

Edits need something to lie and to stand on. Where a source gives the camera's pose, the support is the world's plane
z = 0; else the camera is put at a usual angle and distance, which is an assumption, and said to be one. Nothing is
measured by the stage and nothing of it is written.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64

from rpaug.core import geometry
from rpaug.core.types import Camera

TILT = np.deg2rad(45.0)  # that an unplaced camera is taken to look down by
DISTANCE = 0.75  # metres from it to the middle of what it sees of the support
FLOOR = 0.75  # metres: the floor lies so far below the support
BEHIND = 0.5  # metres: the wall stands so far behind the support's far end
FARTHEST = 20.0  # metres


@dataclass(frozen=True)
class GroundPlane:
    """A camera in a world whose support is z = 0, and the depth of its pixels in metres, 0 where nothing is known."""

    camera: Camera
    depth: Float32[np.ndarray, "h w"]


def of(
    camera: Camera, support: Bool[np.ndarray, "h w"], around: Bool[np.ndarray, "h w"]
) -> GroundPlane:
    """The stage that a fixed camera looks at; pixels `around` show floor and wall, others the support's plane."""
    placed = camera if camera.placed else _put(camera, support)
    pose = placed.cam_to_world[0]
    rays = rays_of(placed) @ pose[:3, :3].T
    plane = _until(rays[..., 2], -pose[2, 3])
    floor = _until(rays[..., 2], -FLOOR - pose[2, 3])
    ahead = pose[:2, 2] / max(float(np.linalg.norm(pose[:2, 2])), 1e-6)
    wall = np.full(plane.shape, np.inf)
    if np.linalg.norm(pose[:2, 2]) > 1e-3:
        along = rays[..., :2] @ ahead
        known = support & np.isfinite(plane)
        far = float(np.quantile((plane * along)[known], 0.98)) if known.any() else DISTANCE
        wall = _until(-along, -(far + BEHIND))
    depth = np.where(around, np.minimum(floor, wall), np.minimum(plane, wall))
    depth = np.where(np.isfinite(depth) & (depth < FARTHEST), depth, FARTHEST)
    return GroundPlane(placed, depth.astype(np.float32))


def on(
    camera: Camera, support: Bool[np.ndarray, "h w"], depth: Float32[np.ndarray, "h w"]
) -> GroundPlane:
    """The stage of a camera whose depth a model gave: the plane fitted to the support's pixels becomes z = 0."""
    if camera.placed:
        return GroundPlane(camera, depth)
    points = (rays_of(camera) * depth[..., None])[support if support.any() else depth > 0]
    middle = np.median(points, 0)
    points = points - middle
    near = np.linalg.norm(points, axis=1) < 3 * np.median(np.linalg.norm(points, axis=1)) + 1e-9
    up = np.linalg.svd(points[near] - points[near].mean(0), full_matrices=False)[2][2]
    up = -up if up @ middle > 0 else up
    ahead = np.array([0.0, 0.0, 1.0]) - up[2] * up
    ahead = ahead if np.linalg.norm(ahead) > 1e-3 else np.array([0.0, -1.0, 0.0])
    ahead = ahead / np.linalg.norm(ahead)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([ahead, np.cross(up, ahead), up])
    pose[:3, 3] = -pose[:3, :3] @ middle
    track = np.tile(pose, (len(camera.cam_to_world), 1, 1))
    return GroundPlane(replace(camera, cam_to_world=track), depth)


def rays_of(camera: Camera) -> Float64[np.ndarray, "h w 3"]:
    """Directions of pixels in the camera's frame, one metre deep."""
    down, right = np.mgrid[0 : camera.height, 0 : camera.width].astype(float)
    return geometry.rays(right, down, camera.K)


def _until(fall: Float64[np.ndarray, "h w"], drop: float) -> Float64[np.ndarray, "h w"]:
    """Depth at which rays that fall by `fall` a metre have fallen by `drop`; inf where they never do."""
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = drop / fall
    return np.where(np.isfinite(depth) & (depth > 0), depth, np.inf)


def _put(camera: Camera, support: Bool[np.ndarray, "h w"]) -> Camera:
    """The camera above the support's middle, which becomes the world's origin; x points ahead of it."""
    pose = np.eye(4)
    cosine, sine = np.cos(TILT), np.sin(TILT)
    pose[:3, :3] = np.stack([[0, -1, 0], [-sine, 0, -cosine], [cosine, 0, -sine]], 1)
    rays = rays_of(camera)
    middle = np.median(rays[support], 0) if support.any() else np.array([0.0, 0.0, 1.0])
    towards = pose[:3, :3] @ (middle / np.linalg.norm(middle))
    pose[:3, 3] = -DISTANCE * towards
    if towards[2] > -0.1:  # a support above the horizon: the camera looks straight at its middle
        pose[:3, 3] = -DISTANCE * pose[:3, 2]
    track = np.tile(pose, (len(camera.cam_to_world), 1, 1))
    return replace(camera, cam_to_world=track)


def seen_at(
    camera: Camera, points: Float64[np.ndarray, "n 3"], mask: Bool[np.ndarray, "h w"]
) -> tuple[Bool[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
    """Whether world points fall on a pixel of the mask, and whether they fall into the image at all."""
    local = geometry.local_points(points, camera, 0)
    row, column, inside = geometry.in_image(local, camera.K, mask.shape, near=1e-3)
    return inside & mask[row, column], inside
