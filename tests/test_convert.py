"""Datasets in another layout hold the same images, cameras, words and robot."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from rpaug import BadInput, Episode, registry
from rpaug.cli import app
from rpaug.convert import convert


def episodes(root: Path) -> list[Episode]:
    adapter = registry.adapter_for(root)
    return [adapter.read(root, key) for key in adapter.episodes(root)]


def assert_alike(before: Episode, after: Episode, *, exact: bool = True) -> None:
    assert after.length == before.length
    assert after.instruction == before.instruction
    for name, view in before.views.items():
        other = after.views[name]
        assert np.allclose(other.camera.K, view.camera.K)
        assert np.allclose(other.camera.cam_to_world, view.camera.cam_to_world, atol=1e-12)
        for t in range(before.length):
            assert np.array_equal(other.rgb(t), view.rgb(t)) or not exact
            assert view.depth is not None
            assert other.depth is not None
            assert np.allclose(other.depth(t), view.depth(t), atol=0 if exact else 1e-6)
            assert view.ids is not None
            assert other.ids is not None
            assert np.array_equal(other.ids(t), view.ids(t))
    for name in ("joint_positions", "joint_velocities", "gripper_to_world", "gripper_open"):
        assert np.allclose(getattr(after.robot, name), getattr(before.robot, name), atol=1e-5), name


def test_there_and_back_through_rlds(template: Path, tmp_path: Path) -> None:
    done = convert(template, tmp_path / "rlds", "rlds")
    assert (done.episodes, done.failures, done.exit_code) == (2, {}, 0)
    info = json.loads(next((tmp_path / "rlds").rglob("dataset_info.json")).read_text())
    assert [split["name"] for split in info["splits"]] == ["train"]
    assert info["splits"][0]["shardLengths"] == ["2"]
    recorded, there = episodes(template), episodes(tmp_path / "rlds")
    for before, after in zip(recorded, there, strict=True):
        assert_alike(before, after)
    convert(tmp_path / "rlds", tmp_path / "back", "rlbench")
    for before, after in zip(recorded, episodes(tmp_path / "back"), strict=True):
        assert_alike(before, after)


def test_rdt_says_what_its_reader_drops(template: Path, tmp_path: Path) -> None:
    done = convert(template, tmp_path / "rdt", "rdt")
    assert done.episodes == 2
    assert any(
        "fewer than 128 steps" in words and count == 2 for words, count in done.traps.items()
    )
    for before, after in zip(episodes(template), episodes(tmp_path / "rdt"), strict=True):
        assert np.array_equal(
            after.robot.joint_positions[:, 7:13], before.robot.joint_positions[:, :6]
        )


def test_bridge_has_no_joints_for_rdt(samples: Path, tmp_path: Path) -> None:
    done = convert(samples / "rlds_bridge", tmp_path / "rdt", "rdt")
    assert done.exit_code == 2
    assert not (tmp_path / "rdt").exists()
    assert all("joint positions" in reason for reason in done.failures.values())


def test_nothing_is_overwritten(template: Path, tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    with pytest.raises(BadInput, match="already"):
        convert(template, tmp_path / "there", "rlds")


def test_an_unknown_layout_is_named(template: Path, tmp_path: Path) -> None:
    told = ["convert", str(template), "--to", "zip", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, told)
    assert result.exit_code == 2
    assert "rlds" in result.stderr
    told[3] = "rlds"
    result = CliRunner().invoke(app, [*told, "--json"])
    assert result.exit_code == 0
    assert json.loads(result.stdout)["episodes"] == 2
