"""Colors on bodies: what went in comes out, near, far and in between, and never on another thing."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rpaug.gaussians.painting import Painting, corners, places

A, B = 7, 0xABCDEF


def plane(count: int = 40, cell: float = 0.01) -> np.ndarray:
    """Points a cell apart on a level square."""
    axis = np.arange(count) * cell
    x, y = np.meshgrid(axis, axis)
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.25)], -1).astype(np.float32)


def filled(number: int, count: int) -> np.ndarray:
    return np.full(count, number, np.int32)


def test_a_ramp_is_read_as_a_ramp():
    points = plane()
    painting = Painting.of(filled(A, len(points)), points, points[:, :1], 0.01)
    asked = points[np.all((points[:, :2] > 0.05) & (points[:, :2] < 0.3), axis=1)] + 0.003
    found, weight = painting.at(filled(A, len(asked)), asked, np.zeros(len(asked), np.float32))
    assert (weight > 0).all()
    assert np.abs(found[:, 0] - asked[:, 0]).max() < 1e-6  # trilinear: exact on what is linear


def test_whoever_stands_far_away_sees_the_mean():
    points = plane()
    checks = ((np.rint(points[:, 0] / 0.01) + np.rint(points[:, 1] / 0.01)) % 2)[:, None]
    painting = Painting.of(filled(A, len(points)), points, checks.astype(np.float32), 0.01)
    middle = np.array([[0.2, 0.2, 0.25]], np.float32)
    near, _ = painting.at(filled(A, 1), middle, np.float32([0.005]))
    far, _ = painting.at(filled(A, 1), middle, np.float32([0.08]))
    assert near[0, 0] < 1e-4  # points are float32
    assert abs(far[0, 0] - 0.5) < 0.05


def test_two_things_do_not_mix_though_they_touch():
    points = plane()
    both = np.concatenate([points, points])
    ids = np.concatenate([filled(A, len(points)), filled(B, len(points))])
    painting = Painting.of(ids, both, (ids == B).astype(np.float32)[:, None], 0.01)
    width = np.zeros(len(points), np.float32)
    assert (painting.at(filled(A, len(points)), points, width)[0] == 0).all()
    assert (painting.at(filled(B, len(points)), points, width)[0] == 1).all()
    assert (painting.at(filled(99, len(points)), points, width)[1] == 0).all()


def test_where_nothing_was_sampled_the_neighbourhood_tells():
    points = plane()
    kept = points[np.abs(points[:, 0] - 0.2) > 0.03]
    painting = Painting.of(filled(A, len(kept)), kept, np.ones((len(kept), 1), np.float32), 0.01)
    found, weight = painting.at(filled(A, 1), np.float32([[0.2, 0.2, 0.25]]), np.float32([0.01]))
    assert weight[0] > 0
    assert found[0, 0] == 1
    _, nowhere = painting.at(filled(A, 1), np.float32([[900, 0, 0]]), np.float32([0.01]))
    assert nowhere[0] == 0


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 1.0), st.floats(-300, 300))
def test_values_stay_among_those_sampled(seed, cell, place):
    rng = np.random.default_rng(seed)
    points = (place + rng.uniform(-5 * cell, 5 * cell, (60, 3))).astype(np.float32)
    ids = rng.choice([A, B], 60).astype(np.int32)
    values = rng.uniform(-1, 2, (60, 2)).astype(np.float32)
    painting = Painting.of(ids, points, values, cell)
    asked = (place + rng.uniform(-9 * cell, 9 * cell, (40, 3))).astype(np.float32)
    found, weight = painting.at(ids[:40], asked, rng.uniform(0, 4 * cell, 40).astype(np.float32))
    known = found[weight > 0]
    assert (known >= values.min(0) - 1e-5).all()
    assert (known <= values.max(0) + 1e-5).all()


def test_keys_lead_back_to_their_places():
    rng = np.random.default_rng(0)
    points = rng.uniform(-3, 3, (50, 3)).astype(np.float32)
    ids = rng.choice([A, B], 50).astype(np.int32)
    instance_ids = np.unique(ids)
    keys, shares = corners(instance_ids, ids, points, 0.1)
    assert np.allclose(shares.sum(0), 1)
    back = np.zeros((50, 3))
    for k, share in zip(keys, shares, strict=True):
        owner, at = places(instance_ids, k, 0.1)
        assert (owner == ids).all()
        back += share[:, None] * at
    assert np.abs(back - points).max() < 1e-5  # trilinear shares reproduce the point itself
