"""Scenes and comparisons that the splat tests share."""

import dataclasses
from typing import Any

import numpy as np
import torch
from gsplat_kernels import running

from rpaug.render.splat import (
    Gradients,
    Rasteriser,
    Rendering,
    Settings,
    Splats,
    View,
    _reference,
    render,
)
from rpaug.render.splat._pinhole import COLUMN, HALF_WIDTH, L11, L22, OPACITY, ROW
from rpaug.render.splat.autograd import rasterise

torch.set_num_threads(1)  # images of a few thousand pixels: more threads only wait for each other

NAMES = ("means", "opacities", "sh", "quats", "scales", "covariances", "features")


def view(width: int = 48, height: int = 40, focal: float = 50.0, **pose: np.ndarray) -> View:
    """A camera at the origin that looks along +z, its principal point a little off the middle."""
    K = np.array([[focal, 0, width / 2 + 0.3], [0, 1.1 * focal, height / 2 - 0.7], [0, 0, 1.0]])
    return View(K, pose.get("world_to_camera", np.eye(4)), width, height)


def splats(count: int = 200, seed: int = 0, harmonics: int = 1, features: int = 0) -> Splats:
    """Gaussians of all sizes and opacities in front of that camera, none at the same depth."""
    rng = np.random.default_rng(seed)
    means = rng.uniform(-1.2, 1.2, (count, 3)) + np.array([0, 0, 2.5])
    extra = rng.normal(size=(count, features)).astype(np.float32) if features else None
    return Splats(
        means.astype(np.float32),
        rng.uniform(0.02, 1.0, count).astype(np.float32),
        rng.normal(0, 0.6, (count, harmonics, 3)).astype(np.float32),
        rng.normal(size=(count, 4)).astype(np.float32),
        np.exp(rng.uniform(-5, -1.2, (count, 3))).astype(np.float32),
        features=extra,
    )


def one(
    mean: tuple[float, float, float] = (0.0, 0.0, 2.0),
    scale: float | tuple[float, float, float] = 0.1,
    opacity: float = 0.8,
    quat: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0),
    color: tuple[float, float, float] = (0.9, 0.5, 0.2),
) -> Splats:
    """A single Gaussian."""
    return together_of([(mean, scale, opacity, quat, color)])


def together_of(parts: list[tuple]) -> Splats:
    """Splats from (mean, scale, opacity, quat, color) tuples."""
    means, scales, opacities, quats, colors = zip(*parts, strict=True)
    spread = [np.broadcast_to(scale, 3) for scale in scales]
    return Splats(
        np.array(means, np.float32),
        np.array(opacities, np.float32),
        ((np.array(colors, np.float32) - 0.5) / 0.28209479)[:, None, :].astype(np.float32),
        np.array(quats, np.float32),
        np.array(spread, np.float32),
    )


def draw(
    given: Splats, at: View, backend: str, settings: Settings | None = None, **more
) -> Rendering:
    """`render` from a `View`."""
    with running(backend) as name:
        return render(
            given, at.K, at.world_to_camera, at.width, at.height,
            settings=settings, backend=name, **{"threads": 1, **more},
        )  # fmt: skip


def pulls(at: View, features: int = 0, seed: int = 7) -> dict[str, np.ndarray | None]:
    """Random image gradients: a loss that is linear in every image."""
    rng = np.random.default_rng(seed)
    shape = (at.height, at.width)
    images = {"color": (*shape, 3), "depth": shape, "alpha": shape, "features": (*shape, features)}
    return {
        name: rng.normal(size=size).astype(np.float32) if 0 not in size else None
        for name, size in images.items()
    }


def gradients(
    given: Splats,
    at: View,
    backend: str,
    settings: Settings | None = None,
    images: dict[str, np.ndarray | None] | None = None,
) -> dict[str, np.ndarray | None]:
    """Gradients of the sum of image * pull over all images, through the autograd door."""
    images = images or pulls(at, 0 if given.features is None else given.features.shape[1])
    kind = {"dtype": torch.float64, "device": "cuda" if backend == "gsplat" else "cpu"}
    tensors = {
        name: None
        if (a := getattr(given, name)) is None
        else torch.tensor(a, **kind, requires_grad=True)
        for name in NAMES
    }
    positional = [tensors.pop(name) for name in ("means", "opacities", "sh")]
    with running(backend) as name:
        made = rasterise(*positional, at, **tensors, settings=settings, backend=name)
    loss = sum(
        (image * torch.as_tensor(images[name], **kind)).sum()
        for name, image in zip(("color", "depth", "alpha", "features"), made, strict=True)
        if image is not None and images[name] is not None
    )
    loss.backward()
    leaves = dict(zip(("means", "opacities", "sh"), positional, strict=True)) | tensors
    return {
        name: None if leaf is None else leaf.grad.cpu().numpy() for name, leaf in leaves.items()
    }


def relative(found: np.ndarray, expected: np.ndarray) -> float:
    """Relative distance in L2."""
    return float(np.linalg.norm(found - expected) / max(np.linalg.norm(expected), 1e-12))


LARGEST_FLIP = 4 / 255  # one splat at the alpha floor, times the brightest color of these scenes


BAND = 3e-5  # relative: how near a threshold float32 and a GPU's fast exponential may fall on its other side


def projected(given: Splats, at: View, rules: Settings) -> tuple[_reference.Projected, Any, Any]:
    """The splats from front to back, and how far each pixel's centre lies from theirs."""
    wide = {
        name: None if array is None else torch.as_tensor(array.astype(np.float64))
        for name in NAMES
        for array in [getattr(given, name)]
    }
    seen = _reference.project(**wide, view=at, settings=rules)
    order = torch.argsort(seen.depth, stable=True)
    i, j = np.mgrid[: at.height, : at.width]
    dx = torch.as_tensor(j)[..., None] - seen.centre[order, 0]
    dy = torch.as_tensor(i)[..., None] - seen.centre[order, 1]
    return dataclasses.replace(seen, factor=seen.factor[order], opacity=seen.opacity[order]), dx, dy


