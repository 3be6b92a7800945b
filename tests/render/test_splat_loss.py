"""Losses in the backward pass: their numbers and gradients against float64 autograd."""

import dataclasses

import numpy as np
import pytest
import torch
from splat_cases import relative, splats, view

from rpaug.core import metrics
from rpaug.render.splat import Errors, Loss, Rasteriser, _reference
from rpaug.render.splat.loss import pull

BACKGROUND = np.array([0.2, 0.4, 0.6])
EACH = [
    Loss(),
    Loss(l2=0, l1=1),
    Loss(l2=0, ssim=1),
    Loss(l2=0, l1=0.8, ssim=0.2),
    Loss(l2=0.5, l1=0.2, ssim=0.3, depth=2.0),
]


def case() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A target, weights with some pixels held out, and depths with some unknown."""
    rng = np.random.default_rng(1)
    target = rng.uniform(0, 1, (40, 48, 3))
    weight = np.where(rng.uniform(size=(40, 48)) < 0.1, 0, rng.uniform(0.5, 2, (40, 48)))
    depth = np.where(rng.uniform(size=(40, 48)) < 0.3, 0, rng.uniform(1, 4, (40, 48)))
    return tuple(array.astype(np.float32) for array in (target, weight, depth))


def similarity(x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
    """SSIM of (h, w, 3) images in 0..1, by its definition: windows cut out and weighted."""
    ramp = torch.exp(-0.5 * ((torch.arange(11, dtype=x.dtype) - 5) / 1.5) ** 2)
    window = (ramp[:, None] * ramp / ramp.sum() ** 2)[None, None]

    def mean(image: torch.Tensor) -> torch.Tensor:
        planes = image.permute(2, 0, 1)[:, None]
        return torch.nn.functional.conv2d(planes, window, padding=5)[:, 0].permute(1, 2, 0)

    a, b = mean(x), mean(y)
    v, w, c = mean(x * x) - a * a, mean(y * y) - b * b, mean(x * y) - a * b
    return (2 * a * b + 1e-4) * (2 * c + 9e-4) / ((a * a + b * b + 1e-4) * (v + w + 9e-4))


def truth(loss: Loss, given, at) -> tuple[float, dict[str, np.ndarray]]:
    """The loss and its gradients, all in float64."""
    target, weight, depth = (torch.as_tensor(a.astype(np.float64)) for a in case())
    leaves = {
        name: None if a is None else torch.tensor(a, dtype=torch.float64, requires_grad=True)
        for name, a in vars(given).items()
    }
    images, _, _ = _reference.rasterise(
        **leaves, view=at, settings=Rasteriser().settings, background=torch.as_tensor(BACKGROUND)
    )
    share = 1 / depth.numel()
    error = images.color - target
    per_pixel = loss.l2 * (error**2).mean(-1) + loss.l1 * error.abs().mean(-1)
    counted = (depth > 0) & (images.alpha >= 0.5)
    off = (images.depth - depth) / torch.where(depth > 0, depth, 1.0)
    per_pixel = per_pixel + loss.depth * off**2 * counted
    seen = torch.where(weight[..., None] > 0, images.color, images.color.detach())
    wanted = torch.where(weight[..., None] > 0, target, images.color.detach())
    per_pixel = per_pixel + loss.ssim * (1 - similarity(seen, wanted)).mean(-1)
    value = (weight * per_pixel).sum() * share
    value.backward()
    slopes = {name: a.grad.numpy() for name, a in leaves.items() if a is not None}
    return value.item(), slopes


@pytest.mark.parametrize("loss", EACH, ids=str)
def test_errors_and_gradients(loss):
    given, at = splats(120, 10), view()
    engine = Rasteriser()
    engine.forward(given, at, BACKGROUND)
    target, weight, depth = case()
    errors, slopes = engine.backward_loss(loss, target, weight, depth)
    value, expected = truth(loss, given, at)
    assert errors.total(loss) == pytest.approx(value, rel=1e-4)
    for name, slope in expected.items():
        assert relative(getattr(slopes, name), slope) < 1e-4, name


def test_an_exact_image_has_no_error_and_no_gradient():
    given, at = splats(60, 3), view()
    engine = Rasteriser()
    picture = engine.forward(given, at)
    errors, slopes = engine.backward_loss(Loss(l1=1, ssim=1), picture.color)
    assert (errors.l2, errors.l1) == (0, 0)
    assert abs(errors.ssim) < 1e-6
    assert np.abs(slopes.means).max() < 1e-5


def test_threads_do_not_change_a_bit():
    given, at, loss = splats(200, 8), view(), Loss(l1=0.5, ssim=0.5)
    results = []
    for threads in (1, 2, 3):
        engine = Rasteriser(threads=threads)
        engine.forward(given, at)
        results.append(engine.backward_loss(loss, *case()))
    for errors, slopes in results[1:]:
        assert errors == results[0][0]
        np.testing.assert_array_equal(slopes.means, results[0][1].means)


def test_squared_error_alone_is_the_same_loss():
    given, at = splats(60, 3), view()
    target, weight, depth = case()
    engine = Rasteriser()
    engine.forward(given, at)
    color, relative_depth, slopes = engine.backward_squared_error(target, weight, depth, 0.3)
    errors, same = engine.backward_loss(Loss(depth=0.3), target, weight, depth)
    assert (color, relative_depth) == (errors.l2, errors.depth)
    np.testing.assert_array_equal(slopes.means, same.means)


def test_weights_that_make_no_loss_are_refused():
    for weights in ({"l2": -1.0}, {"l2": 0.0}):
        with pytest.raises(ValueError, match="none below 0"):
            Loss(**weights)
    assert dataclasses.asdict(Errors(1, 2, 3, 4))["ssim"] == 3


def test_ssim_is_that_of_the_metric():
    """Beyond a black rim wider than a window's reach of 5, zeros and mirrored pixels are the same."""
    rng = np.random.default_rng(4)
    seen, wanted = np.pad(
        rng.integers(0, 256, (2, 30, 34, 3), np.uint8), [(0, 0), (6, 6), (6, 6), (0, 0)]
    )
    out, target = (image.astype(np.float32) / 255 for image in (seen, wanted))
    height, width, _ = out.shape
    none, nowhere = np.zeros((0, 0), np.float32), np.zeros((height, width), np.float32)
    errors = pull(
        Loss(l2=0, ssim=1), out, nowhere, np.zeros(3, np.float32), target, none, none,
        np.zeros_like(out), np.zeros_like(nowhere), 1,
    )  # fmt: skip
    assert errors.ssim == pytest.approx(1 - metrics.ssim(seen, wanted).mean(), abs=1e-4)
