"""What a simulation of soft things must hold, in short; tools/bench/physics.py measures it in full."""

from dataclasses import replace

import numpy as np
import pytest

from rpaug.core.errors import Unsupported
from rpaug.physics.colliders import Boxes, Still, still
from rpaug.physics.materials import Law, Material
from rpaug.physics.soft import COURANT, Soft, block, step_for, too_stiff
from rpaug.physics.stress import singular

CELL = 0.01
SIDE = 0.04
KINDS = (
    Material(young=5e4),
    Material(law=Law.JELLY, young=5e4, viscosity=5.0),
    Material(law=Law.PLASTICINE, young=5e4, yield_stress=1e3),
    Material(law=Law.SAND, young=5e4, friction=35.0),
)


def room(floor: float | None = 0.0) -> Still:
    return still(np.array([-0.15, -0.15, -0.3]), np.array([0.2, 0.2, 0.4]), CELL, floor)


def cube(material: Material, height: float, floor: float | None = 0.0, **more) -> Soft:
    x, volume = block((SIDE,) * 3, (0, 0, height), CELL / 2)
    return Soft(x, volume, material, room(floor), **more)


def test_a_free_fall_is_that_of_the_formula() -> None:
    one = cube(KINDS[0], 0.3, floor=None)
    before = one.x.copy()
    one.run(0.2)
    fallen = before[:, 2].mean() - one.x[:, 2].mean()
    assert fallen == pytest.approx(0.5 * 9.81 * 0.2**2, rel=0.01)
    np.testing.assert_allclose(one.F, np.tile(np.eye(3), (len(one.x), 1, 1)), atol=1e-6)


@pytest.mark.parametrize("material", KINDS, ids=lambda m: m.law.name)
def test_momentum_stays_where_nothing_is_touched(material: Material) -> None:
    one = cube(material, 0.1, floor=None, gravity=(0, 0, 0))
    one.v[:] = np.cross([0, 0, 20.0], one.x - one.x.mean(0)) + np.array([0.5, 0.2, 0])
    before = one.momentum()
    one.run(0.03)
    np.testing.assert_allclose(one.momentum(), before, rtol=0, atol=1e-4 * np.abs(before).max())


def test_friction_takes_the_same_speed_of_slow_and_fast_things() -> None:
    """Coulomb's: while it slides it loses friction x gravity x time, whatever its speed."""
    for speed in (0.3, 2.0):
        one = cube(KINDS[0], 0.0, friction=0.5)
        one.v[:, 0] = speed
        one.run(0.05)
        assert speed - one.v[:, 0].mean() == pytest.approx(0.5 * 9.81 * 0.05, rel=0.1)


def test_a_beam_bends_as_far_as_theory_says() -> None:
    young, length, side = 1e6, 0.2, 0.04
    x, volume = block((length + 0.04, side, side), (-0.04, 0, 0.5), CELL / 2)
    space = still(np.array([-0.08, -0.04, 0.4]), np.array([0.26, 0.08, 0.6]), CELL)
    wall = space.origin[0] + CELL * np.arange(space.distance.shape[0]) <= 1e-9
    distance = np.where(wall[:, None, None], np.float32(-1), space.distance)
    space = replace(space, distance=distance)
    one = Soft(x, volume, Material(young=young, poisson=0.0), space, friction=-1.0)
    tip, bends = x[:, 0] > length - CELL, []
    for k in range(16):
        one.run(0.02)
        one.v *= (
            0.5  # over half of critical: a fiftieth of the swing is left when it is first looked at
        )
        one.C *= 0.5
        if k >= 12:
            bends.append((x[tip, 2] - one.x[tip, 2]).mean())
    theory = 1000 * 9.81 * length**4 * 12 / (8 * young * side**2)
    assert np.mean(bends) == pytest.approx(theory, rel=0.1)


@pytest.mark.parametrize("material", KINDS, ids=lambda m: m.law.name)
def test_no_energy_comes_from_nowhere(material: Material) -> None:
    one = cube(material, 0.03)
    start = sum(one.energy())
    for _ in range(10):
        one.run(0.015)
        assert sum(one.energy()) < 1.01 * start
    assert one.x[:, 2].min() > -CELL / 2


