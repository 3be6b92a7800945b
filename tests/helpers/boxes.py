"""Small worlds of boxes, ray-cast exactly, whose motions are known: episodes to test against."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from cast_once import cast_once

from rpaug.core import geometry
from rpaug.core.types import Camera, CameraView, Episode, Robot


@dataclass(frozen=True)
class Box:
    """A box with full `size` in metres; `poses` of its centre are (4, 4), or (t, 4, 4) if it moves."""

    size: tuple[float, float, float]
    poses: np.ndarray
    color: tuple[int, int, int] = (128, 128, 128)


def at(x: float, y: float, z: float) -> np.ndarray:
    """A pose without rotation."""
    return geometry.rigid(np.zeros(3), np.array([x, y, z]))


def look_at(eye: tuple[float, float, float], target: tuple[float, float, float]) -> np.ndarray:
    """Camera-to-world pose, OpenCV axes, the world's z up in the image."""
    z = np.array(target, float) - eye
    z /= np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross(z, x), z], 1)
    pose[:3, 3] = eye
    return pose


@cast_once
def cast(
    n: int, K: np.ndarray, cam_to_world: np.ndarray, boxes: Mapping[int, Box]
) -> tuple[np.ndarray, ...]:
    """Depth, handles and shaded colors of boxes that stand still, n x n pixels."""
    rays = geometry.unproject(np.ones((n, n)), K) @ cam_to_world[:3, :3].T
    eye = cam_to_world[:3, 3]
    depth, ids = np.full((n, n), np.inf), np.zeros((n, n), np.int32)
    rgb = np.zeros((n, n, 3), np.uint8)
    for instance_id, box in boxes.items():
        back = geometry.inverse(box.poses)
        o, d = geometry.transform(back, eye), rays @ back[:3, :3].T
        d = np.where(np.abs(d) < 1e-12, 1e-12, d)
        half = np.array(box.size) / 2
        near = np.minimum((-half - o) / d, (half - o) / d)
        far = np.maximum((-half - o) / d, (half - o) / d)
        enter = near.max(-1)
        hit = (enter < far.min(-1)) & (enter > 0) & (enter < depth)
        depth[hit], ids[hit] = enter[hit], instance_id
        shade = np.array([0.7, 0.85, 1.0])[near.argmax(-1)][hit]
        rgb[hit] = (shade[:, None] * box.color).astype(np.uint8)
    return np.where(np.isinf(depth), 0, depth).astype(np.float32), ids, rgb


EYES = {"front": (1.0, 0.2, 0.7), "left": (-0.6, 0.8, 0.8), "right": (-0.4, -0.9, 0.9)}


@dataclass(frozen=True)
class World:
    boxes: Mapping[int, Box]
    gripper: np.ndarray  # (t, 4, 4)
    gripper_open: np.ndarray  # (t,)
    size: int = 64
    eyes: Mapping[str, tuple[float, float, float]] = field(default_factory=lambda: EYES)

    def pose(self, instance_id: int, t: int) -> np.ndarray:
        poses = self.boxes[instance_id].poses
        return poses if poses.ndim == 2 else poses[t]

    def cast(self, camera: Camera, t: int) -> tuple[np.ndarray, ...]:
        """Depth, handles and shaded colors of one image."""
        boxes = {
            name: Box(box.size, self.pose(name, t), box.color) for name, box in self.boxes.items()
        }
        return cast(self.size, camera.K, camera.cam_to_world[t], boxes)

    def episode(self, *, masks: bool = True) -> Episode:
        length = len(self.gripper)
        K = np.array([[70.0, 0, self.size / 2], [0, 70.0, self.size / 2], [0, 0, 1.0]])
        views = {}
        for name, eye in self.eyes.items():
            pose = np.tile(look_at(eye, (0.1, 0.0, 0.05)), (length, 1, 1))
            camera = Camera(K, pose, self.size, self.size)
            seen = [self.cast(camera, t) for t in range(length)]
            views[name] = CameraView(
                camera,
                lambda t, seen=seen: seen[t][2],
                lambda t, seen=seen: seen[t][0],
                (lambda t, seen=seen: seen[t][1]) if masks else None,
            )
        rest = np.zeros((length, 6))
        robot = Robot(rest, rest, self.gripper, self.gripper_open)
        return Episode("boxes", views, robot, ("move the box",), length)


FLOOR, WALL, TABLE, PAD, BLOCK, HAND, OTHER = 1, 2, 3, 4, 5, 6, 7


def furniture() -> dict[int, Box]:
    """A floor, a wall, a table, and a red and a blue thing that nobody touches."""
    return {
        FLOOR: Box((5, 5, 0.02), at(0, 0, -0.71), (180, 180, 180)),
        WALL: Box((0.02, 4, 2.5), at(-2.0, 0, 0.3), (90, 90, 110)),
        TABLE: Box((0.9, 1.1, 0.04), at(0.1, 0, -0.02), (200, 150, 90)),
        OTHER: Box((0.08, 0.08, 0.12), at(-0.15, -0.25, 0.06), (200, 0, 0)),
    }


