"""What the rdt adapter writes is read by RDT's own dataset class, in its own process, in the right colors."""

from dataclasses import replace
from pathlib import Path

import drivers
import numpy as np
import pytest

from rpaug import CameraView, Episode
from rpaug.core import registry

KEY = "all_variations/episodes/episode0"
RIGHT_ARM, GRIPPER = slice(0, 6), 10  # in RDT's unified vector


@pytest.fixture(scope="module")
def read():
    """Runs the driver on a folder; returns what it says and the frames it drew."""
    repository, python = (
        drivers.reader("RoboticsDiffusionTransformer"),
        drivers.reader("rdt/bin/python"),
    )

    def run(folder: Path) -> tuple[dict, dict[str, np.ndarray]]:
        out = folder.parent / "frames.npz"
        stated = drivers.run(python, "read_with_rdt.py", repository, folder, out)
        return stated, dict(np.load(out))

    return run


def lengthened(episode: Episode, length: int) -> Episode:
    """The episode with its last frame held: RDT drops what is shorter than 128 steps."""
    at = np.minimum(np.arange(length), episode.length - 1)

    def longer(view: CameraView) -> CameraView:
        camera = replace(view.camera, cam_to_world=view.camera.cam_to_world[at])
        return CameraView(camera, lambda t: view.rgb(int(at[t])))

    robot = episode.robot
    assert robot.gripper_to_world is not None
    assert robot.gripper_open is not None
    held = replace(
        robot,
        joint_positions=robot.joint_positions[at],
        joint_velocities=robot.joint_velocities[at],
        gripper_to_world=robot.gripper_to_world[at],
        gripper_open=robot.gripper_open[at],
        extra={name: track[at] for name, track in robot.extra.items()},
    )
    views = {name: longer(view) for name, view in episode.views.items()}
    return replace(episode, views=views, robot=held, length=length, source=None)


def test_rdts_own_dataset_reads_an_exported_episode(read, samples: Path, tmp_path: Path) -> None:
    source = samples / "rlbench_open_drawer"
    episode = lengthened(registry.adapter("rlbench").read(source, KEY), 140)
    root = tmp_path / "out"
    registry.adapter("rdt").write(episode, root, "open_drawer/episode_0", dict)
    stated, frames = read(root)
    assert len(stated["samples"]) == 6
    for sample in stated["samples"]:
        t = sample["step"]
        assert sample["steps"] == 140
        assert sample["instruction"] in episode.descriptions
        joints = episode.robot.joint_positions
        assert np.allclose(np.array(sample["state"])[RIGHT_ARM], joints[t, :6])
        assert np.allclose(np.array(sample["next"])[RIGHT_ARM], joints[min(t + 1, 139), :6])
        assert sample["state"][GRIPPER] == pytest.approx(episode.robot.gripper_open[t])
        for name, drawn in (("front", sample["frame"]), ("wrist", sample["frame"] + "_wrist")):
            truth = episode.views[name].rgb(t).astype(int)
            assert np.abs(frames[drawn] - truth).mean() < 1.5
            assert np.abs(frames[drawn] - truth[..., ::-1]).mean() > 4
