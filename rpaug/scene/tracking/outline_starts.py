"""Where a camera may stand before anything of it is known: on every side of the robot, near and far.

The robot is drawn as the hulls of its parts, by upright cameras on a grid of directions and distances that have it in
the middle of the masks. The best of them are made better step by step; those whose outlines then lie best on the masks
are brought onto them with few pixels and frames.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
from jaxtyping import Float64

from rpaug.core import geometry
from rpaug.scene.tracking import outline_pose
from rpaug.scene.tracking.outline_pose import Mask, OutlinedFrame, OutlineLens, Pose, SolvedPose

AROUND, HEIGHTS = (
    24,
    (-10.0, 15.0, 40.0, 60.0, 80.0),
)  # directions: how many, degrees above the level
DISTANCES = 1.0, 1.5, 2.2, 3.3, 5.0, 7.5  # times the robot's reach
TRIED, CLIMBED = 48, 14  # starts that are made better by steps, and by how many
CORNERS = 48  # of a part's hull, at most
SIDE = 64  # pixels of the masks that starts are held against
LOOKED = 5  # frames
KEPT = 10  # starts
WIDTHS = 6.0, 2.0  # of what counts as an outlier: a start is far off
NEAR = 0.05  # metres before the camera: a part that reaches nearer is not drawn
_BOTH = np.concatenate([np.eye(3), -np.eye(3)])
BEHIND = 0.12  # of overlap: solutions farther behind the best are none
SAME = np.deg2rad(6.0)  # solutions nearer than this are one


@dataclass(frozen=True)
class _Hulls:
    """One frame's mask, and corners of each part's hull in the world."""

    corners: tuple[Float64[np.ndarray, "n 3"], ...]
    mask: Mask

    @classmethod
    def of(cls, frame: OutlinedFrame) -> "_Hulls":
        ways = np.random.default_rng(0).normal(size=(CORNERS, 3))
        found = []
        for part, pose in frame.parts:
            most = np.unique((part.points @ ways.T).argmax(0))
            found.append(geometry.transform(pose, part.points[most]))
        return cls(tuple(found), frame.mask)

    def drawn(self, lens: OutlineLens, cam_to_world: Pose) -> Mask:
        """About what the camera would see."""
        out = np.zeros(self.mask.shape, np.uint8)
        to_camera = geometry.inverse(cam_to_world)
        for corners in self.corners:
            local = geometry.transform(to_camera, corners)
            if local[:, 2].min() < NEAR:
                continue
            pixels = np.stack(geometry.to_image(local, local[:, 2], lens.K), -1)
            pixels = np.clip(pixels, -1e4, 1e4).round().astype(np.int32)
            cv2.fillConvexPoly(out, cv2.convexHull(pixels), 1)
        return out > 0


def starts(
    frames: Sequence[OutlinedFrame],
    lens: OutlineLens,
    progress: Callable[[float], None] = lambda _: None,
) -> list[SolvedPose]:
    """Solutions of few pixels, the best first, no two alike, none far behind; `lens` is that of the frames' masks."""
    some = [frames[k] for k in np.unique(np.linspace(0, len(frames) - 1, LOOKED).astype(int))]
    shape = some[0].mask.shape
    some = [frame.sized(SIDE) for frame in some]
    small = lens.scaled(shape, some[0].mask.shape)
    hulls = [_Hulls.of(frame) for frame in some]
    points = np.concatenate([corners for one in hulls for corners in one.corners])
    middle = np.median(points, 0)
    reach = float(np.quantile(np.linalg.norm(points - middle, axis=1), 0.9))
    placed = [
        _aimed(hulls, small, turned, middle, far * reach)
        for turned, far in product(_directions(), DISTANCES)
    ]
    placed.sort(key=lambda pose: -_overlap(hulls, small, pose))
    climbed = list[tuple[float, Pose]]()
    for k, pose in enumerate(placed[:TRIED]):
        climbed.append(_climbed(hulls, small, pose, middle))
        progress(0.5 * k / TRIED)
    climbed.sort(key=lambda one: -one[0])
    solved = list[SolvedPose]()
    for k, (_, pose) in enumerate(climbed[:KEPT]):
        solved.append(outline_pose.solve(some, small, pose, WIDTHS))
        progress(0.5 + 0.5 * k / KEPT)
    best, *others = distinct(ranked(some, solved))
    most = _fit(some, best)
    return [best, *(one for one in others if _fit(some, one) > most - BEHIND)]


