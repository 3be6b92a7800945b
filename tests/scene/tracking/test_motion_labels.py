"""What moved a thing is what moved it in most frames, in whatever order."""

import random

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rpaug.scene.tracking import bodies
from rpaug.scene.tracking.bodies import FREE, GRIPPER, STATIC

NAMES = {GRIPPER: "gripper", FREE: "aligned"}
LABELS = st.lists(st.sampled_from([STATIC, GRIPPER, FREE, 2, 3]), min_size=1, max_size=12)


def motion(labels: list[int], residual: float = 0.0) -> str:
    still = np.tile(np.eye(4), (len(labels) + 1, 1, 1))
    return bodies._Track(1, np.array(labels), still, np.zeros(3), 100, False, residual).motion


@given(LABELS, st.randoms(use_true_random=False))
def test_the_label_of_most_frames_that_move(labels: list[int], rng: random.Random) -> None:
    moving = [one for one in labels if one != STATIC]
    found = motion(labels)
    counts = {one: moving.count(one) for one in moving}
    most = [one for one, count in counts.items() if count == max(counts.values())]
    assert found in ({NAMES.get(one, "link") for one in most} or {"static"})
    shuffled = list(labels)
    rng.shuffle(shuffled)
    assert motion(shuffled) == found


@given(LABELS)
def test_a_track_that_explains_nothing_is_of_no_known_motion(labels: list[int]) -> None:
    expected = "static" if all(one == STATIC for one in labels) else "unknown"
    assert motion(labels, 2 * bodies.POOR) == expected
