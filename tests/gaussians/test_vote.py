"""The weighted vote: its weights against single Gaussians drawn one by one, and what bad masks do to it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from boxes import BLOCK, OTHER, PAD, World

from rpaug.core.errors import Unsupported
from rpaug.core.types import Gaussians, Scene
from rpaug.gaussians import semantic
from rpaug.gaussians.gaussians import chosen
from rpaug.gaussians.seeds import seeds

TIMES = (0, 9, 16, 24)


@pytest.fixture(scope="module")
def lifted(placed: tuple[World, Scene]) -> Scene:
    return replace(placed[1], gaussians=seeds(placed[1]))


def given(scene: Scene) -> Gaussians:
    assert scene.gaussians is not None
    return scene.gaussians


def overlap(scene: Scene, ids: np.ndarray) -> float:
    """Mean over handles of the masks' intersection over union, over cameras and times."""
    stage = semantic.LabelRenderer(scene)
    both: dict[int, list[int]] = {}
    for name, view in scene.episode.views.items():
        assert view.ids is not None
        for t in TIMES:
            drawn, true = semantic.mask(ids, stage, name, t), view.ids(t)
            for instance_id in np.unique(true):
                a, b = drawn == instance_id, true == instance_id
                entry = both.setdefault(int(instance_id), [0, 0])
                entry[0] += int((a & b).sum())
                entry[1] += int((a | b).sum())
    return float(np.mean([i / u for i, u in both.values()]))


def test_ballots_are_sums_of_blending_weights(lifted: Scene) -> None:
    rows = np.flatnonzero(given(lifted).ids == OTHER)[:16]
    scene = replace(lifted, gaussians=chosen(given(lifted), rows))
    ids = (np.arange(64 * 64).reshape(64, 64) % 3 - 1).astype(np.int32)
    labels, count = semantic.ballots(scene, [semantic.Labelled("left", 0, ids)])
    assert labels.tolist() == [0, 1]  # -1 is no statement
    one_by_one = (
        semantic.LabelRenderer(scene).draw("left", 0, np.eye(16, dtype=np.float32)).features
    )
    assert one_by_one is not None
    for column, label in enumerate(labels):
        expected = one_by_one[ids == label].sum(0)
        np.testing.assert_allclose(count[:, column], expected, rtol=1e-4, atol=1e-5)
    assert count.sum() > 1


def test_drawn_masks_are_the_recorded_ones_at_every_time(lifted: Scene) -> None:
    ids = semantic.vote(lifted)
    assert (
        overlap(lifted, ids) > 0.86
    )  # at 64 x 64, unfitted: outlines are a tenth of the smaller things
    # Nothing bled over time: no trace of the carried block where it was before or will be.
    stage = semantic.LabelRenderer(lifted)
    for name, view in lifted.episode.views.items():
        assert view.ids is not None
        for t in TIMES:
            near = cv2.dilate((view.ids(t) == BLOCK).astype(np.uint8), np.ones((5, 5), np.uint8))
            assert not ((semantic.mask(ids, stage, name, t) == BLOCK) & (near == 0)).any()


@pytest.mark.parametrize("fault", ["noise", "swaps", "lost"])
def test_bad_masks_are_outvoted(lifted: Scene, fault: str) -> None:
    good = semantic.recorded(lifted)
    rng = np.random.default_rng(1)
    instance_ids = np.unique(given(lifted).ids)

    def spoiled(k: int, ids: np.ndarray) -> np.ndarray:
        if fault == "noise":
            return np.where(rng.random(ids.shape) < 0.1, rng.choice(instance_ids, ids.shape), ids)
        if fault == "swaps":
            swap = {OTHER: PAD, PAD: OTHER} if k % 4 == 0 else {}
            return np.vectorize(lambda h: swap.get(h, h))(ids)
        return np.full_like(ids, semantic.UNKNOWN) if (k // 3) % 2 else ids

    bad = [replace(p, ids=spoiled(k, p.ids).astype(np.int32)) for k, p in enumerate(good)]
    assert (semantic.vote(lifted, bad) == semantic.vote(lifted, good)).mean() > 0.99


def test_wrong_handles_of_still_things_are_mended(lifted: Scene) -> None:
    begun = given(lifted)
    wrong = begun.ids.copy()
    wrong[begun.ids == OTHER] = PAD
    made = semantic.assigned(replace(lifted, gaussians=replace(begun, ids=wrong)))
    assert (given(made).ids[begun.ids == OTHER] == OTHER).mean() > 0.95
    np.testing.assert_array_equal(given(made).means, begun.means)


def test_what_no_picture_shows_keeps_its_handle(lifted: Scene) -> None:
    np.testing.assert_array_equal(semantic.vote(lifted, []), given(lifted).ids)
    blank = semantic.Labelled("left", 0, np.full((64, 64), semantic.UNKNOWN, np.int32))
    np.testing.assert_array_equal(semantic.vote(lifted, [blank]), given(lifted).ids)


def test_what_is_missing_is_said(lifted: Scene, placed: tuple[World, Scene]) -> None:
    with pytest.raises(Unsupported, match="no Gaussians"):
        semantic.vote(placed[1], [])
    with pytest.raises(Unsupported, match=r"\(3, 3\); its images are \(64, 64\)"):
        semantic.vote(lifted, [semantic.Labelled("left", 0, np.zeros((3, 3), np.int32))])
    bare = replace(lifted, episode=placed[0].episode(masks=False))
    with pytest.raises(Unsupported, match="no instance masks"):
        semantic.vote(bare)
