"""A few frames of an episode, decoded once: depth, instance ids and world points of every camera."""

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, Int32

from rpaug.core import memo
from rpaug.core.jit import inlined, kernel
from rpaug.core.progress import told
from rpaug.core.types import Episode

MOST_FRAMES = 32  # looked at per episode, beside the frames where the gripper opens or closes
MOST_PIXELS = 160  # wide; larger images are thinned to about this
THREADS = 2


@dataclass(frozen=True)
class SampledFrames:
    """Images of `frames` (ascending) from the cameras that have depth and instance ids, thinned to one size.

    Where a camera's image is smaller than the others it is padded: depth 0, instance id -1. `points` are world points.
    `fixed[c]` tells whether camera c stands still.
    """

    frames: Int[np.ndarray, "s"]
    cameras: tuple[str, ...]
    fixed: Bool[np.ndarray, "c"]
    K: Float64[np.ndarray, "c 3 3"]
    cam_to_world: Float64[np.ndarray, "s c 4 4"]
    depth: Float32[np.ndarray, "s c h w"]
    ids: Int32[np.ndarray, "s c h w"]
    points: Float32[np.ndarray, "s c h w 3"]

    @property
    def instance_ids(self) -> Int32[np.ndarray, "n"]:
        """Every instance id seen, ascending; 0 is not one."""
        found = np.unique(self.ids)
        return found[found > 0]

    def normals_at(
        self,
        s: Int[np.ndarray, "n"],
        c: Int[np.ndarray, "n"],
        row: Int[np.ndarray, "n"],
        column: Int[np.ndarray, "n"],
    ) -> Float32[np.ndarray, "n 3"]:
        """Unit normals in the world of the pixels at `row`, `column` of camera c's image of frame number s, from
        neighbours of the same instance id only; zero where there is none."""
        return _normals_at(self.depth, self.ids, self.points, s, c, row, column)


@dataclass(frozen=True)
class FacingFrames(SampledFrames):
    """The same with the `normals` of all pixels: as many bytes as their points, so they go with what asks for them."""

    normals: Float32[np.ndarray, "s c h w 3"]


def facing(sampled: SampledFrames) -> FacingFrames:
    """Frames with the normals of all pixels."""
    held = {field.name: getattr(sampled, field.name) for field in fields(SampledFrames)}
    return FacingFrames(**held, normals=_normals(sampled.depth, sampled.ids, sampled.points))


def events(gripper_open: Float64[np.ndarray, "t"] | None) -> Int[np.ndarray, "e"]:
    """Frames t after which the gripper starts to open or close (it differs at t + 1); none where that is unknown."""
    if gripper_open is None:
        return np.zeros(0, int)
    state = gripper_open > 0.5
    return np.flatnonzero(state[1:] != state[:-1])


def frames_to_look_at(episode: Episode, most: int = MOST_FRAMES) -> Int[np.ndarray, "s"]:
    """Evenly spread frames, the first, the last, and each at which the gripper starts to open or close."""
    spread = np.unique(
        np.linspace(0, episode.length - 1, min(most, episode.length)).round().astype(int)
    )
    return np.union1d(spread, events(episode.robot.gripper_open))


def look(episode: Episode, frames: Iterable[int] | None = None) -> SampledFrames:
    """Decode `frames` (default: `frames_to_look_at`) of every camera that has both depth and instance ids."""
    if frames is None:
        return _at_all(memo.recorded(episode))
    return _decoded(episode, np.array(sorted(set(frames)), int))


@memo.once
def _at_all(episode: Episode) -> SampledFrames:
    return _decoded(episode, frames_to_look_at(episode))


