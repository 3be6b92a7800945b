"""A task that lies anywhere on the table, among things that lie anywhere too."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from rpaug.core import geometry
from rpaug.core.errors import RpaugError
from rpaug.twin.motion import HingeTurn, Key
from rpaug.twin.panda import HOME, Panda
from rpaug.twin.staging import LOOSE, StagedTask, moved
from rpaug.twin.tabletop import resting_height, upright

Pose = Float[np.ndarray, "4 4"]
Spot = Float[np.ndarray, "2"]

MIDDLE = np.array([0.20, 0.0, 0.0])  # metres: what a task is turned about
TURN = 0.5  # radians each way
FIELD = (-0.06, -0.30), (0.50, 0.30)  # metres: corners of where things may lie
APART = 0.09  # metres between the middles of things, and from the gripper's way
TRIES = 100  # draws of a place, and of the whole


def roamed(job: StagedTask, arm: Panda, far: float, rng: np.random.Generator) -> StagedTask:
    """The job turned by up to `TURN` and moved by up to `far` metres each way, all that is no part of it strewn anew.

    The arm reaches all of it. Raises RpaugError for a job with something that bends, and where no such place is found.
    """
    if job.soft is not None:
        raise RpaugError(f"{job.soft.name} bends: its motion is known at one place only")
    for _ in range(TRIES):
        turn = geometry.rigid(np.array([0, 0, rng.uniform(-TURN, TURN)]), np.zeros(3))
        motion = moved(turn, MIDDLE - turn[:3, :3] @ MIDDLE + [*rng.uniform(-far, far, 2), 0.0])
        script = tuple(_moved_key(key, motion) for key in job.script)
        if not _reached(arm, script):
            continue
        needed = {name: motion @ pose for name, pose in job.placing.items() if _needs(job, name)}
        others = [name for name in job.placing if name not in needed]
        placing = needed | _strewn(others, occupied(needed, script), rng)
        if len(placing) == len(job.placing):
            return replace(job, placing=placing, script=script)
    raise RpaugError(f"{job.manipulated}: no place on the table from which the arm reaches all")


def occupied(placing: Mapping[str, Pose], script: Sequence[Key]) -> list[Spot]:
    """Where things stand on the table, and where the gripper passes."""
    way = [key.tip[:2, 3] for key in script if key.tip is not None]
    passed = [a + s * (b - a) for a, b in pairwise(way) for s in (0, 0.5, 1)]
    return [pose[:2, 3] for pose in placing.values()] + passed


def clear(spot: Spot, taken: Sequence[Spot], apart: float) -> bool:
    """Whether a spot is at least so many metres from all that are taken."""
    return min(float(np.linalg.norm(spot - other)) for other in taken) >= apart


def _needs(job: StagedTask, name: str) -> bool:
    return name not in LOOSE or name in (job.manipulated, job.receiver)


def _strewn(names: Sequence[str], taken: list[Spot], rng: np.random.Generator) -> dict[str, Pose]:
    """Things where nothing is, those left out for which no place was found."""
    out: dict[str, Pose] = {}
    for name in names:
        for _ in range(TRIES):
            spot = rng.uniform(*FIELD)
            if clear(spot, taken, APART):
                taken.append(spot)
                x, y = spot
                out[name] = upright(x, y, resting_height(name), rng.uniform(-np.pi, np.pi))
                break
    return out


def _moved_key(key: Key, motion: Pose) -> Key:
    tip = None if key.tip is None else motion @ key.tip
    hinge = key.about
    if hinge is not None:
        hinge = HingeTurn(geometry.transform(motion, hinge.at), motion[:3, :3] @ hinge.turn)
    return replace(key, tip=tip, about=hinge)


def _reached(arm: Panda, script: Sequence[Key]) -> bool:
    q = HOME
    try:
        for key in script:
            q = q if key.tip is None else arm.solve(key.tip, q)
    except ValueError:
        return False
    return True