ROUNDING = 4e-7  # of float32, in a sum of three terms


def on_a_ridge(given: Splats, at: View, settings: Settings | None = None) -> np.ndarray:
    """Pixels on the middle line of a splat so long that the terms of its exponent cancel to rounding. gsplat draws
    nothing where the sum comes out negative."""
    seen, dx, dy = projected(given, at, settings or Settings())
    f = seen.factor
    squares = (f[:, 0] * dx) ** 2 + (f[:, 1] * dy) ** 2 + (f[:, 2] * dy) ** 2
    mixed = 2 * f[:, 0] * f[:, 1] * dx * dy
    cancelled = (squares + mixed).abs() < ROUNDING * (squares + mixed.abs())
    return (cancelled & (squares > 1)).any(-1).numpy()


def on_a_threshold(given: Splats, at: View, settings: Settings | None = None) -> np.ndarray:
    """Pixels at which some splat's alpha lies on the floor or the ceiling, or the light on its end, to rounding."""
    rules = settings or Settings()
    seen, dx, dy = projected(given, at, rules)
    factor, opacity = seen.factor, seen.opacity
    alpha = opacity * torch.exp(
        -((factor[:, 0] * dx + factor[:, 1] * dy) ** 2) - (factor[:, 2] * dy) ** 2
    )
    drawn = torch.where(alpha >= rules.alpha_floor, alpha.clamp(max=rules.alpha_max), 0.0)
    left = torch.cumprod(1 - drawn, -1)
    near = torch.zeros(left.shape, dtype=torch.bool)
    for value, limit in (
        (alpha, rules.alpha_floor),
        (alpha, rules.alpha_max),
        (left, rules.transmittance_stop),
    ):
        near |= (value / limit - 1).abs() < BAND
    return near.any(-1).numpy()


def assert_within(
    found: Rendering,
    expected: Rendering,
    apart: np.ndarray,
    atol: float = 1e-4,
    ridge: np.ndarray | None = None,
) -> None:
    """Equal within `atol` at every pixel but those `apart`, which differ by a splat at a threshold at most, and those
    on a `ridge`."""
    error = np.abs(found.color - expected.color).max(-1)
    error = np.maximum(error, np.abs(found.alpha - expected.alpha))
    if ridge is not None:
        apart, error = apart | ridge, np.where(ridge, 0, error)
    assert error[~apart].max(initial=0) <= atol
    assert error.max(initial=0) <= LARGEST_FLIP
    solid = (expected.alpha > 0.01) & ~apart
    off = np.abs(found.depth_expected - expected.depth_expected)[solid]
    assert (off <= 10 * atol * expected.depth_expected[solid]).all()
    assert found.nonfinite == expected.nonfinite


def assert_close(
    found: Rendering, expected: Rendering, atol: float = 1e-4, flips: float = 0.001
) -> None:
    """Equal within `atol`, 99.9 % of the pixels within a tenth of it, but for a share of `flips` pixels.

    A pixel flips where a splat lies on a threshold (alpha floor, end of light) or two lie at one depth to
    within rounding; there the images differ by what one splat adds at that threshold, at most 1/255 of its
    color or the light that was left.
    """
    assert np.isfinite(found.color).all()
    assert np.isfinite(found.depth_expected).all()
    error = np.abs(found.color - expected.color).max(-1)
    error = np.maximum(error, np.abs(found.alpha - expected.alpha))
    far = error > atol
    assert far.mean() <= flips, f"{far.sum()} of {far.size} pixels differ"
    assert (error > atol / 10).mean() <= max(flips, 0.001)
    assert error.max(initial=0) <= LARGEST_FLIP
    scale = np.maximum(expected.depth_expected, 1e-3)
    solid = (expected.alpha > 0.01) & ~far
    wrong = np.abs(found.depth_expected - expected.depth_expected) > 10 * atol * scale
    assert not (wrong & solid).any()
    assert found.nonfinite == expected.nonfinite


def composited_alike(
    given: Splats, at: View, settings: Settings | None = None
) -> tuple[float, int]:
    """Compositing alone, from the very records the kernels made, against the reference: the largest error of
    a color, but for flipped pixels, and how many flipped.
    """
    engine = Rasteriser(settings)
    found = engine.forward(given, at)
    rows = np.flatnonzero(engine._records[:, HALF_WIDTH] >= 0)
    record = torch.as_tensor(engine._records[rows].astype(np.float64))
    values = torch.as_tensor(engine._values[rows].astype(np.float64))
    seen = _reference.Projected(
        torch.as_tensor(rows), record[:, COLUMN : ROW + 1], record[:, L11 : L22 + 1], record[:, OPACITY],
        values[:, 3], values[:, :3], 0,
    )  # fmt: skip
    expected = _reference.composite(seen, values[:, :3], at.width, at.height, engine.settings)
    error = np.abs(found.color - expected.values.numpy()).max(-1)
    assert error.max(initial=0) <= LARGEST_FLIP
    return float(error[error <= 1e-4].max(initial=0)), int((error > 1e-4).sum())


def finite(values: Gradients | dict[str, np.ndarray | None]) -> bool:
    """True if every gradient given is finite."""
    items = values.values() if isinstance(values, dict) else vars(values).values()
    return all(np.isfinite(item).all() for item in items if item is not None)
