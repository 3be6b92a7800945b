"""Key frames: few, in order, the first and the last among them, and one where it went wrong."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rpaug.diagnosis import Rollout, keyframes
from rpaug.diagnosis.evaluation import CameraShot


def rollout(levels: list[int], failed_at: int | None = None) -> Rollout:
    def shot(level: int) -> CameraShot:
        return CameraShot(lambda: np.full((40, 40, 3), level, np.uint8))

    return Rollout(
        "a", False, "", {"front": dict(enumerate(map(shot, levels)))}, failed_at=failed_at
    )


def test_the_last_stir_is_where_it_went_wrong() -> None:
    levels = [*range(0, 100, 10), *[100] * 30]
    picked = keyframes.select(rollout(levels))
    assert {0, 10, 39} <= set(picked)


def test_where_it_is_told_to_have_gone_wrong_is_taken() -> None:
    assert 25 in keyframes.select(rollout([*range(0, 100, 10), *[100] * 30], failed_at=25))


@given(st.lists(st.integers(0, 255), min_size=1, max_size=60), st.integers(2, 6))
def test_they_are_few_and_in_order(levels: list[int], most: int) -> None:
    picked = keyframes.select(rollout(levels), most)
    assert len(picked) == min(most, len(levels))
    assert list(picked) == sorted(set(picked))
    assert picked[0] == 0
    assert picked[-1] == len(levels) - 1


def test_no_picture_is_no_key_frame() -> None:
    assert keyframes.select(Rollout("a", False, "", {})) == ()
