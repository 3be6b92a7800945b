"""Only what an edit covers changes, and outlines of anti-aliased objects carry no halo."""

from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rpaug.render import composite as compositing
from rpaug.render.matting import matte


def composite(rgb, ids, appearance, antialiased, surfaces=lambda rows: rows):  # type: ignore[no-untyped-def]
    """Composited with surfaces that are their pixels' flat indices."""
    return compositing.composite(rgb, ids, appearance, antialiased, surfaces)


IMAGES = arrays(np.uint8, (9, 11, 3))
LABELS = arrays(np.int32, (9, 11), elements=st.integers(0, 3))


@dataclass(frozen=True)
class Paint:
    """A flat color."""

    instance_ids: frozenset[int] | None
    color: tuple[float, float, float] = (0.0, 0.5, 1.0)

    def __call__(self, color: np.ndarray, surface: object) -> np.ndarray:
        return np.broadcast_to(np.array(self.color, np.float32), color.shape)


@dataclass(frozen=True)
class Same:
    """No change."""

    instance_ids: frozenset[int] | None

    def __call__(self, color: np.ndarray, surface: object) -> np.ndarray:
        return color


@settings(deadline=None)
@given(IMAGES, LABELS, st.booleans())
def test_pixels_outside_keep_their_bytes(
    rgb: np.ndarray, ids: np.ndarray, antialiased: bool
) -> None:
    out = composite(rgb, ids, [Paint(frozenset({1}))], antialiased)
    inside = ids == 1
    near = cv2.dilate(inside.astype(np.uint8), np.ones((3, 3))).astype(bool)
    support = near if antialiased else inside
    assert np.array_equal(out[~support], rgb[~support])


@settings(deadline=None)
@given(IMAGES, LABELS, st.booleans())
def test_an_edit_that_changes_no_color_changes_no_pixel(
    rgb: np.ndarray, ids: np.ndarray, antialiased: bool
) -> None:
    edits = [Same(frozenset({1, 2})), Same(None)]
    assert np.array_equal(composite(rgb, ids, edits, antialiased), rgb)
    assert np.array_equal(composite(rgb, ids, [], antialiased), rgb)


@dataclass(frozen=True)
class Dim:
    """Half the light, everywhere but in the sky."""

    unlit: tuple[int, ...]
    instance_ids: frozenset[int] | None = None

    def __call__(self, color: np.ndarray, surface: object) -> np.ndarray:
        return color / 2


def test_a_skyline_is_lit_as_much_as_there_is_ground_in_its_pixels() -> None:
    """Gray sky above white ground; the last row of the sky is a quarter of ground."""
    rgb, ids = np.full((12, 9, 3), 120, np.uint8), np.zeros((12, 9), np.int32)
    rgb[6:], ids[6:] = 240, 1
    rgb[5] = 150
    lit = composite(rgb, ids, [Dim((0,))], antialiased=True)
    assert (lit[:5] == 120).all()
    assert (np.abs(lit[5:].astype(int) - 120) <= 2).all()  # 0.75 sky, 0.25 ground
    sharp = composite(rgb, ids, [Dim((0,))], antialiased=False)
    assert np.array_equal(sharp[:6], rgb[:6])
    assert (sharp[6:] == 120).all()


@settings(deadline=None)
@given(IMAGES, LABELS)
def test_every_pixel_inside_a_sharp_mask_is_painted(rgb: np.ndarray, ids: np.ndarray) -> None:
    out = composite(rgb, ids, [Paint(frozenset({2}))], antialiased=False)
    assert (out[ids == 2] == [0, 128, 255]).all()


def test_edits_apply_in_order_and_are_rounded_once() -> None:
    rgb = np.full((2, 2, 3), 100, np.uint8)
    ids = np.array([[1, 0], [0, 0]], np.int32)

    @dataclass(frozen=True)
    class Scale:
        instance_ids: frozenset[int] | None
        factor: float

        def __call__(self, color: np.ndarray, surface: object) -> np.ndarray:
            return color * np.float32(self.factor)

    out = composite(rgb, ids, [Scale(None, 1 / 3), Scale(frozenset({1}), 3.0)], antialiased=False)
    assert (out[0, 0] == 100).all()
    assert (out[1, 1] == 33).all()


