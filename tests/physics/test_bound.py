"""Gaussians go with the particles they are bound to; what turns, turns their shape and their harmonics.

Moments hold places as half floats, in multiples of a standard deviation: good to a tenth of a millimetre here.
"""

from dataclasses import replace

import numpy as np
import pytest

from rpaug.core import geometry
from rpaug.core.types import Gaussians
from rpaug.gaussians import frame_residuals, gaussians, harmonics
from rpaug.gaussians.carrying import SH0
from rpaug.gaussians.flowing import shapes
from rpaug.physics import bound, filling


def some(count: int = 40, terms: int = 4) -> Gaussians:
    rng = np.random.default_rng(0)
    return Gaussians(
        means=rng.uniform(0, 0.1, (count, 3)).astype(np.float32),
        quats=rng.normal(size=(count, 4)).astype(np.float32),
        scales=rng.uniform(0.001, 0.004, (count, 3)).astype(np.float32),
        opacities=np.full(count, 0.9, np.float32),
        sh=rng.normal(0, 0.3, (count, terms, 3)).astype(np.float32),
        ids=np.full(count, 5, np.int32),
    )


def particles() -> np.ndarray:
    side = np.linspace(0, 0.1, 11)
    return np.stack(np.meshgrid(side, side, side), -1).reshape(-1, 3)


@pytest.mark.parametrize("neighbours", [1, 8])
def test_an_affine_motion_carries_them_exactly(neighbours: int) -> None:
    motion = np.array([[0.9, 0.2, 0.0], [-0.1, 1.1, 0.1], [0.0, 0.3, 0.8]])
    rest = particles()
    tied = bound.bind(some(), rest, 0.01, neighbours, inside=False)
    state = rest @ motion.T + [0.05, 0, 0.1], np.tile(motion, (len(rest), 1, 1))
    now = frame_residuals.at(bound.shown(tied, [state]), 0)
    np.testing.assert_allclose(now.means, some().means @ motion.T + [0.05, 0, 0.1], atol=1e-4)
    wanted = motion @ shapes(some().quats, some().scales) @ motion.T
    np.testing.assert_allclose(
        shapes(now.quats, now.scales), wanted, atol=2e-3 * np.abs(wanted).max()
    )


def test_a_turn_is_what_a_rigid_motion_does() -> None:
    motion = geometry.rigid(np.array([0.3, -0.5, 1.0]), np.array([0.1, 0, 0]))
    rest, turn = particles(), motion[:3, :3]
    tied = bound.bind(some(), rest, 0.01, 8, inside=False)
    state = geometry.transform(motion, rest), np.tile(turn, (len(rest), 1, 1))
    now, rigid = frame_residuals.at(bound.shown(tied, [state]), 0), gaussians.moved(some(), motion)
    np.testing.assert_allclose(now.means, rigid.means, atol=1e-4)
    np.testing.assert_allclose(
        shapes(now.quats, now.scales), shapes(rigid.quats, rigid.scales), atol=3e-8
    )
    np.testing.assert_allclose(
        now.sh, harmonics.turned(some().sh, np.tile(turn, (40, 1, 1))), atol=2e-3
    )


@pytest.mark.parametrize("terms", [1, 4, 9, 16])
def test_a_turned_color_is_seen_in_the_turned_direction(terms: int) -> None:
    rng = np.random.default_rng(1)
    sh, turn = rng.normal(size=(3, terms, 3)), geometry.rotation(np.array([0.4, 1.0, -0.2]))
    directions = rng.normal(size=(7, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    after = harmonics.turned(sh, np.tile(turn, (3, 1, 1)))
    seen = harmonics.basis(directions @ turn.T, terms) @ after
    np.testing.assert_allclose(seen, harmonics.basis(directions, terms) @ sh, atol=1e-9)


def test_the_inside_gets_gaussians_where_things_flow() -> None:
    surface = some()
    tied = bound.bind(surface, particles(), 0.01, 1, inside=True)
    assert len(tied.gaussians) > len(surface)
    assert set(tied.gaussians.ids.tolist()) == {5}


@pytest.mark.parametrize("order", [1, -1], ids=["top last", "top first"])
def test_columns_fill_a_box_that_stands(order: int) -> None:
    grid = np.linspace(0, 1, 41)
    faces = np.stack(np.meshgrid(grid, grid, grid), -1).reshape(-1, 3)
    faces = faces[(np.abs(faces - 0.5).max(1) > 0.49) & (faces[:, 2] > 0.1)]
    points = faces * [0.1, 0.08, 0.06] + [0.3, -0.2, 0.75]
    shelf = points[points[:, 2] > 0.809] - [0, 0, 0.04]  # what is seen below the top does not count
    found = filling.columns(np.concatenate([shelf, points])[::order], 0.0025, 0.75, 0.02)
    places, volume = found.filled(0.005)
    assert found.bottom == 0.75
    assert volume.sum() == pytest.approx(0.1 * 0.08 * 0.06, rel=0.08)
    assert (places > [0.297, -0.203, 0.75]).all()
    assert (places < [0.403, -0.117, 0.812]).all()


def test_the_inside_has_the_colors_of_the_surface_around_it() -> None:
    """Each blob looks like the Gaussian of the surface that is nearest to it; those near the surface are left out."""
    surface, rest, spacing = some(terms=1), particles(), 0.01
    surface = replace(surface, ids=(np.arange(40) % 3).astype(np.int32))
    tied = bound.bind(surface, rest, spacing, 1, inside=True)
    inner = gaussians.chosen(tied.gaussians, np.arange(len(tied.gaussians)) >= len(surface))
    away = np.linalg.norm(rest[:, None] - surface.means, axis=-1)
    deep = away.min(1) > spacing
    np.testing.assert_allclose(inner.means, rest[deep], atol=1e-6)
    like = away[deep].argmin(1)
    np.testing.assert_allclose(inner.sh[:, 0], surface.sh[like, 0].clip(-0.5 / SH0, 0.5 / SH0))
    np.testing.assert_array_equal(inner.ids, surface.ids[like])
    np.testing.assert_allclose(inner.opacities, surface.opacities[like])


@pytest.mark.parametrize("neighbours", [1, 3, 8])
def test_shares_are_of_the_nearest_particles_and_fall_with_distance(neighbours: int) -> None:
    rest = particles()
    tied = bound.bind(some(), rest, 0.01, neighbours, inside=False)
    away = np.linalg.norm(some().means[:, None] - rest, axis=-1)
    np.testing.assert_allclose(tied.shares.sum(1), 1)
    np.testing.assert_allclose(
        np.take_along_axis(away, tied.particles, 1), np.sort(away, 1)[:, :neighbours], atol=1e-6
    )
    assert (np.diff(tied.shares, axis=1) <= 1e-12).all()
