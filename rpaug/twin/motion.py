"""From key poses of the gripper to a smooth motion of the arm and of what it holds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rpaug.core import geometry
from rpaug.core.errors import Unsupported
from rpaug.twin.panda import HOME, OPEN, Panda

STEP = 0.05  # seconds between frames, RLBench's simulation step
_NUDGE = 1e-4  # of a straight path: the step of the central difference that gives its joint rates


@dataclass(frozen=True)
class HingeTurn:
    """A turn about an axis through `at` (metres, world), by the rotation vector `turn` in radians."""

    at: Float[np.ndarray, "3"]
    turn: Float[np.ndarray, "3"]

    def turned(self, pose: Float[np.ndarray, "4 4"], share: float) -> Float[np.ndarray, "4 4"]:
        """The pose after that share of the turn."""
        motion = geometry.rigid(share * self.turn, np.zeros(3))
        motion[:3, 3] = self.at - motion[:3, :3] @ self.at
        return motion @ pose


@dataclass(frozen=True, kw_only=True)
class Key:
    """One leg of the motion, ending at `tip` (None: the gripper stays) with the fingers `opening` metres apart.

    `share` is its part of the episode's length. `straight` legs move the tip on a line without
    turning it, legs `about` a hinge turn it about that; the others swing the joints. `holds` names
    what is rigid to the gripper during the leg.
    """

    share: float
    tip: Float[np.ndarray, "4 4"] | None = None
    opening: float = OPEN
    straight: bool = False
    about: HingeTurn | None = None
    holds: str | None = None


@dataclass(frozen=True)
class Motion:
    """The whole motion, frame by frame: joints in radians and radians per second, fingers in metres, poses to world.

    `keys` are the frames at which a leg ends; the arm stands still there.
    """

    joint_positions: Float[np.ndarray, "t 7"]
    joint_velocities: Float[np.ndarray, "t 7"]
    opening: Float[np.ndarray, "t"]
    gripper_to_world: Float[np.ndarray, "t 4 4"]
    objects: Mapping[str, Float[np.ndarray, "t 4 4"]]
    keys: tuple[int, ...]

    @property
    def length(self) -> int:
        """Number of frames."""
        return len(self.opening)


def play(
    arm: Panda,
    script: Sequence[Key],
    objects: Mapping[str, Float[np.ndarray, "4 4"]],
    frames: int,
) -> Motion:
    """Act the script out from the home posture over `frames` frames; `objects` are where things stand at first.

    Raises Unsupported if there are fewer than two frames a leg, ValueError if a pose cannot be
    reached.
    """
    if frames < 2 * len(script) + 1:
        raise Unsupported(f"{frames} frames: this motion needs {2 * len(script) + 1} or more")
    ends = _leg_ends([key.share for key in script], frames)
    q, opening = HOME, OPEN
    positions, rates, openings = [q], [np.zeros(7)], [opening]
    for key, start, end in zip(script, (0, *ends), ends, strict=False):
        u = np.arange(1, end - start + 1) / (end - start)
        progress, speed = _minimum_jerk(u)
        path, slope = _leg(arm, q, key, progress)
        positions.extend(path)
        rates.extend(slope * (speed / ((end - start) * STEP))[:, None])
        openings.extend(opening + (key.opening - opening) * progress)
        q, opening = path[-1], key.opening
    tips = np.array([arm.tip(q) for q in positions])
    held = [
        None,
        *(k.holds for k, a, b in zip(script, (0, *ends), ends, strict=False) for _ in range(a, b)),
    ]
    tracks = {
        name: _carried(pose, tips, [h == name for h in held]) for name, pose in objects.items()
    }
    return Motion(np.array(positions), np.array(rates), np.array(openings), tips, tracks, ends)


def _leg_ends(shares: Sequence[float], frames: int) -> tuple[int, ...]:
    """The last frame of every leg: at least two frames each, the last one the episode's."""
    spare = frames - 1 - 2 * len(shares)
    ends = np.floor(np.cumsum(shares) / np.sum(shares) * spare + 0.5).astype(int)
    return tuple((ends + 2 * np.arange(1, len(shares) + 1)).tolist())


def _minimum_jerk(
    u: Float[np.ndarray, "n"],
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Progress and its slope, both at rest at u = 0 and 1 (Flash and Hogan, 1985)."""
    return u**3 * (10 - 15 * u + 6 * u**2), 30 * u**2 * (1 - u) ** 2


def _leg(
    arm: Panda, q: Float[np.ndarray, "7"], key: Key, progress: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "n 7"], Float[np.ndarray, "n 7"]]:
    """Joints along one leg, and their derivative by its progress."""
    if key.tip is None and key.about is None:
        return np.tile(q, (len(progress), 1)), np.zeros((len(progress), 7))
    if key.tip is not None and not key.straight:
        way = arm.solve(key.tip, q) - q
        return q + progress[:, None] * way, np.tile(way, (len(progress), 1))
    first = arm.tip(q)
    path, slope = [], []
    for s in progress:
        before, q, after = (arm.solve(_between(first, key, s + d), q) for d in (-_NUDGE, 0, _NUDGE))
        path.append(q)
        slope.append((after - before) / (2 * _NUDGE))
    return np.array(path), np.array(slope)


def _between(first: Float[np.ndarray, "4 4"], key: Key, s: float) -> Float[np.ndarray, "4 4"]:
    if key.about is not None:
        return key.about.turned(first, s)
    assert key.tip is not None
    pose = first.copy()
    pose[:3, 3] += s * (key.tip[:3, 3] - first[:3, 3])
    return pose


def _carried(
    pose: Float[np.ndarray, "4 4"], tips: Float[np.ndarray, "t 4 4"], held: Sequence[bool]
) -> Float[np.ndarray, "t 4 4"]:
    """Where something is that rests at `pose` and is rigid to the tip in every step flagged in `held`."""
    track = [pose]
    for before, after, holds in zip(tips, tips[1:], held[1:], strict=False):
        track.append(after @ geometry.inverse(before) @ track[-1] if holds else track[-1])
    return np.array(track)
