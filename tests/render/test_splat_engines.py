"""Engines of fits: every backend gives the CPU kernels' images, errors and gradients, and says what it cannot."""

import gc

import numpy as np
import pytest
import torch
from gsplat_kernels import EMULATED, ON_GPU, running
from splat_cases import (
    assert_within,
    on_a_threshold,
    relative,
    splats,
    view,
)

from rpaug.core.errors import Unsupported
from rpaug.render.splat import Loss, Settings, SplatEngine, engine
from rpaug.render.splat._torch import DeviceArrays

SHARP = Settings(dilation=0.1)
backends = pytest.mark.parametrize("backend", ["reference", EMULATED, ON_GPU])
LOSSES = {
    "squares": Loss(depth=3.0),
    "sizes and structure": Loss(l2=0.0, l1=0.8, ssim=0.2),
}


def made(backend: str) -> SplatEngine:
    with running(backend) as name:
        return engine(name, SHARP)


def prepared(backend: str, count: int = 150, features: int = 0) -> SplatEngine:
    """An engine with a view drawn. What an emulated one lacks is stood in for as long as it draws."""
    eye = made(backend)
    with running(backend):
        eye.prepare(splats(count, 3, features=features), view())
    return eye


def target() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What to fit to: a color, weights, and a depth that half of the pixels have."""
    rng = np.random.default_rng(5)
    shape = (view().height, view().width)
    depth = rng.uniform(1.5, 3.5, shape) * (rng.uniform(size=shape) < 0.5)
    weight = rng.uniform(size=shape) * ~on_a_threshold(splats(150, 3), view(), SHARP)
    color = rng.uniform(size=(*shape, 3))
    return color.astype(np.float32), weight.astype(np.float32), depth.astype(np.float32)


@backends
def test_images_are_those_of_the_kernels(backend):
    given, at = splats(150, 3, features=2), view()
    expected = engine("numba", SHARP).forward(given, at, 0.25, surface=False)
    eye = made(backend)
    with running(backend):
        found = eye.forward(given, at, 0.25, surface=False)
    apart = on_a_threshold(given, at, SHARP)
    assert_within(found, expected, apart)
    np.testing.assert_allclose(found.features[~apart], expected.features[~apart], atol=1e-4)


@backends
@pytest.mark.parametrize("name", LOSSES)
def test_errors_and_gradients_are_those_of_the_kernels(backend, name):
    color, weight, depth = target()
    expected, truth = prepared("numba").backward_loss(LOSSES[name], color, weight, depth)
    found, slopes = prepared(backend).backward_loss(LOSSES[name], color, weight, depth)
    for part, error in vars(expected).items():
        assert getattr(found, part) == pytest.approx(error, rel=1e-3, abs=1e-7), part
    for part in ("means", "opacities", "sh", "quats", "scales"):
        gradient = getattr(slopes, part)
        assert gradient.dtype == np.float32
        assert relative(gradient, getattr(truth, part)) < 1e-3, part
    assert slopes.covariances is None
    assert slopes.features is None


@backends
def test_squared_errors_are_that_loss(backend):
    color, weight, depth = target()
    l2, by_depth, slopes = prepared(backend).backward_squared_error(color, weight, depth, 3.0)
    errors, same = prepared(backend).backward_loss(Loss(depth=3.0), color, weight, depth)
    assert (l2, by_depth) == pytest.approx((errors.l2, errors.depth))
    np.testing.assert_allclose(slopes.means, same.means, rtol=1e-4, atol=1e-7)


@backends
def test_gradients_of_images_come_back(backend):
    rng = np.random.default_rng(0)
    shape = (view().height, view().width)
    smooth = ~on_a_threshold(splats(150, 3), view(), SHARP)
    color, features = (
        (rng.normal(size=(*shape, count)) * smooth[..., None]).astype(np.float32)
        for count in (3, 2)
    )
    found, expected = (
        prepared(name, features=2).backward(color, features=features) for name in (backend, "numba")
    )
    for part in ("means", "sh", "features"):
        assert relative(getattr(found, part), getattr(expected, part)) < 1e-3, part


def test_gsplat_tells_no_surface_and_the_reference_does():
    given, at = splats(40), view()
    eye = made(EMULATED)
    with running(EMULATED), pytest.raises(Unsupported, match="no surface"):
        eye.forward(given, at)
    found, expected = (engine(name, SHARP).forward(given, at) for name in ("reference", "numba"))
    assert (found.surface_index != expected.surface_index).mean() < 0.01
    same = found.surface_index == expected.surface_index
    np.testing.assert_allclose(found.depth_surface[same], expected.depth_surface[same], rtol=1e-5)


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="expected auto"):
        engine("opengl")
    with pytest.raises(ValueError, match="expected float32"):
        engine("reference", dtype="float16")
    with pytest.raises(Unsupported, match="computes in float32"):
        engine("numba", dtype="float64")


def test_targets_are_kept_while_they_live_and_sent_anew_when_changed():
    kept = DeviceArrays()
    array = np.arange(12.0, dtype=np.float32).reshape(3, 4)
    first = kept.of(array, torch.float32, "cpu")
    assert kept.of(array, torch.float32, "cpu") is first
    assert kept.of(array.copy(), torch.float32, "cpu") is not first
    array[1, 1] = 99
    assert kept.of(array, torch.float32, "cpu")[1, 1] == 99
    del array
    gc.collect()
    assert len(kept) == 0


def test_the_longest_unused_targets_go_first():
    kept = DeviceArrays(most_bytes=2 * 4 * 100)
    arrays = [np.full(100, k, np.float32) for k in range(3)]
    copies = [kept.of(array, torch.float32, "cpu") for array in arrays[:2]]
    assert kept.of(arrays[0], torch.float32, "cpu") is copies[0]
    kept.of(arrays[2], torch.float32, "cpu")
    assert len(kept) == 2
    assert kept.of(arrays[0], torch.float32, "cpu") is copies[0]
    assert kept.of(arrays[1], torch.float32, "cpu") is not copies[1]