def ranked(frames: Sequence[OutlinedFrame], solved: Sequence[SolvedPose]) -> list[SolvedPose]:
    """Solutions by how well their outlines lie on the masks, the best first."""
    return sorted(solved, key=lambda one: -_fit(frames, one))


def _fit(frames: Sequence[OutlinedFrame], one: SolvedPose) -> float:
    """Mean intersection over union of drawn and recorded outlines."""
    return float(outline_pose.overlaps(frames, one.lens, one.cam_to_world).mean())


def distinct(solved: Sequence[SolvedPose]) -> list[SolvedPose]:
    """Of solutions that look the same way the first."""
    out = list[SolvedPose]()
    for one in solved:
        if all(turn(one.cam_to_world, other.cam_to_world) > SAME for other in out):
            out.append(one)
    return out


def turn(one: Pose, other: Pose) -> float:
    """Radians between two poses."""
    cosine = (np.trace(one[:3, :3].T @ other[:3, :3]) - 1) / 2
    return float(np.arccos(np.clip(cosine, -1, 1)))


def _overlap(hulls: Sequence[_Hulls], lens: OutlineLens, pose: Pose) -> float:
    """Mean intersection over union."""
    out = []
    for one in hulls:
        drawn = one.drawn(lens, pose)
        out.append((drawn & one.mask).sum() / max((drawn | one.mask).sum(), 1))
    return float(np.mean(out))


def _directions() -> Iterator[Pose]:
    """Upright cameras at the world's origin that look from every side, some from above."""
    headings = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)
    for height, heading in product(np.deg2rad(HEIGHTS), headings):
        level = np.array([np.cos(heading), np.sin(heading), 0.0])
        ahead = -np.cos(height) * level - np.sin(height) * np.array([0, 0, 1.0])
        right = np.array([-level[1], level[0], 0.0])
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], 1)
        yield pose


def _aimed(
    hulls: Sequence[_Hulls], lens: OutlineLens, turned: Pose, middle: np.ndarray, away: float
) -> Pose:
    """A camera of that direction and distance that sees the robot in the middle of the masks."""
    pose = turned.copy()
    pose[:3, 3] = middle - away * turned[:3, 2]
    for _ in range(2):
        drawn = [one.drawn(lens, pose) for one in hulls]
        found = [
            np.argwhere(mask).mean(0) - np.argwhere(one.mask).mean(0)
            for mask, one in zip(drawn, hulls, strict=True)
            if mask.any()
        ]
        if not found:
            break
        down, right = np.median(np.array(found), 0)
        pose[:3, 3] += turned[:3, :2] @ [right, down] * away / lens.K[0, 0]
    return pose


def _climbed(
    hulls: Sequence[_Hulls], lens: OutlineLens, pose: Pose, middle: np.ndarray
) -> tuple[float, Pose]:
    """The pose shifted and turned step by step while that makes outlines lie better, by ever smaller steps."""
    best, step = _overlap(hulls, lens, pose), 0.15
    for _ in range(CLIMBED):
        away = float(np.linalg.norm(pose[:3, 3] - middle))
        moves = [geometry.rigid(np.zeros(3), way) for way in step * away * _BOTH]
        moves += [geometry.rigid(way, np.zeros(3)) for way in step * _BOTH]
        tried = [(_overlap(hulls, lens, pose @ move), pose @ move) for move in moves]
        most, moved = max(tried, key=lambda one: one[0])
        if most > best:
            best, pose = most, moved
        else:
            step /= 2
    return best, pose
