"""Instances told by motion alone, against worlds of boxes whose masks are known."""

from dataclasses import replace

import boxes
import numpy as np
import pytest

from rpaug.compose import views
from rpaug.core.types import Episode
from rpaug.scene.build import build
from rpaug.scene.instances import by_motion, regions


def overlap(found: by_motion.Segmentation, truth: Episode, instance_id: int) -> tuple[float, int]:
    """Best IoU of one true instance with any found one, over all images, and which."""
    counts: dict[int, np.ndarray] = {}
    total = 0
    for name, view in truth.views.items():
        for t in range(truth.length):
            got, true = found.ids(name, t), view.ids(t) == instance_id
            total += true.sum()
            for one in np.unique(got).tolist():
                mine = got == one
                seen = np.array([(mine & true).sum(), mine.sum()])
                counts[one] = counts.get(one, np.zeros(2)) + seen
    iou = {one: both / (total + mine - both) for one, (both, mine) in counts.items()}
    best = max(iou, key=lambda one: iou[one])
    return iou[best], best


@pytest.fixture(scope="module")
def carried():
    world = boxes.pick_and_place()
    truth = world.episode()
    return truth, by_motion.segment(world.episode(masks=False))


def test_what_is_carried_and_what_carries(carried):
    truth, found = carried
    block, held = overlap(found, truth, boxes.BLOCK)
    hand, gripper = overlap(found, truth, boxes.HAND)
    assert block > 0.7
    assert hand > 0.7
    assert found.names[held].startswith("held")
    assert found.names[gripper] == "gripper"


def test_what_stands_still_is_one(carried):
    truth, found = carried
    moving = [boxes.BLOCK, boxes.HAND]
    wrong = total = 0
    for name, view in truth.views.items():
        for t in range(truth.length):
            true, got = np.isin(view.ids(t), moving), found.ids(name, t) > 1
            wrong += (true & got).sum()
            total += (true | got).sum()
    assert wrong / total > 0.8


def test_what_is_pushed_without_being_held():
    world = boxes.push()
    truth = world.episode()
    open_all_the_time = replace(world, gripper_open=np.ones(len(world.gripper_open)))
    found = by_motion.segment(open_all_the_time.episode(masks=False))
    block, instance_id = overlap(found, truth, boxes.BLOCK)
    assert block > 0.6
    assert found.names[instance_id].startswith(("pushed", "held"))


def test_bodies_follow_from_it():
    world = boxes.pick_and_place()
    scene = build(world.episode(masks=False), with_bodies=True)
    kinds = {body.motion for body in scene.bodies}
    assert {"static", "gripper"} <= kinds
    # What was told by motion is for the scene: no copy of the dataset gets masks it never had.
    made = views.edited(scene, dict.fromkeys(scene.episode.views, 0), lambda *ignored: None)
    assert all(view.ids is None for view in made.views.values())


def test_recorded_masks_are_kept():
    episode = boxes.still(3).episode()
    assert by_motion.masked(episode) is episode


def test_one_frame_has_no_motion():
    episode = boxes.still(1).episode(masks=False)
    assert by_motion.masked(episode) is episode


def test_regions_hang_together():
    rng = np.random.default_rng(0)
    near, far = rng.uniform(0, 0.2, (300, 3)), rng.uniform(1.0, 1.1, (100, 3))
    found = regions.connected(np.concatenate([near, far, [[5.0, 5, 5]]]), 0.05, 10)
    assert found.count == 2
    np.testing.assert_array_equal(found.of(near), 0)
    np.testing.assert_array_equal(found.of(far), 1)
    assert found.of(np.array([[5.0, 5, 5], [9, 9, 9]])).tolist() == [-1, -1]


def test_specks_take_what_is_around_them():
    instance_ids = np.ones((9, 9), np.int32)
    instance_ids[4:, :] = 2
    instance_ids[1, 1] = 2
    clean = regions.tidied(instance_ids, np.ones((9, 9), np.float32))
    assert clean[1, 1] == 1
    assert (clean[4:] == 2).all()
