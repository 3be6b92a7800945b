"""What a simulated thing may run into: the support, what stands still around it, and the robot as it was recorded."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float64

from rpaug.core import geometry
from rpaug.core.types import Body, Scene
from rpaug.physics.colliders import Boxes
from rpaug.scene.sampled_frames import look
from rpaug.scene.targets.observed import surface

ROUNDED = 0.002  # metres: radius of the edges of a robot's part
SKIN = 0.0015  # metres that its box is larger than what was seen: fingers that close on a thing press it
TRIMMED = 0.01  # share of a part's points that may lie outside its box: noise
BALL = 0.008  # metres: radius of the balls that other moving things are made of
MOST_BALLS = 120
FINGERS = (
    0.012,
    0.045,
    0.03,
)  # metres: half the size of a hand that was never seen, around its tip
FEW = 20  # points


@dataclass(frozen=True)
class Surroundings:
    """The support's height, surface points of what stands still, and what moves: boxes, the first `robot` of which
    are the robot's."""

    level: float | None
    points: Float64[np.ndarray, "n 3"]
    boxes: Boxes | None
    robot: int


def surroundings(scene: Scene, instance_ids: frozenset[int], pace: float) -> Surroundings:
    """What is around some instances; recorded frames are `pace` seconds apart."""
    sampled = look(scene.episode)
    support = scene.roles.get("table", frozenset())
    tops: list[np.ndarray] = []
    points: list[np.ndarray] = []
    for body, instance_id in _solid(scene, instance_ids):
        if body.motion != "static":
            continue
        found = geometry.transform(body.to_world[0], surface(sampled, instance_id, body)[0])
        (tops if instance_id in support else points).append(found)
    level = float(np.median(np.concatenate(tops)[:, 2])) if tops else None
    mine, others = [], []
    robot = scene.roles.get("robot", frozenset())
    for body, instance_id in _solid(scene, instance_ids):
        if body.motion in ("static", "unknown"):
            continue
        seen = surface(sampled, instance_id, body)[0]
        if instance_id in robot and len(seen) >= FEW:
            grip = scene.episode.robot.gripper_to_world
            upright = [] if grip is None else [grip[body.reference, :3, :3]]
            mine.append((body.to_world, *_boxed(seen, upright), ROUNDED))
        elif instance_id not in robot:
            others += [(body.to_world, *ball) for ball in _balls(seen)]
    if not mine and (gripper := scene.episode.robot.gripper_to_world) is not None:
        mine.append((gripper, np.eye(4), np.array(FINGERS), ROUNDED))
    every = [*mine, *others]
    boxes = None
    if every:
        tracks, places, halves, radius = (list(part) for part in zip(*every, strict=True))
        boxes = Boxes.of(tracks, places, halves, radius, pace)
    standing = np.concatenate(points) if points else np.zeros((0, 3))
    return Surroundings(level, standing, boxes, len(mine))


def clear(
    points: Float64[np.ndarray, "n 3"], of: Float64[np.ndarray, "m 3"], apart: float
) -> Bool[np.ndarray, "n"]:
    """Which points are in no cell, `apart` metres wide, beside one of the others."""
    low = np.minimum(points.min(0), of.min(0)) if len(points) else np.zeros(3)
    taken = np.unique(np.floor((of - low) / apart).astype(int), axis=0)
    steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), -1).reshape(-1, 3)
    beside = {tuple(cell) for step in steps for cell in (taken + step).tolist()}
    cells = np.floor((points - low) / apart).astype(int).tolist()
    return np.array([tuple(cell) not in beside for cell in cells], bool)


def within(
    points: Float64[np.ndarray, "n 3"],
    low: Float[np.ndarray, "3"],
    high: Float[np.ndarray, "3"],
) -> Bool[np.ndarray, "n"]:
    """Which points lie in a box."""
    return np.asarray(((points >= low) & (points <= high)).all(1))


def _solid(scene: Scene, instance_ids: frozenset[int]) -> Iterator[tuple[Body, int]]:
    """Recorded bodies, as they are now, with each of their instance ids but the simulated ones'."""
    for body in scene.bodies:
        if body.mesh is None and body.soft is None and not body.copy_of:
            for instance_id in sorted(body.instance_ids - instance_ids):
                yield body, instance_id


def _boxed(
    points: Float64[np.ndarray, "n 3"], upright: Sequence[Float64[np.ndarray, "3 3"]] = ()
) -> tuple[Float64[np.ndarray, "4 4"], Float64[np.ndarray, "3"]]:
    """The smallest box around points with a side along one of their principal axes, or of `upright`'s columns: its
    pose, and half its size without the rounding.

    A finger that pushes meets with a flat side; principal axes alone lean where one side was seen more than another.
    """
    middle = points.mean(0)
    own = np.linalg.eigh(np.cov((points - middle).T))[1]
    own[:, 0] *= np.sign(np.linalg.det(own))
    low, high = np.quantile((points - middle) @ own, [TRIMMED / 2, 1 - TRIMMED / 2], axis=0)
    kept = points[(((points - middle) @ own >= low) & ((points - middle) @ own <= high)).all(1)]
    best, least = own, np.inf
    for frame in (own, *upright):
        for k in range(3):
            along = np.roll(frame, -k, axis=1)
            turn = np.deg2rad(
                cv2.minAreaRect(((kept - middle) @ along[:, 1:]).astype(np.float32))[2]
            )
            across = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
            axes = np.column_stack([along[:, :1], along[:, 1:] @ across])
            sides = np.ptp((kept - middle) @ axes, axis=0)
            if sides.prod() < least:
                best, least = axes, float(sides.prod())
    low, high = np.quantile((points - middle) @ best, [TRIMMED, 1 - TRIMMED], axis=0)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = best, middle + best @ ((low + high) / 2)
    return pose, np.maximum((high - low) / 2 + SKIN - ROUNDED, 0.0)


def _balls(
    points: Float64[np.ndarray, "n 3"],
) -> list[tuple[Float64[np.ndarray, "4 4"], Float64[np.ndarray, "3"], float]]:
    """Balls under surface points, as few as close the surface or as are allowed."""
    side = BALL
    while True:
        cells = np.unique(np.round(points.reshape(-1, 3) / side).astype(int), axis=0)
        if len(cells) <= MOST_BALLS:
            break
        side *= 1.2
    out = []
    for cell in cells:
        pose = np.eye(4)
        pose[:3, 3] = side * cell
        out.append((pose, np.zeros(3), side))
    return out
