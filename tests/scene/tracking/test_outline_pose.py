"""A camera brought onto outlines: the true pose is found from beside it, whatever hides a part, and told how surely."""

from dataclasses import replace

import numpy as np
import pytest
import waving_arm

from rpaug.core import geometry
from rpaug.scene.tracking import outline_pose
from rpaug.scene.tracking.outline_pose import OutlinedFrame, OutlineLens

BESIDE = geometry.rigid(np.array([0.02, -0.03, 0.03]), np.array([0.03, -0.02, 0.05]))


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> list[OutlinedFrame]:
    return waving_arm.frames(waving_arm.arm_file(tmp_path_factory.mktemp("arm")))


def fine(frames: list[OutlinedFrame]) -> tuple[list[OutlinedFrame], OutlineLens]:
    made = [frame.sized(192) for frame in frames]
    return made, waving_arm.LENS.scaled(frames[0].mask.shape, made[0].mask.shape)


def test_the_pose_is_found_from_beside_it(frames: list[OutlinedFrame]) -> None:
    made, lens = fine(frames)
    found = outline_pose.solve(made, lens, waving_arm.eye() @ BESIDE)
    metres, degrees = waving_arm.off(found.cam_to_world)
    assert metres < 0.006
    assert degrees < 0.3
    assert outline_pose.overlaps(made, lens, found.cam_to_world).min() > 0.95


def test_what_hides_the_robot_pulls_the_pose_little(frames: list[OutlinedFrame]) -> None:
    hidden = []
    for frame in frames:
        mask = frame.mask.copy()
        mask[:, 40:52] &= np.arange(waving_arm.SIZE)[:, None] > 40  # a post before the upper arm
        hidden.append(replace(frame, mask=mask))
    made, lens = fine(hidden)
    metres, _ = waving_arm.off(
        outline_pose.solve(made, lens, waving_arm.eye() @ BESIDE).cam_to_world
    )
    assert metres < 0.012


def test_an_unknown_focal_length_is_worked_out(frames: list[OutlinedFrame]) -> None:
    made, lens = fine(frames)
    wrong = replace(lens.zoomed(1.08), known=False)
    found = outline_pose.solve(made, wrong, waving_arm.eye() @ BESIDE)
    assert found.lens.K[0, 0] == pytest.approx(lens.K[0, 0], rel=0.02)


def test_masks_that_are_off_more_are_told_to_be_less_sure(frames: list[OutlinedFrame]) -> None:
    rng, spreads = np.random.default_rng(0), []
    for most in (0, 2):
        shifts = rng.integers(-most, most + 1, (len(frames), 2))
        moved = [
            replace(frame, mask=np.roll(frame.mask, shift, (0, 1)))
            for frame, shift in zip(frames, shifts.tolist(), strict=True)
        ]
        made, lens = fine(moved)
        spreads.append(outline_pose.solve(made, lens, waving_arm.eye()).spread()[0])
    assert spreads[1] > 2 * spreads[0]


def test_a_mask_made_finer_keeps_its_place() -> None:
    mask = np.zeros((20, 30), bool)
    mask[5:14, 8:21] = True
    made = OutlinedFrame((), mask).sized(120)
    rows, columns = np.nonzero(made.mask)
    lens = OutlineLens(np.eye(3)).scaled(mask.shape, made.mask.shape).K
    np.testing.assert_allclose([columns.mean(), rows.mean()], (lens @ [14.0, 9.0, 1])[:2], atol=0.1)
    assert made.mask.sum() == pytest.approx(16 * mask.sum(), rel=0.03)
