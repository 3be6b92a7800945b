"""Demonstrations on disk as what a policy learns from: what was seen at one key frame, and the key pose after it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, UInt8

from rpaug.core import keyframes, registry
from rpaug.core.types import Episode
from tools.bench.closed_loop.bench import SEEN, View
from tools.bench.closed_loop.views import cloud

FRAMES = 30  # of a demonstration
SAME = 0.015  # metres and entries of a rotation: closer poses are one to a policy that sees cells of a centimetre


@dataclass(frozen=True)
class Sample:
    """A point cloud, the task and the number of the key pose that comes next, and that pose (gripper to world)."""

    points: Float32[np.ndarray, "n 3"]
    colors: UInt8[np.ndarray, "n 3"]
    task: int
    key: int
    pose: Float[np.ndarray, "4 4"]
    open: bool


def read(root: Path, tasks: Sequence[str]) -> list[Sample]:
    """All samples of the episodes under `root`, in RLBench's format. The task is the first part of an episode's key."""
    adapter = registry.adapter("rlbench")
    out: list[Sample] = []
    for key in sorted(adapter.episodes(root)):
        task = next(number for number, name in enumerate(tasks) if name in Path(key).parts)
        out += of(adapter.read(root, key), task)
    return out


def of(episode: Episode, task: int) -> Iterator[Sample]:
    """The samples of one episode."""
    robot = episode.robot
    assert robot.gripper_to_world is not None
    assert robot.gripper_open is not None
    before = 0
    for number, t in enumerate(keys(episode)):
        views = [_view(episode, name, before) for name in SEEN]
        yield Sample(
            *cloud(views), task, number, robot.gripper_to_world[t], bool(robot.gripper_open[t])
        )
        before = t


def keys(episode: Episode) -> list[int]:
    """Key frames, the later of two that hold one pose: the fingers act where the gripper has arrived."""
    poses = episode.robot.gripper_to_world
    assert poses is not None
    found = keyframes.find(episode.robot)
    return [
        t
        for t, after in zip(found, [*found[1:], None], strict=True)
        if after is None or np.abs(poses[t] - poses[after]).max() > SAME
    ]


def _view(episode: Episode, name: str, t: int) -> View:
    view = episode.views[name]
    assert view.depth is not None
    camera = view.camera
    return View(view.rgb(t), view.depth(t), camera.K, camera.cam_to_world[t])
