"""The CPU kernels against the float64 reference, and against themselves on other threads and orders."""

import dataclasses

import numpy as np
import pytest
import torch
from splat_cases import (
    NAMES,
    assert_close,
    composited_alike,
    draw,
    gradients,
    pulls,
    relative,
    splats,
    view,
)

from rpaug.core.errors import Unsupported
from rpaug.render.splat import Rasteriser, Settings, Splats, View, _compositing, _reference, shared


def posed(at: View) -> View:
    """The same camera, moved and turned a little."""
    turn = np.array([[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, [-1.4, 0.1, 0.6]
    return dataclasses.replace(at, world_to_camera=pose)


def covariances_of(given: Splats) -> Splats:
    """The same shapes as covariance matrices."""
    matrices = _reference.covariance_matrices(
        torch.tensor(given.quats, dtype=torch.float64),
        torch.tensor(given.scales, dtype=torch.float64),
        None,
    )
    upper = matrices.numpy()[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    return dataclasses.replace(given, quats=None, scales=None, covariances=upper.astype(np.float32))


@pytest.mark.parametrize("harmonics", [1, 4, 9, 16])
@pytest.mark.parametrize("antialiased", [False, True])
def test_images_end_to_end(harmonics, antialiased):
    given, at, settings = (
        splats(300, 1, harmonics),
        posed(view(70, 50)),
        Settings(antialiased=antialiased),
    )
    found, expected = (draw(given, at, name, settings) for name in ("numba", "reference"))
    assert_close(found, expected, atol=1e-4, flips=0)
    error = np.abs(found.color - expected.color).max(-1)
    assert (error <= 1e-5).mean() >= 0.999
    assert (found.surface_index == expected.surface_index).mean() >= 0.999
    same = found.surface_index == expected.surface_index
    np.testing.assert_allclose(found.depth_surface[same], expected.depth_surface[same], rtol=1e-6)


def test_color_given_the_same_projection():
    """Compositing alone, from the very records the kernels made: 1e-5, threshold flips counted apart."""
    given, at = splats(400, 4), view(64, 64)
    error, flips = composited_alike(given, at)
    assert error <= 1e-5
    assert flips <= 0.001 * at.width * at.height


@pytest.mark.parametrize("harmonics", [1, 4, 9, 16])
@pytest.mark.parametrize("antialiased", [False, True])
def test_gradients(harmonics, antialiased):
    given, at, settings = (
        splats(200, 2, harmonics),
        posed(view()),
        Settings(antialiased=antialiased),
    )
    found, expected = (gradients(given, at, name, settings) for name in ("numba", "reference"))
    for name in NAMES:
        if expected[name] is not None:
            assert relative(found[name], expected[name]) < 1e-4, name


@pytest.mark.parametrize("features", [2, 16])
def test_features(features):
    given, at = splats(150, 3, features=features), view()
    found, expected = (draw(given, at, name) for name in ("numba", "reference"))
    np.testing.assert_allclose(found.features, expected.features, atol=2e-5)
    slopes, truth = (gradients(given, at, name) for name in ("numba", "reference"))
    for name in ("means", "features", "opacities"):
        assert relative(slopes[name], truth[name]) < 1e-4, name


def test_covariances_instead_of_quaternions_and_scales():
    given, at = splats(150, 6), posed(view())
    other = covariances_of(given)
    np.testing.assert_allclose(
        draw(other, at, "numba").color, draw(given, at, "numba").color, atol=1e-4
    )
    found, expected = (gradients(other, at, name) for name in ("numba", "reference"))
    for name in ("means", "covariances", "opacities", "sh"):
        assert relative(found[name], expected[name]) < 1e-4, name


@pytest.mark.parametrize("size", [(90, 70), (150, 130)])  # few tiles, and many
def test_threads_do_not_change_a_bit(size):
    given, at = splats(500, 8, harmonics=4), view(*size)
    images = pulls(at)
    results = []
    for threads in (1, 2, 3, 8):
        engine = Rasteriser(threads=threads)
        picture = engine.forward(given, at)
        results.append((picture, engine.backward(**images)))
    for picture, slopes in results[1:]:
        for found, expected in ((picture, results[0][0]), (slopes, results[0][1])):
            for name, value in vars(found).items():
                if isinstance(value, np.ndarray):
                    np.testing.assert_array_equal(value, getattr(expected, name), err_msg=name)


def test_order_of_input_does_not_matter():
    given, at = splats(300, 9), view()
    shuffle = np.random.default_rng(0).permutation(len(given))
    mixed = dataclasses.replace(
        given, **{n: a[shuffle] for n, a in vars(given).items() if a is not None}
    )
    found, expected = Rasteriser(), Rasteriser()
    np.testing.assert_array_equal(found.forward(mixed, at).color, expected.forward(given, at).color)
    slopes, truth = found.backward(**pulls(at)), expected.backward(**pulls(at))
    np.testing.assert_array_equal(slopes.means, truth.means[shuffle])


def test_squared_error_is_the_gradient_of_its_own_number():
    given, at = splats(120, 10), view()
    rng = np.random.default_rng(1)
    target = rng.uniform(0, 1, (40, 48, 3)).astype(np.float32)
    depth = np.where(rng.uniform(size=(40, 48)) < 0.3, 0, rng.uniform(1, 4, (40, 48))).astype(
        np.float32
    )
    weight = rng.uniform(0, 2, (40, 48)).astype(np.float32)
    background = np.array([0.2, 0.4, 0.6])
    engine = Rasteriser()
    picture = engine.forward(given, at, background)
    color_error, depth_error, slopes = engine.backward_squared_error(target, weight, depth, 0.3)
    counted = (depth > 0) & (picture.alpha >= 0.5)
    expected_color = (weight[..., None] * (picture.color - target) ** 2).mean()
    relative_depth = (picture.depth_expected - depth) / np.where(depth > 0, depth, 1)
    expected_depth = (weight * relative_depth**2 * counted).sum() / weight.size
    assert color_error == pytest.approx(expected_color, rel=1e-4)
    assert depth_error == pytest.approx(expected_depth, rel=1e-4)

    engine.forward(given, at, background)
    d_color = 2 * weight[..., None] * (picture.color - target) / target.size
    d_depth = (
        0.3 * 2 * weight * relative_depth * counted / np.where(depth > 0, depth, 1) / depth.size
    )
    truth = engine.backward(d_color.astype(np.float32), d_depth.astype(np.float32))
    for name in ("means", "opacities", "sh", "scales"):
        assert relative(getattr(slopes, name), getattr(truth, name)) < 1e-4, name


def test_buffers_do_not_leak_between_views():
    """A large scene, then a small one: the second is as from a new object, and the first's arrays stay."""
    engine, at = Rasteriser(), view()
    before = engine.forward(splats(300, 1), at)
    kept = before.color.copy()
    small = splats(20, 2)
    np.testing.assert_array_equal(
        engine.forward(small, at).color, Rasteriser().forward(small, at).color
    )
    np.testing.assert_array_equal(before.color, kept)


def test_read_only_and_strided_arrays_are_taken():
    given, at = splats(50, 3), view()
    locked = {}
    for name, array in vars(given).items():
        if array is not None:
            locked[name] = np.repeat(array, 2, 0)[::2]
            locked[name].flags.writeable = False
    np.testing.assert_array_equal(
        draw(dataclasses.replace(given, **locked), at, "numba").color,
        draw(given, at, "numba").color,
    )


def test_too_many_features_are_refused_in_words():
    with pytest.raises(Unsupported, match="at most 64"):
        draw(splats(5, features=65), view(), "numba")


def test_exponential_is_exact_at_zero_and_close_elsewhere():
    import numba

    from rpaug.render.splat._simd import load, store

    @numba.njit
    def run(values, out):
        for at in range(0, len(values), 16):
            store(out, at, _compositing._exp_minus(load(values, at)))

    values = np.linspace(0, np.log(255), 1600).astype(np.float32)
    out = np.empty_like(values)
    run(values, out)
    assert out[0] == 1
    np.testing.assert_allclose(out, np.exp(-values.astype(np.float64)), rtol=2e-6)


def test_threads_go_to_views_of_small_images_and_to_tiles_of_large_ones():
    assert shared(threads=2, views=5, pixels=128 * 128) == (2, 1)
    assert shared(threads=8, views=2, pixels=128 * 128) == (2, 4)
    assert shared(threads=8, views=5, pixels=640 * 480) == (1, 8)
    assert shared(threads=1, views=1, pixels=1) == (1, 1)