def disc(factor: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """A disc's exact coverage of 32x32 pixels, and its mask at pixel centres."""
    axis = (np.arange(32 * factor) + 0.5) / factor - 0.5
    inside = (axis[:, None] - 15.3) ** 2 + (axis[None] - 15.8) ** 2 < 10.2**2
    coverage = inside.reshape(32, factor, 32, factor).mean((1, 3))
    centres = np.arange(32)
    mask = (centres[:, None] - 15.3) ** 2 + (centres[None] - 15.8) ** 2 < 10.2**2
    return coverage, mask


def test_an_antialiased_outline_mixes_the_new_color_as_the_old_one_was_mixed() -> None:
    coverage, mask = disc()
    front, back, paint = np.array([0.8, 0.2, 0.1]), np.array([0.1, 0.6, 0.3]), (0.1, 0.2, 0.9)

    def picture(color: np.ndarray) -> np.ndarray:
        mixed = coverage[..., None] * color + (1 - coverage[..., None]) * back
        return np.rint(mixed * 255).astype(np.uint8)

    ids = np.where(mask, 5, 1).astype(np.int32)
    edit = Paint(frozenset({5}), paint)
    truth = picture(np.array(paint)).astype(int)
    soft = composite(picture(front), ids, [edit], antialiased=True)
    hard = composite(picture(front), ids, [edit], antialiased=False)
    assert np.abs(soft.astype(int) - truth).max() <= 2
    assert np.abs(hard.astype(int) - truth).max() > 40


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1), (2, 2)])
def test_small_and_full_masks_have_a_share(shape: tuple[int, int]) -> None:
    color = np.random.default_rng(0).random((*shape, 3), np.float32)
    for inside in (
        np.zeros(shape, bool),
        np.ones(shape, bool),
        np.arange(np.prod(shape)).reshape(shape) % 2 == 0,
    ):
        share, foreground = matte(color, inside)
        assert np.isfinite(share).all()
        assert np.array_equal(share, inside)
        assert np.array_equal(foreground, color)


def test_nothing_to_tell_instances_apart_means_only_global_edits() -> None:
    rgb = np.full((2, 2, 3), 7, np.uint8)
    assert np.array_equal(composite(rgb, None, [Paint(frozenset({1}))], False), rgb)
    assert (composite(rgb, None, [Paint(None)], False) == [0, 128, 255]).all()


@pytest.mark.parametrize("antialiased", [False, True])
def test_each_row_is_told_its_own_pixel_and_mixed_ones_outside_the_nearest_inside(
    antialiased: bool,
) -> None:
    _, mask = disc()
    coverage = disc()[0]
    given: list[tuple[int, int]] = []

    @dataclass(frozen=True)
    class Ask:
        instance_ids: frozenset[int] | None = frozenset({5})

        def __call__(self, color: np.ndarray, surface: np.ndarray) -> np.ndarray:
            assert len(color) == len(surface)
            given.extend((int(row) // 32, int(row) % 32) for row in surface)
            return 1 - color

    rgb = np.rint(255 * (0.2 + 0.6 * coverage[..., None].repeat(3, 2))).astype(np.uint8)
    out = composite(rgb, np.where(mask, 5, 1).astype(np.int32), [Ask()], antialiased)
    assert all(mask[pixel] for pixel in given)
    outside = (out != rgb).any(-1) & ~mask
    assert outside.any() == antialiased
    assert len(given) >= mask.sum() + outside.sum()


def test_a_line_that_is_all_outline_asks_for_no_edit_of_no_pixels() -> None:
    """A line a pixel wide has no pixel that is wholly its own."""

    @dataclass(frozen=True)
    class Some:
        instance_ids: frozenset[int] | None = frozenset({5})

        def __call__(self, color: np.ndarray, surface: object) -> np.ndarray:
            assert len(color)
            return 1 - color

    rgb = np.full((9, 9, 3), 100, np.uint8)
    rgb[:, 4] = 160
    ids = np.ones((9, 9), np.int32)
    ids[:, 4] = 5
    out = composite(rgb, ids, [Some()], True)
    assert (out[:, 6:] == rgb[:, 6:]).all()
