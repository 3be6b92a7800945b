"""A camera told from every side, or refused: another robot, a robot that stands still, too few frames."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import waving_arm

from rpaug.scene.tracking import outline_calibration, outline_pose
from rpaug.scene.tracking.outline_calibration import CalibratedCamera
from rpaug.scene.tracking.outline_pose import OutlinedFrame


def test_a_camera_is_told_though_nothing_says_where_it_is(tmp_path: Path) -> None:
    frames, shares = waving_arm.frames(waving_arm.arm_file(tmp_path)), list[float]()
    found = outline_calibration.calibrate(frames, waving_arm.LENS, shares.append)
    assert isinstance(found, CalibratedCamera)
    metres, degrees = waving_arm.off(found.cam_to_world)
    assert metres < 0.006
    assert degrees < 0.3
    assert found.overlap > 0.95
    np.testing.assert_allclose(found.lens.K, waving_arm.LENS.K, atol=1e-6)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_another_robot_is_refused(tmp_path: Path) -> None:
    other = waving_arm.frames(waving_arm.arm_file(tmp_path, thick=0.15))
    mine = waving_arm.frames(waving_arm.arm_file(tmp_path))
    mixed = [OutlinedFrame(a.parts, b.mask) for a, b in zip(mine, other, strict=True)]
    said = outline_calibration.calibrate(mixed, waving_arm.LENS)
    assert isinstance(said, str)
    assert "at least 0.75" in said or "at most 20" in said or "from two sides" in said


def test_few_outlines_are_refused(tmp_path: Path) -> None:
    frames = waving_arm.frames(waving_arm.arm_file(tmp_path))[:5]
    said = outline_calibration.calibrate(frames, waving_arm.LENS)
    assert said == "5 frames show the robot's outline; at least 8 are needed"


@pytest.mark.parametrize("halves_apart", [0.0, 0.1])
def test_halves_that_disagree_are_refused(tmp_path: Path, halves_apart: float) -> None:
    frames = [one.sized(96) for one in waving_arm.frames(waving_arm.arm_file(tmp_path))]
    pose = waving_arm.eye()
    best = outline_pose.solve(frames, waving_arm.LENS, pose, (1.0,))
    moved = best.cam_to_world.copy()
    moved[0, 3] += halves_apart
    other = replace(best, cam_to_world=moved)
    found = outline_calibration.judged(frames, best, (best, other), (96, 96))
    if halves_apart:
        assert isinstance(found, str)
        assert "150 mm" in found
    else:
        assert isinstance(found, CalibratedCamera)
