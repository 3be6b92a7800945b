"""Links that look like others when taken alone, told by their row."""

import numpy as np
import pytest

from rpaug.scene.tracking.chain import ChainPosition, places
from rpaug.scene.tracking.motion import GRIPPER, STATIC

LINK = {number: GRIPPER + number for number in range(1, 7)}
FAR = 9.0


def fits(*good: tuple[float, ...]) -> dict[int, np.ndarray]:
    """What eight motions leave of instances 10, 11, ...: FAR but for (label, cost) pairs."""
    out = {}
    for number, pairs in enumerate(good):
        row = np.full(8, FAR)
        for label, cost in zip(pairs[::2], pairs[1::2], strict=True):
            row[int(label)] = cost
        out[10 + number] = row
    return out


def row_of(instance_ids: range) -> set[frozenset[int]]:
    return {frozenset((a, a + 1)) for a in instance_ids[:-1]}


def arm() -> dict[int, np.ndarray]:
    """A base, a first link that looks at rest, links 2 to 6, a hand."""
    return fits(
        (STATIC, 0.0, LINK[1], 0.1),
        (STATIC, 0.3, LINK[1], 0.3),
        (LINK[2], 0.3, LINK[3], 0.31),
        (LINK[3], 0.3, LINK[2], 0.3),
        (LINK[4], 0.3),
        (LINK[5], 0.3),
        (LINK[6], 0.3, GRIPPER, 0.3),
        (GRIPPER, 0.3, LINK[6], 0.3),
    )


def limits(found: dict[int, np.ndarray]) -> dict[int, float]:
    return {instance_id: 1.25 * float(fit.min()) + 0.15 for instance_id, fit in found.items()}


def test_each_link_has_one_place() -> None:
    found = arm()
    expected = {10 + k: ChainPosition(LINK[k], certain=True) for k in range(1, 7)}
    expected[17] = ChainPosition(GRIPPER, certain=True)
    assert places(found, limits(found), row_of(range(10, 18))) == expected


def test_the_order_of_the_handles_does_not_matter() -> None:
    found = arm()
    turned = dict(reversed(found.items()))
    touch = row_of(range(10, 18))
    assert places(turned, limits(found), touch) == places(found, limits(found), touch)


def test_a_thing_at_rest_beside_the_arm_is_no_link() -> None:
    found = arm() | {30: fits((STATIC, 0.2, LINK[1], 0.25))[10]}
    settled = places(found, limits(found), row_of(range(10, 18)) | {frozenset((30, 14))})
    assert 30 not in settled
    assert settled[11] == ChainPosition(LINK[1], certain=True)


@pytest.mark.parametrize("seen", [range(10, 12), range(10, 13)])
def test_too_few_moving_links_tell_nothing(seen: range) -> None:
    found = {instance_id: fit for instance_id, fit in arm().items() if instance_id in seen}
    assert places(found, limits(found), row_of(seen)) == {}


def test_a_row_that_ends_early_leaves_its_end_uncertain_where_another_place_is_free() -> None:
    found = fits((LINK[2], 0.3, LINK[1], 0.3), (LINK[3], 0.3), (LINK[4], 0.3))
    settled = places(found, limits(found), row_of(range(10, 13)))
    assert settled[10] == ChainPosition(LINK[2], certain=False)
    assert settled[11].certain
    assert settled[12].certain


def test_without_an_arm_there_are_no_places() -> None:
    assert places({1: np.zeros(2), 2: np.zeros(2)}, {1: 1.0, 2: 1.0}, {frozenset((1, 2))}) == {}
    assert places({}, {}, set()) == {}
