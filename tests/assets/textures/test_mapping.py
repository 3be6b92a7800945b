"""Textures lie where they should: exact at texel centres, seamless, smooth from afar, alike from every side."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpaug.assets.textures.mapping import Texture

RNG = np.random.default_rng(0)
IMAGE = RNG.integers(0, 256, (8, 16, 3)).astype(np.uint8)
UP = np.float32([[0, 0, 1]])
SHARP = np.zeros(1, np.float32)


def at(texture: Texture, point, normal=UP, footprint=0.0, scale=1.0, mapping="planar"):  # type: ignore[no-untyped-def]
    points = np.atleast_2d(np.float32(point))
    normals = np.broadcast_to(np.float32(normal), points.shape)
    return texture.on(points, normals, np.full(len(points), footprint, np.float32), scale, mapping)


@settings(deadline=None)
@given(st.integers(0, 7), st.integers(0, 15), st.integers(-3, 3), st.integers(-3, 3))
def test_a_texel_is_met_exactly_at_its_centre_in_every_repeat(row, column, i, j) -> None:  # type: ignore[no-untyped-def]
    point = [(column + 0.5) / 16 + i, -(row + 0.5) / 16 + j / 2, 0.3]
    assert np.allclose(at(Texture.of(IMAGE), point), IMAGE[row, column] / 255, atol=2e-4)


@pytest.mark.parametrize("mirror", [False, True])
def test_a_repeat_has_no_step_where_the_image_has_none(mirror: bool) -> None:
    wave = np.sin(np.arange(16) * np.pi / 8)[None, :, None] * 60 + 128
    ramp = np.linspace(0, 255, 16)[None, :, None]  # does not repeat
    image = np.rint(np.broadcast_to(ramp if mirror else wave, (16, 16, 3))).astype(np.uint8)
    x = np.linspace(-2, 2, 2001)
    line = at(Texture.of(image, mirror), np.stack([x, 0 * x, 0 * x], 1))
    assert np.abs(np.diff(line, axis=0)).max() < 0.02


def test_from_afar_an_image_is_its_mean() -> None:
    mean = IMAGE.reshape(-1, 3).mean(0) / 255
    assert np.abs(at(Texture.of(IMAGE), [0.3, 0.1, 0], footprint=50.0) - mean).max() < 0.02


@settings(deadline=None)
@given(st.floats(0, 4), st.floats(-1, 1), st.floats(-1, 1))
def test_colors_stay_within_the_image(footprint: float, x: float, y: float) -> None:
    out = at(Texture.of(IMAGE), [x, y, 0.0], footprint=footprint)
    assert out.min() >= 0
    assert out.max() <= 1 + 1e-6


AXES = {
    (1, 0, 0): ((0, 1, 0), (0, 0, 1)), (-1, 0, 0): ((0, -1, 0), (0, 0, 1)),
    (0, 1, 0): ((-1, 0, 0), (0, 0, 1)), (0, -1, 0): ((1, 0, 0), (0, 0, 1)),
    (0, 0, 1): ((1, 0, 0), (0, 1, 0)), (0, 0, -1): ((-1, 0, 0), (0, 1, 0)),
}  # fmt: skip


@pytest.mark.parametrize("normal", list(AXES))
@pytest.mark.parametrize("mapping", ["box", "triplanar"])
def test_each_face_shows_the_image_upright_and_unmirrored(normal, mapping: str) -> None:  # type: ignore[no-untyped-def]
    right, up = map(np.array, AXES[normal])
    assert np.array_equal(np.cross(right, up), normal)  # as seen from outside
    for row, column in ((0, 0), (3, 11), (7, 15)):
        point = (column + 0.5) / 16 * right - (row + 0.5) / 16 * up
        out = at(Texture.of(IMAGE), point, normal, mapping=mapping)
        assert np.allclose(out, IMAGE[row, column] / 255, atol=2e-4)


def test_triplanar_blends_without_a_step_round_a_corner() -> None:
    angle = np.linspace(0, np.pi / 2, 400)
    normals = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1).astype(np.float32)
    points = (0.1 * normals).astype(np.float32)
    big = np.full(400, 0.02, np.float32)
    soft = Texture.of(IMAGE).on(points, normals, big, 1.0, "triplanar")
    hard = Texture.of(IMAGE).on(points, normals, big, 1.0, "box")
    assert np.abs(np.diff(soft, axis=0)).max() < 0.06
    assert np.abs(np.diff(hard, axis=0)).max() > np.abs(np.diff(soft, axis=0)).max()


def test_a_large_image_is_scaled_down_and_a_tiny_one_works() -> None:
    assert Texture.of(np.zeros((3, 5000, 3), np.uint8)).sizes[0, 2] == 2048
    one = Texture.of(np.full((1, 1, 3), 51, np.uint8))
    assert np.allclose(at(one, [0.3, 0.7, 0]), 0.2)
