"""Shared fixtures: a small exact dataset in RLBench's format, and the real samples where they are at hand."""

import os
from pathlib import Path

import numpy as np
import pytest
from analytic import ball_at, scene

from rpaug import Episode, Robot
from rpaug.registry import adapter

CAMERAS = {"front": (1.6, 0.3, 1.0), "overhead": (0.1, -0.9, 1.5)}


def demonstration(length: int = 8) -> Episode:
    """The analytic scene with a gripper that closes on the ball in frame 2 and carries it along."""
    recorded = scene(CAMERAS, length=length).episode
    gripper = np.tile(np.eye(4), (length, 1, 1))
    gripper[:, :3, 3] = np.array([ball_at(t, length) for t in range(length)])
    gripper[:, 2, 3] += 0.1
    wave = np.linspace(0, 1, length)
    robot = Robot(
        joint_positions=np.tile(wave[:, None], (1, 7)),
        joint_velocities=np.full((length, 7), 0.2),
        gripper_to_world=gripper,
        gripper_open=(np.arange(length) < 2).astype(float),
        extra={"gripper_joint_positions": np.full((length, 2), 0.02)},
    )
    return Episode("episode0", recorded.views, robot, ("roll the ball", "push it"), length)


@pytest.fixture(scope="session")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of two episodes of `roll_ball` in PerAct's layout. Not to be written to."""
    root = tmp_path_factory.mktemp("template")
    for number, length in enumerate((8, 6)):
        key = f"roll_ball/all_variations/episodes/episode{number}"
        adapter("rlbench").write(demonstration(length), root, key, dict)
    return root


@pytest.fixture
def dataset(template: Path, tmp_path: Path) -> Path:
    """A copy of the template that a test may spoil."""
    import shutil

    return Path(shutil.copytree(template, tmp_path / "dataset"))


@pytest.fixture(scope="session")
def samples() -> Path:
    """The folder of real recordings, or a skip."""
    folder = os.environ.get("RPAUG_TEST_DATA")
    if not folder:
        pytest.skip("RPAUG_TEST_DATA names no folder of real recordings")
    return Path(folder)
