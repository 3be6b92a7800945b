"""What a resized thing does to the contacts it was recorded in: fingers that miss it, or sink into it.

Where something touches the thing, the thing's surface moves along its own normal as it grows about a fixed point; how
far, for each unit of growth, is what a contact can bear or not. Sliding along the surface does no harm.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from rpaug.core import geometry
from rpaug.core.types import Scene
from rpaug.scene.sampled_frames import SampledFrames
from rpaug.scene.targets.observed import surface

TIP = 0.03  # metres around the gripper's tip within which fingers touch
ACROSS = 0.8  # cosine between a face that is gripped and the way the fingers close
NEAREST = 0.005  # metres: points this little farther than the nearest to a closed gripper are what it pushes
TOUCH = 0.008  # metres between two things that touch
FEW = 4  # points


@dataclass(frozen=True)
class Contact:
    """`with_` names what touches at frame `t`; growing by dS moves the surface `growth` * dS metres towards it."""

    with_: str
    t: int
    growth: float


def contacts(
    scene: Scene,
    sampled: SampledFrames,
    instance_ids: frozenset[int],
    pivot: Float64[np.ndarray, "3"],
) -> tuple[Contact, ...]:
    """Where the robot, or what it moves, touches those instances. `pivot` is what they grow about, in their frame."""
    found = []
    for body in scene.bodies:
        for instance_id in sorted(body.instance_ids & instance_ids):
            points, normals = surface(sampled, instance_id, body)
            good = np.linalg.norm(normals, axis=1) > 0
            points, normals = points[good], normals[good]
            growth = ((points - pivot) * normals).sum(1)
            for t in grasps(scene, body.to_world):
                near = _held(scene, body.to_world[t], points, normals, t)
                if near.sum() >= FEW:
                    found.append(Contact("the gripper", t, _middle(growth[near])))
            for other in scene.bodies:
                moved = other.instance_ids & scene.roles.get("manipulated", frozenset())
                if moved and not moved & instance_ids:
                    found += _rests(
                        scene, sampled, body.to_world, points, growth, other.instance_ids
                    )
    return tuple(found)


def grasps(scene: Scene, track: Float64[np.ndarray, "t 4 4"]) -> list[int]:
    """Frames at which a body that the robot moves begins to move, and where the gripper lets it go."""
    moves = np.abs(track[1:] - track[:-1]).max((1, 2)) > 1e-5
    if not moves.any() or scene.episode.robot.gripper_to_world is None:
        return []
    return [int(np.argmax(moves)), int(len(moves) - 1 - np.argmax(moves[::-1]))]


def _held(
    scene: Scene, pose: np.ndarray, points: np.ndarray, normals: np.ndarray, t: int
) -> np.ndarray:
    """Which points the gripper touches: those on faces that its fingers close on, or nearest to a closed gripper."""
    robot = scene.episode.robot
    assert robot.gripper_to_world is not None
    own = geometry.inverse(robot.gripper_to_world[t]) @ pose
    local, facing = geometry.transform(own, points), normals @ own[:3, :3].T
    away = np.linalg.norm(local, axis=1)
    gripped = (
        (np.abs(facing[:, 1]) > ACROSS) & (np.abs(local[:, [0, 2]]) < TIP).all(1) & (away < 3 * TIP)
    )
    if (local[gripped, 1] > 0).any() and (local[gripped, 1] < 0).any():
        return gripped
    return (away < away.min() + NEAREST) & (away < 2 * TIP) if len(away) else gripped


def _rests(
    scene: Scene,
    sampled: SampledFrames,
    track: Float64[np.ndarray, "t 4 4"],
    points: np.ndarray,
    growth: np.ndarray,
    others: frozenset[int],
) -> list[Contact]:
    """Contacts with what the robot moves, at the end."""
    t = len(track) - 1
    world = geometry.transform(track[t], points)
    out = []
    for body in scene.bodies:
        for instance_id in sorted(body.instance_ids & others):
            theirs = geometry.transform(
                body.to_world[t], surface(sampled, instance_id, body, most=400)[0]
            )
            if len(theirs) and len(world):
                apart = np.linalg.norm(world[:, None] - theirs[None], axis=-1).min(1)
                near = apart < TOUCH
                if near.sum() >= FEW:
                    out.append(Contact(f"what is moved ({instance_id})", t, _middle(growth[near])))
    return out


def _middle(growth: np.ndarray) -> float:
    """The typical one, by size: opposite faces move alike."""
    return float(growth[np.argsort(np.abs(growth))[len(growth) // 2]])
