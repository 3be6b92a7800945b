"""Filled holes continue what lies behind, and say that they were filled."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpaug.render.holes import Edges, Witness, fill
from rpaug.render.zbuffer import Rendered, Source


def tilted(hole: np.ndarray) -> Rendered:
    """A far tilted plane (id 1, depth 2 m and up) with `hole` cut out of it."""
    rows, columns = np.mgrid[: hole.shape[0], : hole.shape[1]]
    depth = np.where(hole, 0, 1 / (0.5 - 0.002 * columns - 0.001 * rows)).astype(np.float32)
    grey = np.where(hole, 0, 0.5).astype(np.float32)[..., None].repeat(3, 2)
    return Rendered(
        rgb=grey, depth=depth, ids=np.where(hole, 0, 1).astype(np.int32),
        source=np.where(hole, -1, 0).astype(np.int16), hole=hole, rough=hole,
    )  # fmt: skip


def square(size=32, low=12, high=18) -> np.ndarray:
    hole = np.zeros((size, size), bool)
    hole[low:high, low:high] = True
    return hole


def test_a_plane_is_continued():
    whole, filled = tilted(np.zeros((32, 32), bool)), fill(tilted(square()))
    np.testing.assert_allclose(filled.depth, whole.depth, rtol=1e-5)
    np.testing.assert_allclose(filled.rgb, whole.rgb, atol=1e-6)
    np.testing.assert_array_equal(filled.ids, whole.ids)
    np.testing.assert_array_equal(filled.hole, square())
    assert (filled.source[square()] == -1).all()


def test_the_farther_side_is_continued():
    """A strip opens between a near thing on its left (id 2, white) and the wall: it becomes wall."""
    hole = np.zeros((24, 32), bool)
    hole[:, 10:16] = True
    view = tilted(hole)
    view.rgb[:, :10], view.depth[:, :10], view.ids[:, :10] = 1.0, 0.5, 2
    filled = fill(view)
    assert (filled.ids[:, 10:16] == 1).all()
    np.testing.assert_allclose(filled.rgb[:, 10:16], 0.5, atol=1e-6)
    assert (filled.depth[:, 10:16] > 1.9).all()


def test_two_backgrounds_meet_along_a_line():
    """A hole across the seam of wall and floor: above it all wall, below all floor, give or take a row."""
    rows, hole = np.mgrid[:32, :32][0], square(32, 8, 24)
    floor = rows >= 16
    near = np.where(floor, 0.5 + 0.02 * (rows - 16), 0.5)
    view = replace(
        tilted(hole),
        depth=np.where(hole, 0, 1 / near).astype(np.float32),
        ids=np.where(hole, 0, np.where(floor, 2, 1)).astype(np.int32),
    )
    filled = fill(view)
    assert (filled.ids[8:15] == 1).all()
    assert (filled.ids[17:24] == 2).all()
    away = np.abs(rows - 15.5) > 2
    np.testing.assert_allclose((1 / filled.depth)[away], near[away], rtol=1e-5)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0, 1))
def test_only_holes_change_and_all_are_filled(seed, share):
    hole = np.random.default_rng(seed).random((13, 17)) < share
    view = tilted(hole)
    filled = fill(view)
    np.testing.assert_array_equal(filled.rgb[~hole], view.rgb[~hole])
    np.testing.assert_array_equal(filled.depth[~hole], view.depth[~hole])
    np.testing.assert_array_equal(filled.ids[~hole], view.ids[~hole])
    assert np.isfinite(filled.rgb).all()
    if not hole.all():
        assert (filled.depth > 1.9).all()
        assert (filled.ids == 1).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1)])
def test_thin_images(shape):
    for hole in (
        np.ones(shape, bool),
        np.zeros(shape, bool),
        np.arange(np.prod(shape)).reshape(shape) > 0,
    ):
        filled = fill(tilted(hole))
        assert np.isfinite(filled.depth).all()
        assert (filled.hole == hole).all()


def test_beside_the_infinitely_far():
    """Holes beside sky become sky: depth 0, no division by it."""
    view = tilted(square())
    view.depth[:] = 0
    filled = fill(view)
    assert (filled.depth == 0).all()
    assert (filled.ids == 1).all()


def _cut_off(hole: np.ndarray, shift: int) -> tuple[Rendered, Witness]:
    """An arm (id 2) before a wall (id 1), and the camera that recorded both and now looks `shift` columns further."""
    arm = np.zeros(hole.shape, bool)
    arm[12:20] = True
    depth = np.where(arm, 1.0, 4.0).astype(np.float32)
    ids = np.where(arm, 2, 1).astype(np.int32)
    K = np.array([[30.0, 0, 15.5], [0, 30.0, 15.5], [0, 0, 1]])
    rgb = np.zeros((*hole.shape, 3), np.uint8)
    recorded = Source(K, np.eye(4), rgb, depth, ids)
    view = Rendered(
        rgb=rgb.astype(np.float32), depth=np.where(hole, 0, depth), ids=np.where(hole, 0, ids),
        source=np.where(hole, -1, 0).astype(np.int16), hole=hole, rough=np.zeros_like(hole),
    )  # fmt: skip
    return view, Witness(recorded, K - [[0, 0, shift], [0, 0, 0], [0, 0, 0]], np.eye(4))


def test_what_the_frame_cut_off_goes_on_beyond_it():
    hole = np.zeros((32, 32), bool)
    hole[:, 22:] = True
    view, witness = _cut_off(hole, shift=10)
    ids = fill(view, witness).ids
    assert (ids[14:18, 22:26] == 2).all()
    assert (ids[:8] == 1).all()
    assert (fill(view).ids[12:20, 30:] == 1).any()  # without it, the wall behind the arm


def test_filling_ends_where_all_that_walks_reach_is_refuted_and_the_first_pixel_shows_a_face() -> (
    None
):
    """A walk that leaves the image names the first pixel; its face was continued there, and nothing was ever chosen."""
    hole = np.zeros((32, 32), bool)
    hole[14:18, 25:] = True  # walks to the right leave the image
    view, witness = _cut_off(hole, shift=0)
    depth = np.where(hole, 9.0, 3.0).astype(np.float32)
    ids = np.ones(hole.shape, np.int32)
    seen = replace(witness.source, depth=depth, ids=ids)  # it saw through what is around the hole
    faces = Edges(
        np.array([1], np.int32), np.array([[0, 0, -1.0, -9.0]]), np.array([[0, 0, -1.0, -20.0]])
    )
    shown = replace(view, depth=np.where(hole, 0, depth), ids=np.where(hole, 0, ids))
    near = np.where(np.arange(32 * 32).reshape(32, 32) == 0, 9.0, shown.depth).astype(np.float32)
    filled = fill(replace(shown, depth=near), replace(witness, source=seen, edges=faces))
    assert (filled.ids[hole] == 1).all()


def test_a_surface_that_the_camera_saw_through_is_not_continued():
    hole = np.zeros((32, 32), bool)
    hole[20:24] = True
    hole[8:12] = True  # the wall was recorded here
    view, witness = _cut_off(hole, shift=0)
    assert (fill(view, witness).ids[hole] == 1).all()


def test_mixed_colors_of_an_outline_are_not_continued():
    hole = square()
    view = tilted(hole)
    rim = np.zeros_like(hole)
    rim[10:20, 10:20] = True
    rgb = np.where((rim & ~hole)[..., None], np.float32(1), view.rgb)
    filled = fill(replace(view, rgb=rgb)).rgb[hole]
    np.testing.assert_allclose(filled, 0.5, atol=1e-6)
