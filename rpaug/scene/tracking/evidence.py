"""How well a supposed motion explains what two frames show of one instance, pixel against pixel.

Points seen in one frame are moved as supposed and looked up in the other frame's images. Where the same
instance is there, the distance to its plane counts (point-to-plane, Chen and Medioni 1992). Where the camera
looks straight through the place, the depth of that gap counts: silhouettes settle what planes leave open.
Where something nearer hides the place, nothing counts.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Float64, Int

from rpaug.core.jit import kernel
from rpaug.scene.sampled_frames import FacingFrames

TRUST = 0.2  # weight of a moving camera's point
CAP = 0.02  # metres: a point that is further off says no more than that the motion is wrong
SLACK = 0.004  # metres: what moving cameras are off by themselves (a pixel at half a metre)
FOOTPRINTS = (
    1.5  # pixels: what lies further behind by less may be the rounding of a grazing surface
)
ENOUGH = 12  # points: fewer say nothing
SAMPLES = 256  # points per instance, frame and kind of camera


@dataclass(frozen=True)
class Samples:
    """Points of each instance in each looked-at frame, drawn evenly.

    `of(s, i)` are those of instance id number i in frame number s: from fixed cameras, then from moving ones.
    """

    points: tuple[Float64[np.ndarray, "m 3"], ...]
    offsets: tuple[Int[np.ndarray, "n 3"], ...]
    counts: Int[np.ndarray, "s n 2"]

    def of(self, s: int, i: int) -> tuple[Float64[np.ndarray, "k 3"], int]:
        """World points, and how many of them come from fixed cameras."""
        first, middle, last = self.offsets[s][i]
        return self.points[s][first:last], int(middle - first)


def draw(sampled: FacingFrames, instance_ids: Int[np.ndarray, "n"], most: int = SAMPLES) -> Samples:
    """At most `most` points per instance, frame and kind of camera (fixed, moving)."""
    points, offsets, counts = [], [], []
    for s in range(len(sampled.frames)):
        p, o, n = _draw(
            sampled.points[s], sampled.depth[s], sampled.ids[s], sampled.fixed, instance_ids, most
        )
        # A point that another camera contradicts in the very same frame is a grazing or half-hidden one.
        good = ~_contradicted(p, *_frame(sampled, s), np.repeat(instance_ids, o[:, 2] - o[:, 0]))
        points.append(p[good])
        offsets.append(np.concatenate([[0], np.cumsum(good)])[o])
        counts.append(n)
    return Samples(
        tuple(points), tuple(offsets), np.array(counts).reshape(-1, len(instance_ids), 2)
    )


def judge(
    points: Float64[np.ndarray, "k 3"],
    still: int,
    motions: Float64[np.ndarray, "m 4 4"],
    sampled: FacingFrames,
    s: int,
    instance_id: int,
) -> Float64[np.ndarray, "m 2 2"]:
    """Summed distance in metres and number of points, per motion and kind of camera pair (fixed, other).

    `motions` carry `points`, the first `still` of which were seen by fixed cameras, to frame number s.
    """
    out = np.zeros((len(motions), 2, 2))
    _judge(points, still, motions, *_frame(sampled, s), instance_id, out)
    return out


def distances(
    points: Float64[np.ndarray, "k 3"],
    motion: Float64[np.ndarray, "4 4"],
    sampled: FacingFrames,
    s: int,
    instance_id: int,
) -> tuple[Float64[np.ndarray, "k"], Float64[np.ndarray, "k 3"], Float64[np.ndarray, "k 3"]]:
    """Signed point-to-plane distance of each moved point, the moved points, and the planes' normals.

    A distance is NaN where the instance is not seen at that place in frame number s.
    """
    off, normals = np.full(len(points), np.nan), np.zeros((len(points), 3))
    moved = points @ motion[:3, :3].T + motion[:3, 3]
    _associate(moved, *_frame(sampled, s), instance_id, off, normals)
    return off, moved, normals


def mean(
    judged: Float64[np.ndarray, "*m 2 2"],
) -> tuple[Float64[np.ndarray, "*m"], Float[np.ndarray, "*m"]]:
    """Mean distance in metres and the number of points it rests on.

    A point that a moving camera has to do with counts TRUST, and only for what exceeds SLACK.
    """
    total, count = judged[..., 0], judged[..., 1] * np.array([1.0, TRUST])
    average = total / np.maximum(judged[..., 1], 1)
    average[..., 1] = np.maximum(average[..., 1] - SLACK, 0.0)
    number = count.sum(-1)
    return (average * count).sum(-1) / np.maximum(number, 1e-9), np.where(
        number >= ENOUGH, number, 0
    )


def _frame(sampled: FacingFrames, s: int) -> Any:
    return (
        sampled.fixed, sampled.K, sampled.cam_to_world[s], sampled.depth[s], sampled.ids[s], sampled.points[s],
        sampled.normals[s],
    )  # fmt: skip


@kernel
def _draw(points, depth, ids, fixed, instance_ids, most):
    cameras, height, width = ids.shape
    counts = np.zeros((len(instance_ids), 2), np.int64)
    where = np.full(ids.shape, -1, np.int32)
    for c in range(cameras):
        kind = 0 if fixed[c] else 1
        for r in range(height):
            for k in range(width):
                if depth[c, r, k] <= 0 or ids[c, r, k] <= 0:
                    continue
                if k > 0 and ids[c, r, k] == ids[c, r, k - 1] and where[c, r, k - 1] >= 0:
                    i = where[c, r, k - 1]
                else:
                    i = np.searchsorted(instance_ids, ids[c, r, k])
                    if i == len(instance_ids) or instance_ids[i] != ids[c, r, k]:
                        continue
                where[c, r, k] = i
                counts[i, kind] += 1
    strides = (counts + most - 1) // most
    taken = np.where(counts > 0, (counts + strides - 1) // np.maximum(strides, 1), 0)
    offsets = np.zeros((len(instance_ids), 3), np.int64)
    total = 0
    for i in range(len(instance_ids)):
        offsets[i] = total, total + taken[i, 0], total + taken[i, 0] + taken[i, 1]
        total = offsets[i, 2]
    out = np.zeros((total, 3))
    seen = np.zeros((len(instance_ids), 2), np.int64)
    for c in range(cameras):
        kind = 0 if fixed[c] else 1
        for r in range(height):
            for k in range(width):
                i = where[c, r, k]
                if i >= 0:
                    n = seen[i, kind]
                    seen[i, kind] += 1
                    if n % strides[i, kind] == 0:
                        out[offsets[i, kind] + n // strides[i, kind]] = points[c, r, k]
    return out, offsets, counts


@kernel
def _pixel(p, K, pose, height, width):
    """Row, column and depth of a world point; row -1 if it is outside the image."""
    d0, d1, d2 = p[0] - pose[0, 3], p[1] - pose[1, 3], p[2] - pose[2, 3]
    z = pose[0, 2] * d0 + pose[1, 2] * d1 + pose[2, 2] * d2
    if z <= 1e-3:
        return -1, -1, z
    x = pose[0, 0] * d0 + pose[1, 0] * d1 + pose[2, 0] * d2
    y = pose[0, 1] * d0 + pose[1, 1] * d1 + pose[2, 1] * d2
    column = int(np.floor(K[0, 0] * x / z + K[0, 2] + 0.5))
    row = int(np.floor(K[1, 1] * y / z + K[1, 2] + 0.5))
    if row < 0 or row >= height or column < 0 or column >= width:
        return -1, -1, z
    return row, column, z


@kernel
def _plane(p, z, point, normal, depth):
    """Signed distance of p to the plane seen at a pixel; along the view where the pixel has no plane."""
    if normal[0] == 0 and normal[1] == 0 and normal[2] == 0:
        return z - depth
    return (
        (p[0] - point[0]) * normal[0]
        + (p[1] - point[1]) * normal[1]
        + (p[2] - point[2]) * normal[2]
    )


@kernel
def _judge(points, still, motions, fixed, K, poses, depth, ids, at, normals, instance_id, out):
    cameras, height, width = ids.shape
    p = np.zeros(3)
    for m in range(len(motions)):
        M = motions[m]
        for j in range(len(points)):
            for i in range(3):
                p[i] = M[i, 3] + (
                    M[i, 0] * points[j, 0] + M[i, 1] * points[j, 1] + M[i, 2] * points[j, 2]
                )
            for c in range(cameras):
                row, column, z = _pixel(p, K[c], poses[c], height, width)
                if row < 0 or depth[c, row, column] <= 0:
                    continue
                kind = 0 if fixed[c] and j < still else 1
                seen = depth[c, row, column]
                if ids[c, row, column] == instance_id:
                    off = abs(_plane(p, z, at[c, row, column], normals[c, row, column], seen))
                    if off > CAP and z > seen + CAP:
                        continue  # hidden behind its own front
                    off = min(off, CAP)
                else:
                    off = seen - z - FOOTPRINTS * z / K[c, 0, 0]
                    if off < CAP / 4 or _beside(ids[c], row, column, instance_id):
                        continue  # hidden, touching, or the rounding of an outline
                    off = min(off, CAP)
                out[m, kind, 0] += off
                out[m, kind, 1] += 1


@kernel
def _contradicted(points, fixed, K, poses, depth, ids, at, normals, instance_ids):
    """Does a camera look straight through the place of a point?"""
    cameras, height, width = ids.shape
    out = np.zeros(len(points), np.bool_)
    for j in range(len(points)):
        for c in range(cameras):
            row, column, z = _pixel(points[j], K[c], poses[c], height, width)
            if row >= 0 and depth[c, row, column] > 0 and ids[c, row, column] != instance_ids[j]:
                off = depth[c, row, column] - z - FOOTPRINTS * z / K[c, 0, 0]
                out[j] |= off >= CAP / 4 and not _beside(ids[c], row, column, instance_ids[j])
    return out


@kernel
def _beside(ids, row, column, instance_id):
    height, width = ids.shape
    for r in range(max(row - 1, 0), min(row + 2, height)):
        for c in range(max(column - 1, 0), min(column + 2, width)):
            if ids[r, c] == instance_id:
                return True
    return False


@kernel
def _associate(points, fixed, K, poses, depth, ids, at, normals, instance_id, off, planes):
    """The nearest plane of the instance over all cameras, fixed ones first."""
    cameras, height, width = ids.shape
    for j in range(len(points)):
        for kind in range(2):
            for c in range(cameras):
                if fixed[c] != (kind == 0):
                    continue
                row, column, z = _pixel(points[j], K[c], poses[c], height, width)
                if row < 0 or depth[c, row, column] <= 0 or ids[c, row, column] != instance_id:
                    continue
                n = normals[c, row, column]
                if n[0] == 0 and n[1] == 0 and n[2] == 0:
                    continue
                if z > depth[c, row, column] + CAP:
                    continue  # hidden behind its own front
                d = _plane(points[j], z, at[c, row, column], n, depth[c, row, column])
                if np.isnan(off[j]) or abs(d) < abs(off[j]):
                    off[j] = d
                    planes[j] = n
            if not np.isnan(off[j]):
                break
