"""Holes and flying pixels of measured depth; what is known of a plane tells the rest of it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpaug.render import denoise

SHAPE = (40, 48)
ROWS, COLUMNS = np.mgrid[: SHAPE[0], : SHAPE[1]]


def plane(a: float, b: float, c: float) -> np.ndarray:
    """Depth of a plane: 1/z is affine over the image."""
    return (1 / (a + b * COLUMNS + c * ROWS)).astype(np.float32)


@settings(deadline=None)  # the kernel is compiled in the first
@given(
    slopes=st.tuples(st.floats(-0.004, 0.004), st.floats(-0.004, 0.004)),
    lost=st.floats(0.05, 0.6),
    seed=st.integers(0, 99),
)
def test_holes_lie_on_the_plane_around_them(slopes, lost, seed) -> None:
    whole = plane(1.0, *slopes)
    holes = np.random.default_rng(seed).random(SHAPE) < lost
    found = denoise.filled(np.where(holes, 0, whole), np.ones(SHAPE, np.int32), 12)
    np.testing.assert_array_equal(found[~holes], whole[~holes])
    assert (found > 0).all()
    np.testing.assert_allclose(found, whole, rtol=2e-3)


def test_a_hole_is_told_by_its_own_instance_alone() -> None:
    table, cup = plane(1.0, 0.001, 0.002), plane(1.5, 0, 0)
    ids = np.where(COLUMNS < 24, 1, 2).astype(np.int32)
    whole = np.where(ids == 1, table, cup)
    holes = abs(COLUMNS - 23.5) < 4
    found = denoise.filled(np.where(holes, 0, whole), ids, 16)
    np.testing.assert_allclose(found, whole, rtol=1e-5)


def test_where_two_surfaces_are_near_a_hole_shows_the_farther_one() -> None:
    near, far = plane(2.0, 0, 0), plane(1.0, 0, 0.002)
    whole = np.where(COLUMNS < 20, near, far)
    shadow = (COLUMNS >= 20) & (COLUMNS < 25)
    found = denoise.filled(np.where(shadow, 0, whole), np.zeros(SHAPE, np.int32), 16)
    np.testing.assert_allclose(found[shadow], far[shadow], rtol=1e-5)


def test_what_is_too_far_from_all_that_is_known_stays_a_hole() -> None:
    depth = np.where(COLUMNS < 10, plane(1.0, 0, 0), np.float32(0))
    found = denoise.filled(depth, np.zeros(SHAPE, np.int32), 6)
    assert (found[:, 16:] == 0).all()
    assert (found[:, :12] > 0).all()


@pytest.mark.parametrize("inner", [1, 3])
def test_a_known_pixel_may_be_told_by_those_around_it(inner) -> None:
    depth = plane(1.0, 0.002, -0.001)
    depth[20, 24] = 5.0  # of no use for itself
    found = denoise.filled(depth, np.zeros(SHAPE, np.int32), 12, inner)
    assert found[20, 24] == pytest.approx(plane(1.0, 0.002, -0.001)[20, 24], rel=1e-4)


def test_pixels_that_fly_between_two_surfaces_are_dropped_and_edges_stay() -> None:
    near, far = plane(2.0, 0, 0), plane(1.0, 0, 0)
    whole = np.where(COLUMNS < 20, near, far)
    flying = (COLUMNS == 20) & (ROWS % 3 == 0)
    seen = np.where(flying, np.float32(0.7), whole)
    found = denoise.grounded(seen, np.zeros(SHAPE, np.int32), 1e-3)
    np.testing.assert_array_equal(found == 0, flying)
    np.testing.assert_array_equal(found[~flying], whole[~flying])


def test_thin_things_with_an_id_of_their_own_do_not_fly() -> None:
    depth, ids = plane(1.0, 0, 0), np.zeros(SHAPE, np.int32)
    depth[:, 24:26], ids[:, 24:26] = 0.5, 3
    np.testing.assert_array_equal(denoise.grounded(depth, ids, 1e-3), depth)


@pytest.mark.parametrize("unit", ["disparity", "depth"])
def test_depth_in_steps_is_told_from_depth_that_is_smooth(unit) -> None:
    whole, ids = plane(0.5, 0.0012, 0.0007), np.zeros(SHAPE, np.int32)
    if unit == "disparity":
        step = 0.003  # 1/m, as a Kinect has at two metres
        seen = (1 / (np.rint(1 / whole / step) * step)).astype(np.float32)
        share = np.median(whole) * step
    else:
        step = 0.01
        seen = (np.rint(whole / step) * step).astype(np.float32)
        share = step / np.median(whole)
    assert denoise.steps(seen, ids) == pytest.approx(share / np.sqrt(12), rel=0.15)
    assert denoise.steps(whole, ids) == 0


def test_a_table_seen_from_above_has_no_steps() -> None:
    ids = np.ones(SHAPE, np.int32)
    depth = np.full(SHAPE, 1.0, np.float32)
    rise = np.sqrt(np.maximum(144 - (ROWS - 20) ** 2 - (COLUMNS - 24) ** 2, 0))
    depth -= (0.002 * rise).astype(np.float32)
    assert denoise.steps(depth, ids) == 0


def test_a_level_camera_sees_rows_of_equal_depth_and_no_steps() -> None:
    depth, ids = plane(0.8, 0.0, 0.004), np.zeros(SHAPE, np.int32)
    depth[:, 30:] *= 0.99  # and one step along each row
    assert denoise.steps(depth, ids) == 0
