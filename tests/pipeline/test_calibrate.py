"""Cameras by the robot's outline, from an episode to a file that adapters read; and what is refused with its reason."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import waving_arm
import yaml
from rpaug_adapters.shared import cameras
from typer.testing import CliRunner

from rpaug import Camera, Episode
from rpaug.cli import app
from rpaug.cli import calibrate as command
from rpaug.core.errors import SourceLacks
from rpaug.pipeline import calibrate
from rpaug.providers.models_settings import Models

SIZE, LENGTH = waving_arm.SIZE, waving_arm.FRAMES


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("arm")


@pytest.fixture(scope="module")
def episode() -> Episode:
    """Two cameras that nothing is known of but the lens; the second is carried about."""
    still = Camera(waving_arm.LENS.K, np.tile(np.eye(4), (LENGTH, 1, 1)), SIZE, SIZE, unplaced=True)
    carried = still.cam_to_world.copy()
    carried[:, 0, 3] = np.arange(LENGTH)
    grey = np.full((LENGTH, SIZE, SIZE, 3), 90, np.uint8)
    return Episode.from_arrays(
        {"front": grey, "wrist": grey},
        cameras={"front": still, "wrist": replace(still, cam_to_world=carried)},
        joint_positions=waving_arm.WAVES,
    )


@pytest.fixture(scope="module")
def outlined(folder: Path) -> Models:
    """The arm outlined under the word `robot` in every frame of `front`."""
    drawn = {}
    for t, frame in enumerate(waving_arm.frames(waving_arm.arm_file(folder))):
        found, _ = cv2.findContours(
            frame.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        polygons = [one[:, 0].tolist() for one in found if len(one) > 2]
        drawn[str(t)] = [{"words": "robot", "polygons": polygons}]
    path = folder / "outlines.json"
    path.write_text(json.dumps({"episode0": {"front": drawn}}))
    return Models(text=f"outlines:{path}")


@pytest.fixture(scope="module")
def found(episode: Episode, folder: Path, outlined: Models) -> calibrate.CalibratedEpisode:
    return calibrate.of_episode(episode, waving_arm.arm_file(folder), outlined)


def test_a_fixed_camera_is_told_and_a_moving_one_refused(
    found: calibrate.CalibratedEpisode,
) -> None:
    metres, degrees = waving_arm.off(found.cameras["front"].cam_to_world)
    assert metres < 0.01
    assert degrees < 0.5
    assert found.refused == {"wrist": "it moves"}
    facts = found.describe()["cameras"]["front"]
    assert "from_the_stated" not in facts  # nothing was stated
    assert "overlap by 0.9" in calibrate.sentence("front", facts)


def test_the_file_is_one_that_adapters_read(found: calibrate.CalibratedEpisode) -> None:
    text = found.yaml(support=0.2)
    assert text.startswith(b"# front: within ")
    tree = yaml.safe_load(text)
    read = cameras.Calibration.model_validate(tree["cameras"]["front"])
    np.testing.assert_allclose(read.intrinsics(SIZE, SIZE), waving_arm.LENS.K, atol=1e-6)
    pose = np.array(tree["cameras"]["front"]["cam_to_world"])
    lifted = found.cameras["front"].cam_to_world[2, 3] - pose[2, 3]
    assert lifted == pytest.approx(0.2)


def test_a_support_elsewhere_is_refused_where_gripper_poses_would_stay_behind(
    found: calibrate.CalibratedEpisode,
) -> None:
    robot = replace(found.episode.robot, gripper_to_world=np.tile(np.eye(4), (LENGTH, 1, 1)))
    held = replace(found, episode=replace(found.episode, robot=robot))
    with pytest.raises(SourceLacks, match="leave the recorded gripper poses where they are"):
        held.yaml(support=0.2)
    assert held.yaml().startswith(b"# front: within ")


def test_without_masks_and_models_it_says_what_would_do(episode: Episode, folder: Path) -> None:
    with pytest.raises(SourceLacks, match=r"nothing outlines the robot.*--models text=NAME"):
        calibrate.of_episode(episode, waving_arm.arm_file(folder), Models())


def test_words_that_nothing_is_outlined_by_are_named(
    episode: Episode, folder: Path, outlined: Models
) -> None:
    with pytest.raises(SourceLacks, match="the models found no 'gantry'"):
        calibrate.of_episode(episode, waving_arm.arm_file(folder), outlined, "gantry")


def test_without_joints_it_is_refused(episode: Episode, folder: Path, outlined: Models) -> None:
    robot = replace(episode.robot, joint_positions=np.zeros((LENGTH, 0)))
    with pytest.raises(SourceLacks, match="no recorded joints"):
        calibrate.of_episode(replace(episode, robot=robot), waving_arm.arm_file(folder), outlined)


def test_the_command_says_it_in_words_and_in_json(
    episode: Episode,
    folder: Path,
    found: calibrate.CalibratedEpisode,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.setattr(command, "read_episode", lambda dataset, key: episode)
    monkeypatch.setattr(calibrate, "of_episode", lambda *args: found)
    out = tmp_path / "cameras.yaml"
    given = ["calibrate", str(tmp_path), "--arm", str(waving_arm.arm_file(folder))]
    run = CliRunner().invoke(app, [*given, "--out", str(out)])
    assert run.exit_code == 1  # one camera is left out
    assert "front: within" in run.stdout
    assert out.is_file()
    described = json.loads(CliRunner().invoke(app, [*given, "--json"]).stdout)
    assert described["refused"] == {"wrist": "it moves"}
    assert described["cameras"]["front"]["focal_length_known"] is True
