"""The scripted motions: smooth, still at key frames, within limits, carrying what they hold."""

import numpy as np
import pytest

from rpaug import Unsupported
from rpaug.core import geometry
from rpaug.twin.motion import STEP, Motion, play
from rpaug.twin.panda import FINGER_END, HIGHEST, LOWEST, OPEN
from rpaug.twin.staging import StagedTask
from rpaug.twin.tabletop import (
    ARM,
    BLOCK,
    BUTTON_TOP,
    BUTTON_TRAVEL,
    FLOOR_OF_CUP,
    LID_OPEN,
    TABLE,
)
from rpaug.twin.tasks import PULL, TASKS


def acted(task: str, seed: int, frames: int) -> tuple[StagedTask, Motion]:
    job = TASKS[task](np.random.default_rng(seed))
    return job, play(ARM, job.script, job.placing, frames)


@pytest.mark.parametrize("task", TASKS)
def test_every_seed_is_reachable(task):
    for seed in range(12):
        _, motion = acted(task, seed, 24)
        assert (motion.joint_positions >= LOWEST).all()
        assert (motion.joint_positions <= HIGHEST).all()


@pytest.mark.parametrize("task", TASKS)
def test_velocity_is_the_derivative_of_position(task):
    # A finely sampled motion: central differences miss the derivative by O(step^2) of its curvature.
    _, motion = acted(task, 0, 400)
    slope = (motion.joint_positions[2:] - motion.joint_positions[:-2]) / (2 * STEP)
    inner = np.setdiff1d(np.arange(1, 399), [key + d for key in motion.keys for d in (-1, 0, 1)])
    np.testing.assert_allclose(motion.joint_velocities[inner], slope[inner - 1], atol=0.01)


@pytest.mark.parametrize("task", TASKS)
def test_the_arm_stands_still_at_key_frames(task):
    _, motion = acted(task, 1, 60)
    for key in (0, *motion.keys):
        assert np.abs(motion.joint_velocities[key]).max() < 1e-9


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("frames", [17, 24, 60, 125])
def test_length_and_legs(task, frames):
    job, motion = acted(task, 2, frames)
    assert motion.length == frames == len(motion.joint_positions)
    assert motion.keys[-1] == frames - 1
    assert (np.diff((0, *motion.keys)) >= 2).all()
    assert len(motion.keys) == len(job.script)


def test_the_drawer_slides_with_the_gripper():
    job, motion = acted("open_drawer", 4, 40)
    start, end = motion.keys[2], motion.keys[3]
    drawer, tip = motion.objects["drawer"], motion.gripper_to_world
    np.testing.assert_array_equal(drawer[: start + 1], np.tile(drawer[0], (start + 1, 1, 1)))
    moved = drawer[:, :3, 3] - drawer[0, :3, 3]
    np.testing.assert_allclose(moved[end], PULL * job.placing["cabinet"][:3, 0], atol=1e-8)
    # Straight along its rail and never turned, to what inverse kinematics leaves over.
    np.testing.assert_allclose(drawer[:, :3, :3], np.tile(drawer[0, :3, :3], (40, 1, 1)), atol=1e-8)
    held = geometry.inverse(tip[start:]) @ drawer[start:]
    np.testing.assert_allclose(held, np.tile(held[0], (len(held), 1, 1)), atol=1e-12)
    for name in set(motion.objects) - {"drawer"}:
        assert (motion.objects[name] == motion.objects[name][0]).all()


def test_the_lid_turns_about_its_hinge_until_it_lies_on_the_box():
    job, motion = acted("close_box", 3, 40)
    lid, box = motion.objects["lid"], job.placing["box"]
    hinge = np.tile(lid[0, :3, 3], (40, 1))
    np.testing.assert_allclose(lid[:, :3, 3], hinge, atol=1e-8)
    np.testing.assert_allclose(lid[:, :3, 1], np.tile(box[:3, 1], (40, 1)), atol=1e-8)
    np.testing.assert_allclose(lid[-1, :3, :3], box[:3, :3], atol=1e-8)
    assert np.arccos(lid[0, :3, 2] @ box[:3, 2]) == pytest.approx(LID_OPEN)


def test_the_block_lands_on_the_pad():
    job, motion = acted("pick_block", 6, 60)
    block, pad = motion.objects[job.manipulated], job.placing["pad"]
    np.testing.assert_allclose(block[-1, :2, 3], pad[:2, 3], atol=1e-8)
    assert block[:, 2, 3].max() > block[0, 2, 3] + 0.08
    assert motion.opening[0] == motion.opening[-1] == OPEN


def test_the_button_goes_down_and_stays():
    job, motion = acted("push_button", 3, 40)
    button = motion.objects["button"]
    start, end = motion.keys[1], motion.keys[2]
    down = button[0, 2, 3] - button[:, 2, 3]
    assert (np.abs(down[: start + 1]) < 1e-12).all()
    np.testing.assert_allclose(down[end:], BUTTON_TRAVEL, atol=1e-8)
    assert (np.diff(down[start : end + 1]) > 0).all()
    np.testing.assert_array_equal(motion.objects["button_base"], button[:1].repeat(40, 0))
    # The closed fingers touch the cap all the way.
    tip = motion.gripper_to_world[start : end + 1, 2, 3]
    gap = tip - FINGER_END - BUTTON_TOP - button[start : end + 1, 2, 3]
    np.testing.assert_allclose(gap, 0, atol=1e-8)
    assert job.receiver == "button_base"


@pytest.mark.parametrize(
    ("task", "high"),
    [("slide_block", BLOCK[2]), ("stack_cups", FLOOR_OF_CUP), ("put_in_box", 0.053)],
)
def test_what_is_moved_ends_on_its_receiver(task, high):
    job, motion = acted(task, 4, 60)
    assert job.receiver is not None
    moved, receiver = motion.objects[job.manipulated][-1], job.placing[job.receiver]
    np.testing.assert_allclose(moved[:2, 3], receiver[:2, 3], atol=1e-8)
    np.testing.assert_allclose(moved[2, 3], TABLE + high, atol=1e-8)
    np.testing.assert_allclose(moved[2, :3], [0, 0, 1], atol=1e-8)
    for name in set(motion.objects) - {job.manipulated}:
        assert (motion.objects[name] == motion.objects[name][0]).all()


def test_too_few_frames():
    with pytest.raises(Unsupported, match="11 or more"):
        acted("open_drawer", 0, 5)
