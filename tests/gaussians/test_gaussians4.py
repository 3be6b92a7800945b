"""Gaussians in space and time: against the plain formulas in float64, and torch's own derivatives."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from rpaug.core.types import Gaussians4
from rpaug.gaussians import gaussians4

SEEDS = st.integers(0, 2**31)


def some(count: int, seed: int, pace: float = 0.01) -> Gaussians4:
    rng = np.random.default_rng(seed)
    f = np.float32
    return Gaussians4(
        rng.normal(0, 0.1, (count, 4)).astype(f),
        rng.normal(size=(count, 4)).astype(f),
        rng.normal(size=(count, 4)).astype(f),
        rng.uniform(0.02, 0.3, (count, 4)).astype(f),
        np.full(count, 0.5, f),
        np.zeros((count, 1, 3), f),
        np.ones(count, np.int32),
        np.zeros(3),
        pace,
    )


def product(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Hamilton's product of (w, x, y, z)."""
    w, v, u, r = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    v, r = torch.broadcast_tensors(v, r)
    real = w * u - (v * r).sum(-1, keepdim=True)
    return torch.cat([real, w * r + u * v + torch.linalg.cross(v, r)], -1)


def oracle(means, left, right, scales, time):
    """Middles, covariances and weights at a time, by the textbook."""
    left = left / left.norm(dim=1, keepdim=True)
    right = right / right.norm(dim=1, keepdim=True)
    unit = torch.eye(4, dtype=means.dtype)[
        [3, 0, 1, 2]
    ]  # x, y, z, t as quaternions: t is the real part
    axes = torch.eye(4, dtype=means.dtype)[[1, 2, 3, 0]]
    turned = product(product(left[:, None], axes[None]), right[:, None])  # images of the four axes
    rotation = torch.stack([turned[..., 1], turned[..., 2], turned[..., 3], turned[..., 0]], 1)
    assert unit.shape == (4, 4)
    whole = rotation @ torch.diag_embed(scales**2) @ rotation.transpose(1, 2)
    late = time - means[:, 3]
    along, across = whole[:, 3, 3], whole[:, :3, 3]
    middle = means[:, :3] + across * (late / along)[:, None]
    covariance = whole[:, :3, :3] - across[:, :, None] * across[:, None] / along[:, None, None]
    return middle, covariance, torch.exp(-0.5 * late**2 / along)


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.floats(-5, 5))
def test_a_slice_is_the_conditional_gaussian(seed, t):
    g = some(6, seed)
    cut = gaussians4.at(g, t)
    parts = [torch.tensor(p.astype(float)) for p in (g.means, g.left, g.right, g.scales)]
    middle, covariance, weight = (a.numpy()[cut.rows] for a in oracle(*parts, t * g.pace))
    np.testing.assert_allclose(cut.means, middle, atol=1e-10)
    np.testing.assert_allclose(cut.covariances, covariance, atol=1e-10)
    np.testing.assert_allclose(cut.weights, weight, atol=1e-10)
    assert (np.linalg.eigvalsh(cut.covariances) > 0).all()


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_rotations_are_rotations_and_factor_again(seed):
    rng = np.random.default_rng(seed)
    turn = gaussians4.rotations(rng.normal(size=(8, 4)), rng.normal(size=(8, 4)))
    np.testing.assert_allclose(
        turn @ turn.transpose(0, 2, 1), np.tile(np.eye(4), (8, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(turn), 1, atol=1e-12)
    again = gaussians4.rotations(*gaussians4.quaternions(turn))
    np.testing.assert_allclose(again, turn, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_gradients_are_torchs(seed):
    g, t = some(7, seed), 1.7
    rng = np.random.default_rng(seed)
    cut = gaussians4.at(g, t)
    m = len(cut.rows)
    by_means, by_upper, by_weights = (
        rng.normal(size=(m, 3)),
        rng.normal(size=(m, 6)),
        rng.normal(size=m),
    )
    pull = gaussians4.pull_back(g, t, cut.rows, by_means, by_upper, by_weights)
    leaves = [
        torch.tensor(p[cut.rows].astype(float), requires_grad=True)
        for p in (g.means, g.left, g.right, g.scales)
    ]
    middle, covariance, weight = oracle(*leaves, t * g.pace)
    rows, columns = gaussians4.UPPER
    loss = (middle * torch.tensor(by_means)).sum() + (weight * torch.tensor(by_weights)).sum()
    loss = loss + (covariance[:, rows, columns] * torch.tensor(by_upper)).sum()
    loss.backward()
    for leaf, found in zip(leaves, (pull.means, pull.left, pull.right, pull.scales), strict=True):
        np.testing.assert_allclose(found, leaf.grad.numpy(), rtol=1e-7, atol=1e-9)


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_moving_gaussians_move_as_asked(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(0, 0.01, (5, 3, 3))
    shape = root @ root.transpose(0, 2, 1) + 1e-6 * np.eye(3)
    velocity, lasting = rng.normal(0, 1, (5, 3)), rng.uniform(0.005, 0.02, 5)
    left, right, scales = gaussians4.moving(shape, velocity, lasting)
    whole = gaussians4.covariances(left, right, scales)
    np.testing.assert_allclose(whole[:, 3, 3], lasting**2, rtol=1e-6)
    np.testing.assert_allclose(
        whole[:, :3, 3] / whole[:, 3, 3, None], velocity, rtol=1e-6, atol=1e-9
    )
    across = whole[:, :3, 3]
    left_over = whole[:, :3, :3] - across[:, :, None] * across[:, None] / whole[:, 3, 3, None, None]
    np.testing.assert_allclose(left_over, shape, atol=1e-12)


def test_nothing_is_there_long_before():
    assert len(gaussians4.at(some(20, 0), -1000.0).rows) == 0