@pytest.mark.parametrize("material", KINDS, ids=lambda m: m.law.name)
def test_half_the_step_ends_in_the_same_place(material: Material) -> None:
    """What becomes of a cube that is let go on the floor, at the scale of the cube."""
    ends = []
    for courant in (COURANT, COURANT / 2):
        one = cube(material, 0.0, courant=courant)
        one.run(0.1)
        ends.append(one.x)
    assert np.linalg.norm(ends[0] - ends[1], axis=1).mean() < 0.05 * SIDE


def test_threads_do_not_change_a_bit() -> None:
    x, volume = block((0.1, 0.1, 0.05), (-0.05, -0.05, 0.02), 0.005)
    several = [Soft(x, volume, KINDS[0], room(), threads=n) for n in (1, 2)]
    for one in several:
        assert len(one.x) > 3000
        one.run(0.02)
    assert np.array_equal(several[0].x, several[1].x)


@pytest.mark.parametrize("seed", range(3))
def test_whatever_is_allowed_stays_a_number(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for law in Law:
        made_of = Material(
            law=law, density=10 ** rng.uniform(1, 4.3), young=10 ** rng.uniform(2, 5),
            poisson=rng.uniform(0, 0.49), yield_stress=10 ** rng.uniform(0, 6),
            friction=rng.uniform(0, 60), viscosity=10 ** rng.uniform(-2, 1),
        )  # fmt: skip
        pose = np.tile(np.eye(4), (2, 1, 1))
        pose[1, :3, 3] = rng.normal(0, 0.3, 3)
        pusher = Boxes(pose[None], np.full((1, 3), 0.02), np.array([0.01]), 0.05)
        if too_stiff(made_of, CELL):
            continue
        one = cube(made_of, 0.02, boxes=pusher, friction=rng.uniform(-1, 2))
        one.v[:] = rng.normal(0, 5, 3)
        one.F += rng.normal(0, 0.3, (3, 3))
        for _ in range(100):
            one._step(one._step_size(), map)
        assert all(np.isfinite(part).all() for part in (one.x, one.v, one.C, one.F, one.D))


def test_what_leaves_the_grid_is_held_and_counted() -> None:
    one = cube(KINDS[0], 0.2)
    one.v[:] = [30.0, 0, 0]
    one.run(0.05)
    assert one.account.clamped > 0
    assert (one.x <= one.grid.most).all()
    one.x[3] = np.nan
    one.run(0.001)
    assert np.isfinite(one.x).all()


def test_a_moving_box_pushes_and_is_told_of() -> None:
    pose = np.tile(np.eye(4), (11, 1, 1))
    pose[:, :3, 3] = np.linspace([-0.06, 0.02, 0.02], [0.04, 0.02, 0.02], 11)
    pusher = Boxes(pose[None], np.array([[0.02, 0.03, 0.02]]), np.array([0.002]), 0.05)
    one = cube(KINDS[0], 0.0, boxes=pusher)
    one.run(0.5)
    assert one.account.boxes[0] > 0
    assert one.x[:, 0].min() > 0.04  # the box ends with its face at 62 mm


def test_what_is_too_stiff_is_refused_with_the_step() -> None:
    steel = Material(young=2e11, density=7860)
    assert "shorter than" in (too_stiff(steel, CELL) or "")
    assert step_for(steel, CELL) < 1e-6
    with pytest.raises(Unsupported, match="needs steps of"):
        cube(steel, 0.1)
    with pytest.raises(Unsupported, match="ask for larger cells"):
        still(np.zeros(3), np.ones(3), 1e-3)


@pytest.mark.parametrize("seed", range(5))
def test_singular_values_are_those_of_lapack(seed: int) -> None:
    F = np.eye(3) + 0.4 * np.random.default_rng(seed).normal(size=(3, 3))
    F[:, 0] *= np.sign(np.linalg.det(F))
    u, s, w = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    singular(F, u, s, w)
    np.testing.assert_allclose(u @ np.diag(s) @ w.T, F, atol=1e-10)
    np.testing.assert_allclose(np.sort(s)[::-1], np.linalg.svd(F)[1], rtol=1e-8)
