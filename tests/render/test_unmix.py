"""Colors that outlines mixed."""

from dataclasses import replace

import numpy as np

from rpaug.render.holes import Witness
from rpaug.render.unmix import plain, slits, unmixed
from rpaug.render.zbuffer import Rendered, Source

FAR, NEAR = 4.0, 1.0
LENS = np.array([[32.0, 0, 16], [0, 32.0, 16], [0, 0, 1]])
WALL, MIXED, RED = 0.25, 0.6, 1.0


def recording(near: np.ndarray, rgb: np.ndarray) -> Source:
    """A wall (id 1), and a thing (id 2) before it at the pixels `near`."""
    return Source(
        LENS, np.eye(4), rgb=np.rint(255 * rgb).astype(np.uint8)[..., None].repeat(3, 2),
        depth=np.where(near, NEAR, FAR).astype(np.float32), ids=np.where(near, 2, 1).astype(np.int32),
    )  # fmt: skip


def test_a_recording_for_other_places_has_no_mixtures() -> None:
    near = np.zeros((32, 32), bool)
    near[:, 12:18] = True
    rgb = np.where(near, RED, WALL)
    rgb[:, [11, 18]] = MIXED
    clean = plain(recording(near, rgb))
    assert (clean.rgb[near] == 255).all()
    assert (clean.rgb[~near] == round(255 * WALL)).all()
    assert clean.use is not None
    assert clean.use.all()


def test_what_peeks_out_is_not_used_and_what_is_thin_keeps_its_color() -> None:
    near = np.zeros((32, 32), bool)
    near[:, 10:20] = True
    near[:, 15] = False  # a slit
    near[:, 28] = True  # a rod
    rgb = np.where(near, RED, WALL)
    rgb[:, 15] = rgb[:, 28] = MIXED
    clean = plain(recording(near, rgb))
    assert clean.use is not None
    assert not clean.use[:, 15].any()
    assert clean.use[:, 28].all()
    assert (clean.rgb[:, 28] == round(255 * MIXED)).all()


def test_slits_are_what_is_nowhere_wider_than_its_outline_behind_something() -> None:
    near = np.zeros((32, 32), bool)
    near[:, 10:20] = True
    near[4:28, 15] = False  # a slit
    near[4:28, 12:14] = True
    source = recording(near, np.where(near, RED, WALL))
    found = slits(source.depth, source.ids)
    assert found[4:28, 15].all()
    found[4:28, 15] = False
    assert not found.any()


def test_things_that_lie_in_one_plane_are_left() -> None:
    near = np.zeros((32, 32), bool)
    near[:, 12:18] = True
    rgb = np.where(near, RED, WALL)
    rgb[:, 18] = MIXED
    flat = recording(near, rgb)
    flat.depth[:] = FAR
    np.testing.assert_array_equal(plain(flat).rgb, flat.rgb)


def moved_aside(rgb: np.ndarray, near: np.ndarray) -> tuple[Rendered, Witness]:
    """A view in which the thing that a camera recorded is gone, and its place a hole."""
    source = recording(near, rgb)
    view = Rendered(
        rgb=rgb.astype(np.float32)[..., None].repeat(3, 2), depth=np.where(near, 0, FAR).astype(np.float32),
        ids=np.where(near, 0, 1).astype(np.int32), source=np.where(near, -1, 0).astype(np.int16),
        hole=near.copy(), rough=near.copy(),
    )  # fmt: skip
    return view, Witness(source, LENS, np.eye(4))


def test_outlines_of_what_moved_aside_are_clean_two_pixels_deep() -> None:
    near = np.zeros((32, 32), bool)
    near[:, 12:18] = True
    rgb = np.where(near, RED, WALL)
    rgb[:, [11, 18]] = MIXED
    view, witness = moved_aside(rgb, near)
    clean = unmixed(view, witness)
    np.testing.assert_allclose(clean.rgb[~near], WALL, atol=1e-6)
    np.testing.assert_array_equal(clean.hole, near)


def test_what_was_seen_through_a_slit_takes_the_color_of_the_nearest_of_its_kind() -> None:
    near = np.zeros((32, 32), bool)
    near[:, 10:20] = True
    near[:, 15] = False
    rgb = np.where(near, RED, WALL)
    rgb[:, 15] = MIXED
    view, witness = moved_aside(rgb, near)
    clean = unmixed(view, witness)
    np.testing.assert_allclose(clean.rgb[:, 15], WALL, atol=1e-6)
    np.testing.assert_array_equal(clean.hole, near)


def test_what_is_still_beside_it_and_what_others_recorded_keep_their_colors() -> None:
    near = np.zeros((32, 32), bool)
    near[:, 12:18] = True
    rgb = np.where(near, RED, WALL)
    rgb[:, 18] = MIXED
    view, witness = moved_aside(rgb, near)
    nowhere = np.zeros_like(near)
    still = replace(
        view, depth=witness.source.depth, hole=nowhere, source=np.zeros(near.shape, np.int16)
    )
    np.testing.assert_array_equal(unmixed(still, witness).rgb, view.rgb)
    other = replace(view, source=np.where(near, -1, 1).astype(np.int16))
    np.testing.assert_array_equal(unmixed(other, witness).rgb, view.rgb)
