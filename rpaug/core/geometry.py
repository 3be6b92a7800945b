"""Rigid motions, and the pinhole camera with pixel centres at integer coordinates.

`rpaug.geometry` to whoever writes an adapter or an operator, who may rely on the names in `__all__`. Lengths are in
metres, angles in radians, quaternions (x, y, z, w); a motion is a 4x4 matrix: `cam_to_world` takes points of the
camera's frame (x right, y down, z along the view) to the world.
"""

import numpy as np
from jaxtyping import Float

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


def unproject(
    depth: Float[np.ndarray, "h w"], K: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "h w 3"]:
    """Each pixel's point in the camera's frame, in metres."""
    rows, columns = np.mgrid[: depth.shape[0], : depth.shape[1]]
    return np.stack(
        [(columns - K[0, 2]) / K[0, 0] * depth, (rows - K[1, 2]) / K[1, 1] * depth, depth], -1
    )


def world_points(
    depth: Float[np.ndarray, "h w"], camera: Camera, t: int
) -> Float[np.ndarray, "h w 3"]:
    """Each pixel's point in the world, in metres, of frame t."""
    return transform(camera.cam_to_world[t], unproject(depth, camera.K))


def project(
    points: Float[np.ndarray, "*n 3"], camera: Camera, t: int
) -> tuple[Float[np.ndarray, "*n 2"], Float[np.ndarray, "*n"]]:
    """Pixel coordinates (column, row) and depth of world points; only depth > 0 means anything."""
    local = transform(inverse(camera.cam_to_world[t]), points)
    z = local[..., 2]
    safe = np.where(np.abs(z) < 1e-12, 1e-12, z)
    u = camera.K[0, 0] * local[..., 0] / safe + camera.K[0, 2]
    v = camera.K[1, 1] * local[..., 1] / safe + camera.K[1, 2]
    return np.stack([u, v], -1), z
