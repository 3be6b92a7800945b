"""Outlines found from staircases of pixels, against the lines that drew them."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rpaug.render.outlines import BEFORE, BEHIND, INSIDE, TOUCHING, _edge, _within, footprints


def halves(angle: float, away: float, far: float, size: int = 15):
    """A near half-plane before a far one, split by a line `away` pixels from the middle pixel's centre."""
    y, x = np.mgrid[:size, :size] - size // 2
    inside = np.cos(angle) * x + np.sin(angle) * y + away >= 0
    return np.where(inside, 1.0, far), np.where(inside, 1, 2).astype(np.int32)


@settings(max_examples=60, deadline=None)
@given(st.floats(0, 2 * np.pi), st.floats(0, 0.5))
def test_an_outline_is_found_to_a_fraction_of_a_pixel(angle, away):
    """Where the middle pixel lies at the outline; half a pixel is what the pixel alone would say."""
    near, ids = halves(angle, away, far=0.5)
    found = footprints(near, ids)
    if found.edge[7, 7] != BEFORE:
        return
    a, b, c = found.line[7, 7]
    assert abs(np.hypot(a, b) - 1) < 1e-12
    assert a * np.cos(angle) + b * np.sin(angle) > 0.9
    assert abs(c - away) < 0.55  # along rows or columns nothing tells more than the pixels do


def test_outlines_are_found_on_average_twice_as_well_as_by_pixels():
    rng = np.random.default_rng(0)
    better, plain = [], []
    spots = np.stack(np.meshgrid(*2 * [np.linspace(-0.5, 0.5, 9)]), -1).reshape(-1, 2)
    for _ in range(300):
        angle, away = rng.uniform(0, 2 * np.pi), rng.uniform(0, 0.5)
        near, ids = halves(angle, away, far=0.5)
        found = footprints(near, ids)
        if found.edge[7, 7] != BEFORE:
            continue
        truth = spots @ (np.cos(angle), np.sin(angle)) + away >= 0
        line = found.line[7, 7]
        better.append(np.mean((spots @ line[:2] + line[2] >= 0) != truth))
        plain.append(np.mean(~truth))
    assert np.mean(better) < np.mean(plain) / 2


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_pixels_centre_is_always_its_own(seed):
    """However jagged the ids, so that an unmoved camera gives its recording."""
    rng = np.random.default_rng(seed)
    ids = rng.integers(0, 3, (9, 9)).astype(np.int32)
    found = footprints(rng.uniform(0.3, 1.0, (9, 9)), ids)
    assert (found.line[found.edge >= TOUCHING][:, 2] > 0).all()
    assert np.isfinite(found.line).all()


def test_what_a_pixel_is_to_its_neighbours():
    near, ids = halves(0.0, 0.2, far=0.5)
    edge = footprints(near, ids).edge
    assert (edge[:, 7] == BEFORE).all()
    assert (edge[:, 6] == BEHIND).all()
    assert (np.delete(edge, [6, 7], axis=1) == INSIDE).all()
    edge = footprints(np.ones_like(near), ids).edge
    assert (edge[:, 6:8] == TOUCHING).all()
    one = footprints(np.ones_like(near), np.ones_like(ids))
    assert (one.edge == INSIDE).all()
    assert not one.slope.any()


def standing(contact: int = 9, wall: float = 0.0, size: int = 17):
    """A wall that faces the camera and the table that it stands on; the table comes nearer from row `contact` on."""
    rows = np.mgrid[:size, :size][0]
    below = rows >= contact
    near = np.where(below, 1.0 + 0.02 * (rows - contact + 0.5), 1.0 + wall)
    return near, np.where(below, 2, 1).astype(np.int32)


def test_a_thing_ends_where_it_meets_what_it_stands_on():
    """The table before it is nearer than the wall, and yet hides nothing of it."""
    near, ids = standing()
    found = footprints(near, ids)
    assert (found.edge[8] == TOUCHING).all()
    a, b, c = found.line[8, 8]
    assert abs(a) < 1e-9
    assert b == -1.0
    assert abs(c - 0.5) < 0.3


def test_what_hides_a_thing_does_not_end_it():
    near, ids = standing(wall=-0.3)
    assert (footprints(near, ids).edge[8] == BEHIND).all()


@settings(max_examples=60, deadline=None)
@given(st.floats(0, 2 * np.pi), st.floats(0, 0.5))
def test_no_outline_takes_in_a_neighbours_centre(angle, away):
    near, ids = halves(angle, away, far=0.5)
    found = footprints(near, ids)
    a, b, c = found.line[7, 7]
    if found.edge[7, 7] != BEFORE:
        return
    for down, right in [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)]:
        out = -a * right - b * down
        if ids[7 + down, 7 + right] == 2 and out > 0.04:
            assert c < out


def test_what_lies_within_a_surface_is_found_at_once_as_pixel_by_pixel():
    """Noise, an unknown pixel and one infinitely far among two things; `_within` is the fast test before `_edge`."""
    rng = np.random.default_rng(0)
    near, ids = halves(0.6, 0.2, far=0.5, size=40)
    near *= 1 + rng.normal(0, 0.01, near.shape)
    near[8, 9], near[30, 31] = -1.0, 0.0
    slope, within = footprints(near, ids).slope, np.empty(40, bool)
    told = {True: 0, False: 0}
    for row in range(40):
        _within(near, ids, slope, row, within)
        for column in np.flatnonzero(near[row] > 0):
            found = _edge.py_func(near, ids, slope, 0.006, row, column)
            assert within[column] == (found == INSIDE)
            told[found == INSIDE] += 1
    assert min(told.values()) > 100
