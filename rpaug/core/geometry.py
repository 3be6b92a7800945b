"""Rigid motions, and the pinhole camera with pixel centres at integer coordinates.

`rpaug.geometry` to whoever writes an adapter or an operator, who may rely on the names in `__all__`. Lengths are in
metres, angles in radians, quaternions (x, y, z, w); a motion is a 4x4 matrix: `cam_to_world` takes points of the
camera's frame (x right, y down, z along the view) to the world.
"""

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Real

from rpaug.core.types import Camera

__all__ = [
    "inverse",
    "pose_of",
    "project",
    "quaternion_of",
    "rigid",
    "rotation",
    "transform",
    "unproject",
    "world_points",
]


def rotation(turn: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Rotation matrix of a rotation vector in radians (Rodrigues' formula)."""
    angle = float(np.linalg.norm(turn))
    x, y, z = np.asarray(turn, float)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-8:
        return np.eye(3) + cross  # exact to second order, without 0 / 0
    return (
        np.eye(3)
        + np.sin(angle) / angle * cross
        + (1.0 - np.cos(angle)) / angle**2 * (cross @ cross)
    )


def rigid(turn: Float[np.ndarray, "3"], shift: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """The motion p -> R p + shift, R from a rotation vector in radians, shift in metres."""
    motion = np.eye(4)
    motion[:3, :3] = rotation(turn)
    motion[:3, 3] = shift
    return motion


def pose_of(
    position: Float[np.ndarray, "*n 3"], xyzw: Float[np.ndarray, "*n 4"]
) -> Float[np.ndarray, "*n 4 4"]:
    """Rigid motions from positions in metres and quaternions (x, y, z, w) of any length but zero."""
    x, y, z, w = np.moveaxis(xyzw / np.linalg.norm(xyzw, axis=-1, keepdims=True), -1, 0)
    pose = np.zeros((*x.shape, 4, 4))
    pose[..., 0, :3] = np.stack(
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1
    )
    pose[..., 1, :3] = np.stack(
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1
    )
    pose[..., 2, :3] = np.stack(
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1
    )
    pose[..., :3, 3] = position
    pose[..., 3, 3] = 1.0
    return pose


def quaternion_of(pose: Float[np.ndarray, "*n 4 4"]) -> Float[np.ndarray, "*n 4"]:
    """Unit quaternion (x, y, z, w), w >= 0, of a rigid motion's rotation.

    The largest eigenvector of a symmetric matrix, stable for every rotation (Bar-Itzhack 2000).
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = np.moveaxis(pose[..., :3, :3], (-2, -1), (0, 1))
    rows = [
        [xx - yy - zz, yx + xy, zx + xz, zy - yz],
        [yx + xy, yy - xx - zz, zy + yz, xz - zx],
        [zx + xz, zy + yz, zz - xx - yy, yx - xy],
        [zy - yz, xz - zx, yx - xy, xx + yy + zz],
    ]
    likeness = np.moveaxis(np.array(rows), (0, 1), (-2, -1)) / 3.0
    xyzw = np.linalg.eigh(likeness)[1][..., -1]
    return xyzw * np.where(xyzw[..., 3:] < 0, -1.0, 1.0)


def inverse(pose: Float[np.ndarray, "*n 4 4"]) -> Float[np.ndarray, "*n 4 4"]:
    """Inverse of rigid motions, exact in the last row."""
    out = np.zeros_like(pose)
    back = np.swapaxes(pose[..., :3, :3], -1, -2)
    out[..., :3, :3] = back
    out[..., :3, 3] = -(back @ pose[..., :3, 3:])[..., 0]
    out[..., 3, 3] = 1.0
    return out


def transform(
    pose: Float[np.ndarray, "4 4"], points: Float[np.ndarray, "*n 3"]
) -> Float[np.ndarray, "*n 3"]:
    """Points carried by one rigid motion."""
    return points @ pose[:3, :3].T + pose[:3, 3]


def towards(
    points: Float[np.ndarray, "n 3"], eye: Float[np.ndarray, "*n 3"]
) -> Float32[np.ndarray, "n 3"]:
    """Unit vectors from points to an eye, or to each one's own."""
    ray = eye.astype(np.float32) - points
    return np.asarray(ray / np.linalg.norm(ray, axis=-1, keepdims=True), np.float32)


def slopes(
    columns: Real[np.ndarray, "*n"], rows: Real[np.ndarray, "*n"], K: Float[np.ndarray, "3 3"]
) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
    """Metres to the right and down, of each metre ahead, at which the rays of pixels run."""
    return (columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1]


def rays(
    columns: Real[np.ndarray, "*n"], rows: Real[np.ndarray, "*n"], K: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "*n 3"]:
    """Directions of pixels in the camera's frame, one metre deep."""
    x, y = slopes(columns, rows, K)
    return np.stack([x, y, np.ones_like(x)], -1)


def lifted(
    columns: Real[np.ndarray, "*n"],
    rows: Real[np.ndarray, "*n"],
    depth: Float[np.ndarray, "*n"],
    K: Float[np.ndarray, "3 3"],
) -> Float[np.ndarray, "*n 3"]:
    """Points of pixels in the camera's frame, in metres."""
    x, y = slopes(columns, rows, K)
    return np.stack([x * depth, y * depth, depth], -1)


def unproject(
    depth: Float[np.ndarray, "h w"], K: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "h w 3"]:
    """Each pixel's point in the camera's frame, in metres."""
    rows, columns = np.mgrid[: depth.shape[0], : depth.shape[1]]
    return lifted(columns, rows, depth, K)


def world_points(
    depth: Float[np.ndarray, "h w"], camera: Camera, t: int
) -> Float[np.ndarray, "h w 3"]:
    """Each pixel's point in the world, in metres, of frame t."""
    return transform(camera.cam_to_world[t], unproject(depth, camera.K))


def local_points(
    points: Float[np.ndarray, "*n 3"], camera: Camera, t: int
) -> Float[np.ndarray, "*n 3"]:
    """World points in the camera's frame, at frame t."""
    return transform(inverse(camera.cam_to_world[t]), points)


def to_image(
    local: Float[np.ndarray, "*n 3"], z: Float[np.ndarray, "*n"], K: Float[np.ndarray, "3 3"]
) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
    """Column and row of points in the camera's frame; `z` is their depth, kept from 0 by the caller."""
    return K[0, 0] * local[..., 0] / z + K[0, 2], K[1, 1] * local[..., 1] / z + K[1, 2]


def in_image(
    local: Float[np.ndarray, "*n 3"],
    K: Float[np.ndarray, "3 3"],
    shape: tuple[int, ...],
    near: float = 0.0,
) -> tuple[Int[np.ndarray, "*n"], Int[np.ndarray, "*n"], Bool[np.ndarray, "*n"]]:
    """Row and column of the pixel that each point of the camera's frame falls on, and whether it falls on any.

    The image has `shape` (h, w). Points no farther than `near` metres fall on none. Where none is hit both are 0.
    """
    ahead = local[..., 2] > near
    column, row = map(np.rint, to_image(local, np.where(ahead, local[..., 2], 1.0), K))
    inside = ahead & (row >= 0) & (column >= 0) & (row < shape[0]) & (column < shape[1])
    return np.where(inside, row, 0).astype(int), np.where(inside, column, 0).astype(int), inside


def project(
    points: Float[np.ndarray, "*n 3"], camera: Camera, t: int
) -> tuple[Float[np.ndarray, "*n 2"], Float[np.ndarray, "*n"]]:
    """Pixel coordinates (column, row) and depth of world points; only depth > 0 means anything."""
    local = local_points(points, camera, t)
    z = local[..., 2]
    return np.stack(to_image(local, np.where(np.abs(z) < 1e-12, 1e-12, z), camera.K), -1), z