def path(*stops: tuple[float, float, float], steps: int) -> np.ndarray:
    """Positions that move evenly from stop to stop, `steps` frames each."""
    legs = [np.linspace(a, b, steps, endpoint=False) for a, b in pairwise(stops)]
    return np.concatenate([*legs, [stops[-1]]])


def poses(positions: np.ndarray) -> np.ndarray:
    return np.stack([at(*p) for p in positions])


def pick_and_place() -> World:
    """The hand lifts the block from the table and sets it on the pad; frames 8 to 24 hold it."""
    top = (0.1, -0.12, 0.3)
    hand = path(top, (0.1, -0.12, 0.1), steps=6)
    hand = np.concatenate([hand, np.tile(hand[-1:], (3, 1))])  # closes at 8
    grasp = len(hand) - 2
    hand = np.concatenate(
        [hand, path(tuple(hand[-1]), (0.1, 0.05, 0.25), (0.15, 0.2, 0.13), steps=7)]
    )
    hand = np.concatenate([hand, np.tile(hand[-1:], (3, 1))])
    release = len(hand) - 2
    hand = np.concatenate([hand, path(tuple(hand[-1]), (0.0, 0.1, 0.35), steps=6)])
    t = np.arange(len(hand))
    held = hand[np.clip(t, grasp, release)] - hand[grasp]
    block = np.array([0.1, -0.12, 0.035]) + held
    boxes = furniture() | {
        PAD: Box((0.14, 0.14, 0.03), at(0.15, 0.2, 0.015), (0, 0, 200)),
        BLOCK: Box((0.07, 0.07, 0.07), poses(block), (0, 160, 0)),
        HAND: Box((0.05, 0.12, 0.06), poses(hand), (230, 230, 230)),
    }
    return World(boxes, poses(hand), ((t <= grasp) | (t > release)).astype(float))


def push() -> World:
    """The closed hand slides the block over the table without ever holding it."""
    hand = path((0.1, -0.35, 0.04), (0.1, -0.18, 0.04), (0.1, 0.1, 0.04), (0.1, -0.2, 0.2), steps=8)
    ahead = np.maximum.accumulate(hand[:, 1] + 0.1)
    block = np.stack(
        [np.full(len(hand), 0.1), np.maximum(ahead, -0.08), np.full(len(hand), 0.04)], -1
    )
    turn = 0.5 * (block[:, 1] + 0.08)  # radians: it swings a little, as pushed things do
    boxes = furniture() | {
        BLOCK: Box(
            (0.1, 0.12, 0.08),
            np.stack(
                [geometry.rigid(np.array([0, 0, a]), p) for a, p in zip(turn, block, strict=True)]
            ),
            (0, 160, 0),
        ),
        HAND: Box((0.05, 0.06, 0.05), poses(hand), (230, 230, 230)),
    }
    return World(boxes, poses(hand), np.zeros(len(hand)))


CABINET, LEGS = 20, 21
DRAWERS = 30  # + 3 * column + row, columns from the robot's left, rows from below


def chest(columns: int, rows: int, moved: int, shuts: bool = False, reach: float = 0.02) -> World:
    """A cabinet with drawers of one size; the hand pulls one of them 12 cm out, or pushes it in from there.

    `reach` is how far the hand comes, x in metres.
    """
    wide, high = 0.4 / columns, 0.3 / rows
    grip = (reach, 0.2 - wide * (moved // 3 + 0.5), 0.04 + high * (moved % 3 + 0.5))
    out = tuple(np.array(grip) - (0.12, 0, 0))
    start, end = (out, grip) if shuts else (grip, out)
    above = (-0.15, 0.0, 0.4)
    hand = path(above, start, steps=4)
    hand = np.concatenate([hand, np.tile(hand[-1:], (3, 1))])
    grasp = len(hand) - 2
    hand = np.concatenate([hand, path(start, end, steps=5)])
    pulled = np.where(np.arange(len(hand)) >= grasp, hand[:, 0], start[0]) - grip[0]
    things = furniture() | {
        CABINET: Box((0.3, 0.4, 0.3), at(0.22, 0, 0.19), (200, 170, 120)),
        LEGS: Box((0.28, 0.38, 0.04), at(0.22, 0, 0.02), (90, 90, 90)),
        HAND: Box((0.02, 0.1, 0.04), poses(hand), (230, 230, 230)),
    }
    for column in range(columns):
        for row in range(rows):
            k = 3 * column + row
            place = np.array([0.14, 0.2 - wide * (column + 0.5), 0.04 + high * (row + 0.5)])
            shift = pulled if k == moved else np.zeros(len(hand))
            track = poses(place + shift[:, None] * [1, 0, 0])
            size = (0.2, wide - 0.02, high - 0.02)
            things[DRAWERS + k] = Box(size, track if k == moved else track[0], (140, 140, 140))
    eyes = EYES | {"ahead": (-0.8, 0.05, 0.5)}
    return World(things, poses(hand), (np.arange(len(hand)) < grasp).astype(float), 80, eyes)


def still(length: int) -> World:
    """Nothing moves at all."""
    boxes = furniture() | {HAND: Box((0.05, 0.12, 0.06), at(0.1, 0, 0.3), (230, 230, 230))}
    return World(boxes, np.tile(at(0.1, 0, 0.3), (length, 1, 1)), np.ones(length))
