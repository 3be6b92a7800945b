"""What places of a support look like: a resting hand is none of it, a part that one frame shows apart is."""

from dataclasses import replace

import numpy as np
import pytest
from test_supports_of_videos import RIGHT, TABLE, TAN, THING, H, W, above, mapped

from rpaug.scene.video import support_look
from rpaug.scene.video.frame import PosedFrame
from rpaug.scene.video.instances import BACKGROUND, InstanceMap, Support

SKIN = (150, 80, 70)
OTHER = (186, 152, 96)


def looked() -> tuple[InstanceMap, list[PosedFrame]]:
    """A table whose look three frames told."""
    looks, named = [above(TAN) for _ in range(3)], np.full((H, W), TABLE)
    found = mapped(looks[0], named)
    look = support_look.shown(looks, [named == TABLE] * 3, 0.0, found.cell)
    (support,) = found.supports
    assert support is not None
    return replace(found, supports=(replace(support, look=look),)), looks


def test_a_hand_that_rests_on_the_table_is_told_by_what_it_covers() -> None:
    found, _ = looked()
    frame, ids = above(SKIN), np.full((H, W), TABLE, np.int32)
    moving = np.zeros((H, W), bool)
    moving[15:45, 68:75] = True
    still = np.zeros((H, W), bool)
    hand = found.covered(frame, ids, moving, moving)
    assert hand[RIGHT].mean() > 0.95
    assert not hand[:10].any()
    assert found.covered(frame, ids, still, moving)[RIGHT].mean() > 0.9  # it moves in frames beside
    assert not found.covered(frame, ids, still, still).any()  # glare, and what else changes slowly


def test_other_exposure_covers_nothing() -> None:
    found, _ = looked()
    frame = above(TAN)
    darker = replace(frame, rgb=(0.8 * frame.rgb).astype(np.uint8))
    moving = np.zeros((H, W), bool)
    moving[:5] = True
    hand = found.covered(darker, np.full((H, W), TABLE, np.int32), moving, moving)
    assert (hand == moving).all()


@pytest.mark.parametrize(("color", "told"), [(OTHER, TABLE), (SKIN, THING)])
def test_what_looks_as_other_frames_show_the_support_there_is_it_whatever_its_depth(
    color: tuple[int, int, int], told: int
) -> None:
    found, _ = looked()
    frame = above(color, depth=0.4)
    frame.__dict__["segments"] = np.zeros((H, W), np.int32)
    frame.segments[RIGHT] = 1
    named = np.where(frame.segments == 1, THING, TABLE).astype(np.int32)
    assert (found.segmented(frame, named)[RIGHT] == told).all()


def test_places_that_too_few_frames_show_are_unknown() -> None:
    looks = [above(TAN) for _ in range(2)]
    found = support_look.shown(looks, [np.ones((H, W), bool)] * 2, 0.0, 0.01)
    assert not len(found.codes)
    assert np.isnan(found.off(looks[0], np.ones((H, W), bool))).all()


def test_a_support_without_a_look_covers_nothing() -> None:
    none = np.zeros(0, np.int32)
    bare = InstanceMap(
        1.0, none.astype(np.int64), none, 0, (Support(frozenset([TABLE]), np.zeros(3, np.float32)),)
    )
    moving = np.ones((H, W), bool)
    assert bare.covered(above(TAN), np.full((H, W), BACKGROUND, np.int32), moving, moving) is moving