def _decoded(episode: Episode, chosen: Int[np.ndarray, "s"]) -> SampledFrames:
    names = tuple(
        name
        for name, view in episode.views.items()
        if view.depth is not None and view.ids is not None
    )
    cameras = [episode.views[name].camera for name in names]
    steps = [max(1, round(camera.width / MOST_PIXELS)) for camera in cameras]
    shape = (
        len(chosen),
        len(names),
        max((-(-c.height // s) for c, s in zip(cameras, steps, strict=True)), default=1),
        max((-(-c.width // s) for c, s in zip(cameras, steps, strict=True)), default=1),
    )
    depth, ids = np.zeros(shape, np.float32), np.full(shape, -1, np.int32)
    K = np.zeros((len(names), 3, 3))
    poses = np.zeros((len(chosen), len(names), 4, 4))
    points = np.zeros((*shape, 3), np.float32)
    for c, (camera, step) in enumerate(zip(cameras, steps, strict=True)):
        # Integer pixel centres: every step-th pixel is the image of a camera with K / step, exactly.
        K[c] = np.diag([1 / step, 1 / step, 1.0]) @ camera.K
        poses[:, c] = camera.cam_to_world[chosen]

    def fill(s: int, c: int) -> None:
        view, step, t = episode.views[names[c]], steps[c], int(chosen[s])
        assert view.depth is not None
        assert view.ids is not None
        near = view.depth(t)[::step, ::step]
        depth[s, c, : near.shape[0], : near.shape[1]] = np.nan_to_num(near, posinf=0.0, neginf=0.0)
        ids[s, c, : near.shape[0], : near.shape[1]] = view.ids(t)[::step, ::step]
        _lift(depth[s, c], K[c], poses[s, c], points[s, c])

    images = np.indices(shape[:2]).reshape(2, -1).tolist()
    with ThreadPoolExecutor(THREADS) as pool:  # decoding and lifting release the interpreter
        for done, _ in enumerate(pool.map(fill, *images)):
            told(episode.key, "looking at frames", done + 1, len(images[0]))
    fixed = np.array([camera.fixed for camera in cameras], bool)
    return SampledFrames(chosen, names, fixed, K, poses, depth, ids, points)


def lift(
    depth: Float32[np.ndarray, "h w"],
    ids: Int32[np.ndarray, "h w"],
    K: Float64[np.ndarray, "3 3"],
    pose: Float64[np.ndarray, "4 4"],
) -> tuple[Float32[np.ndarray, "h w 3"], Float32[np.ndarray, "h w 3"]]:
    """World points and unit normals (zero where unknown) of one image."""
    points = np.zeros((*depth.shape, 3), np.float32)
    _lift(depth, np.ascontiguousarray(K), np.ascontiguousarray(pose), points)
    return points, _normals(depth[None, None], ids[None, None], points[None, None])[0, 0]


@kernel
def _lift(
    depth: Float32[np.ndarray, "h w"],
    K: Float64[np.ndarray, "3 3"],
    pose: Float64[np.ndarray, "4 4"],
    points: Float32[np.ndarray, "h w 3"],
) -> None:
    """Fill the world points of one image."""
    height, width = depth.shape
    for r in range(height):
        for c in range(width):
            z = depth[r, c]
            x, y = (c - K[0, 2]) / K[0, 0] * z, (r - K[1, 2]) / K[1, 1] * z
            for i in range(3):
                points[r, c, i] = pose[i, 3] + (pose[i, 0] * x + pose[i, 1] * y + pose[i, 2] * z)


@kernel
def _normals(
    depth: Float32[np.ndarray, "s c h w"],
    ids: Int32[np.ndarray, "s c h w"],
    points: Float32[np.ndarray, "s c h w 3"],
) -> Float32[np.ndarray, "s c h w 3"]:
    out, step = np.zeros(points.shape, np.float32), np.zeros((2, 3))
    for s in range(depth.shape[0]):
        for c in range(depth.shape[1]):
            near, own, lifted = depth[s, c], ids[s, c], points[s, c]
            for row in range(near.shape[0]):
                for column in range(near.shape[1]):
                    _normal(near, own, lifted, row, column, step, out[s, c, row, column])
    return out


@kernel
def _normals_at(
    depth: Float32[np.ndarray, "s c h w"],
    ids: Int32[np.ndarray, "s c h w"],
    points: Float32[np.ndarray, "s c h w 3"],
    frame: Int[np.ndarray, "n"],
    camera: Int[np.ndarray, "n"],
    row: Int[np.ndarray, "n"],
    column: Int[np.ndarray, "n"],
) -> Float32[np.ndarray, "n 3"]:
    out, step = np.zeros((len(row), 3), np.float32), np.zeros((2, 3))
    for n in range(len(row)):
        s, c = frame[n], camera[n]
        _normal(depth[s, c], ids[s, c], points[s, c], row[n], column[n], step, out[n])
    return out


@inlined
def _normal(depth, ids, points, r, c, step, out):
    """Fill a pixel's normal, one-sided: across and down the smaller of the two differences wins."""
    if depth[r, c] > 0 and _steps(depth, ids, points, r, c, step):
        n0 = step[1, 1] * step[0, 2] - step[1, 2] * step[0, 1]
        n1 = step[1, 2] * step[0, 0] - step[1, 0] * step[0, 2]
        n2 = step[1, 0] * step[0, 1] - step[1, 1] * step[0, 0]
        length = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
        if length > 0:
            out[0], out[1], out[2] = n0 / length, n1 / length, n2 / length


@inlined
def _steps(depth, ids, points, r, c, step):
    """Fill from a pixel's point those to the nearer neighbours of its instance, across and down, if it has both."""
    height, width = depth.shape
    found = 0
    for axis in range(2):
        best = np.inf
        for side in (-1, 1):
            row, column = (r, c + side) if axis == 0 else (r + side, c)
            if row < 0 or row >= height or column < 0 or column >= width:
                continue
            gap = abs(depth[row, column] - depth[r, c])
            if ids[row, column] == ids[r, c] and depth[row, column] > 0 and gap < best:
                best = gap
                for i in range(3):
                    step[axis, i] = side * (points[row, column, i] - points[r, c, i])
        found += best < np.inf
    return found == 2
