"""The key-frame rule on made-up motions and, with real data, against what its authors' rule gives."""

import numpy as np

from rpaug.core import keyframes
from rpaug.core.types import Robot, Scene


def robot(speeds: list[float], gripper: list[float]) -> Robot:
    length = len(speeds)
    return Robot(
        np.zeros((length, 7)),
        np.tile(np.array(speeds)[:, None], (1, 7)),
        np.tile(np.eye(4), (length, 1, 1)),
        np.array(gripper, float),
    )


def test_gripper_changes_and_the_last_frame_count() -> None:
    assert keyframes.find(robot([1.0] * 12, [1] * 5 + [0] * 7)) == [5, 11]


def test_a_stop_counts_once() -> None:
    speeds = [1.0] * 5 + [0.0] * 4 + [1.0] * 6
    assert keyframes.find(robot(speeds, [1] * 15)) == [5, 14]


def test_a_long_stop_counts_again_after_a_rest() -> None:
    speeds = [1.0] * 5 + [0.0] * 9 + [1.0] * 6
    assert keyframes.find(robot(speeds, [1] * 20)) == [5, 10, 19]


def test_a_change_right_before_the_end_is_the_end() -> None:
    assert keyframes.find(robot([1.0] * 8, [1] * 6 + [0] * 2)) == [7]


def test_a_stop_just_after_the_gripper_acted_does_not_count() -> None:
    speeds = [1.0] * 6 + [0.0, 0.0, 1.0, 1.0, 1.0]
    assert keyframes.find(robot(speeds, [1] * 6 + [0] * 5)) == [6, 10]


def test_one_frame_has_no_key_frame() -> None:
    assert keyframes.find(robot([0.0], [1])) == []


def test_real_key_frames(real: Scene) -> None:
    expected = {"open the top drawer": [70, 85, 124], "open the bottom drawer": [59, 72, 95]}
    assert keyframes.find(real.episode.robot) == expected[real.episode.instruction]
