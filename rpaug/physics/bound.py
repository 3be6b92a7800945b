"""Gaussians bound to particles: where those go and how they deform, the Gaussians go and deform.

Xie et al. 2024, "PhysGaussian: Physics-Integrated 3D Gaussians for Generative Dynamics" (arXiv 2311.12198): a
Gaussian's covariance A becomes F A F^T, and its harmonics turn with F's rotation.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32, Float64, Int

from rpaug.core.types import FrameResidual, Gaussians
from rpaug.gaussians import frame_residuals, harmonics
from rpaug.gaussians.carrying import SH0
from rpaug.gaussians.flowing import shapes
from rpaug.gaussians.gaussians import joined, quaternions

MOST_WIDER = 3.0  # times: how much a Gaussian may be stretched or pressed along an axis
INNER = 0.6  # of the particles' spacing: standard deviation of what shows the inside
CHUNK = 256
THINNEST = 1e-5  # metres


@dataclass(frozen=True)
class Bound:
    """Each Gaussian's nearest particles, at rest, and their shares."""

    gaussians: Gaussians
    particles: Int[np.ndarray, "n k"]
    shares: Float64[np.ndarray, "n k"]
    rest: Float64[np.ndarray, "p 3"]

    def frame_residual(
        self, x: Float[np.ndarray, "p 3"], D: Float[np.ndarray, "p 3 3"]
    ) -> FrameResidual:
        """How the Gaussians are where particles are at `x`, deformed by `D` since they were at rest."""
        usual = self.gaussians
        offset = usual.means[:, None].astype(float) - self.rest[self.particles]
        there = x[self.particles] + np.einsum("nkij,nkj->nki", D[self.particles], offset)
        means = (self.shares[..., None] * there).sum(1)
        F = _held(np.einsum("nk,nkij->nij", self.shares, D[self.particles]))
        covariances = F @ shapes(usual.quats, usual.scales) @ np.swapaxes(F, 1, 2)
        variances, axes = np.linalg.eigh(covariances)
        axes[:, :, 0] *= np.sign(np.linalg.det(axes))[:, None]
        sh = usual.sh
        if sh.shape[1] > 1:
            left, _, right = np.linalg.svd(F)
            sh = harmonics.turned(sh, left @ right)
        now = replace(
            usual,
            means=means.astype(np.float32),
            quats=quaternions(axes).astype(np.float32),
            scales=np.sqrt(np.maximum(variances, THINNEST**2)).astype(np.float32),
            sh=sh,
        )
        return frame_residuals.difference(usual, now, np.arange(len(usual)))


def bind(
    surface: Gaussians,
    rest: Float64[np.ndarray, "p 3"],
    spacing: float,
    neighbours: int,
    inside: bool,
) -> Bound:
    """Bind surface Gaussians to particles `spacing` metres apart, each to so many of the nearest ones.

    With `inside` the particles below the surface get Gaussians too, in the color of the nearest surface: what flows
    apart shows them.
    """
    every = surface
    if inside:
        near, away = nearest(rest, surface.means, 1)
        deep = np.flatnonzero(away[:, 0] > spacing)
        every = joined([surface, _blobs(surface, near[deep, 0], rest[deep], INNER * spacing)])
    particles, away = nearest(every.means, rest, neighbours)
    weights = np.exp(-0.5 * ((away - away[:, :1]) / spacing) ** 2)
    return Bound(every, particles, weights / weights.sum(1, keepdims=True), rest)


def shown(bound: Bound, states: Sequence[tuple[np.ndarray, np.ndarray]]) -> Gaussians:
    """The Gaussians with a moment for each state (places and deformations) of the particles, one a frame."""
    return replace(
        bound.gaussians,
        frame_residuals={t: bound.frame_residual(x, D) for t, (x, D) in enumerate(states)},
    )


def _blobs(
    surface: Gaussians,
    like: Int[np.ndarray, "m"],
    at: Float64[np.ndarray, "m 3"],
    size: float,
) -> Gaussians:
    count = len(like)
    sh = np.zeros((count, surface.sh.shape[1], 3), np.float32)
    sh[:, 0] = surface.sh[like, 0]
    return Gaussians(
        means=at.astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        scales=np.full((count, 3), size, np.float32),
        opacities=surface.opacities[like],
        sh=np.clip(sh, -0.5 / SH0, 0.5 / SH0),
        ids=surface.ids[like],
    )


def _held(F: Float64[np.ndarray, "n 3 3"]) -> Float64[np.ndarray, "n 3 3"]:
    """Deformations without extremes: particles that flowed far tell nothing about the shape of a Gaussian."""
    left, stretch, right = np.linalg.svd(F)
    return (left * np.clip(stretch, 1 / MOST_WIDER, MOST_WIDER)[:, None]) @ right


def nearest(
    points: Float32[np.ndarray, "n 3"] | Float64[np.ndarray, "n 3"],
    others: Float32[np.ndarray, "m 3"] | Float64[np.ndarray, "m 3"],
    count: int,
) -> tuple[Int[np.ndarray, "n k"], Float64[np.ndarray, "n k"]]:
    """The nearest others of each point, nearest first, and how far they are."""
    count = min(count, len(others))
    index, away = np.zeros((len(points), count), int), np.zeros((len(points), count))
    middle = others.mean(0)
    here, there = np.asarray(points, float) - middle, np.asarray(others, float) - middle
    square = (there**2).sum(1)
    for start in range(0, len(here), CHUNK):
        some = here[start : start + CHUNK]
        far = np.maximum((some**2).sum(1)[:, None] + square - 2 * some @ there.T, 0.0)
        kept = np.argpartition(far, count - 1, axis=1)[:, :count]
        order = np.take_along_axis(far, kept, 1).argsort(1, kind="stable")
        kept = np.take_along_axis(kept, order, 1)
        index[start : start + CHUNK] = kept
        away[start : start + CHUNK] = np.sqrt(np.take_along_axis(far, kept, 1))
    return index, away
