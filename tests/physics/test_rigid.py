"""Stiff things fall, topple and are pushed as MuJoCo's own boxes are."""

import numpy as np
import pytest

from rpaug.core import geometry
from rpaug.physics import simulate
from rpaug.physics.colliders import Boxes
from rpaug.physics.materials import Material
from rpaug.physics.rigid import Hinge, Rail, Rigid, columns
from rpaug.physics.simulate import SimulationSetting
from rpaug.physics.solids import Solid

HALF = np.array([0.03, 0.03, 0.06])


def box(pose: np.ndarray) -> np.ndarray:
    """Points all over a box."""
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 9)] * 3), -1).reshape(-1, 3)
    return geometry.transform(pose, HALF * grid[np.abs(grid).max(1) == 1])


def test_it_falls_as_the_formula_says_and_rests_on_the_floor() -> None:
    points = box(geometry.rigid(np.zeros(3), np.array([0, 0, 0.26])))
    fall = Rigid(points, 500.0, 0.0).run(41, 0.05)
    assert (fall.motions[0] == np.eye(4)).all()
    assert fall.motions[3, 2, 3] == pytest.approx(-0.5 * 9.81 * 0.15**2, rel=0.01)
    ends = geometry.transform(fall.motions[-1], points)
    assert abs(ends[:, 2].min()) < 1e-3
    assert np.ptp(ends[:, 2]) == pytest.approx(0.12, abs=2e-3)


def test_a_tilted_box_topples() -> None:
    points = box(geometry.rigid(np.array([0, 0.6, 0]), np.zeros(3)))
    points[:, 2] -= points[:, 2].min() - 1e-3
    ends = geometry.transform(Rigid(points, 500.0, 0.0).run(41, 0.05).motions[-1], points)
    assert np.ptp(ends[:, 2]) == pytest.approx(0.06, abs=2e-3)


def test_a_recorded_box_pushes_it_as_far_as_it_goes() -> None:
    track = np.tile(np.eye(4), (21, 1, 1))
    track[:, :3, 3] = np.linspace([-0.1, 0, 0.02], [0.1, 0, 0.02], 21)
    pusher = Boxes.of([track], [np.eye(4)], [np.array([0.02, 0.06, 0.01])], [0.005], 0.05)
    points = box(geometry.rigid(np.zeros(3), np.array([0, 0, HALF[2]])))
    fall = Rigid(points, 500.0, 0.0, boxes=pusher, grip=0.2).run(21, 0.05)
    assert fall.boxes[0] > 0
    pushed = fall.motions[-1, 0, 3]
    assert pushed == pytest.approx(0.1 + 0.025 + HALF[0], abs=0.004)


def test_columns_hold_it_up() -> None:
    x, y = np.meshgrid(np.arange(-0.1, 0.1, 0.004), np.arange(-0.1, 0.1, 0.004))
    image_cache = columns(np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.1)], -1), 0.0, 0.02)
    points = box(geometry.rigid(np.zeros(3), np.array([0, 0, 0.18])))
    ends = geometry.transform(
        Rigid(points, 500.0, 0.0, columns=image_cache).run(21, 0.05).motions[-1], points
    )
    assert ends[:, 2].min() == pytest.approx(0.1, abs=2e-3)


def drawer() -> np.ndarray:
    """A box in the air with a bar before it, which a finger fits behind."""
    bar = geometry.rigid(np.zeros(3), np.array([0.1, 0, 0.3]))
    return np.concatenate(
        [box(geometry.rigid(np.zeros(3), np.array([0, 0, 0.3]))), box(bar) * [1, 0.2, 1]]
    )


def finger(start: float, stop: float) -> Boxes:
    track = np.tile(np.eye(4), (21, 1, 1))
    track[:, :3, 3] = np.linspace([start, 0, 0.3], [stop, 0, 0.3], 21)
    return Boxes.of([track], [np.eye(4)], [np.full(3, 0.003)], [0.002], 0.05)


def test_what_is_on_a_rail_goes_along_it_as_far_as_it_is_pulled_and_no_farther() -> None:
    rail = Rail((1.0, 0.0, 0.0), 0.0, 0.08)
    points = drawer()
    still = Rigid(points, 500.0, None, rail=rail).run(11, 0.05)
    np.testing.assert_allclose(still.motions, np.tile(np.eye(4), (11, 1, 1)), atol=1e-6)
    # The bar's near side is at 7 cm, the finger's and its own balls are 5 and 3 mm thick.
    pulled = Rigid(points, 500.0, None, boxes=finger(0.05, 0.12), rail=rail).run(21, 0.05)
    assert pulled.motions[-1, 0, 3] == pytest.approx(0.12 + 0.005 + 0.003 - 0.07, abs=0.003)
    assert pulled.boxes[0] > 0
    far = Rigid(points, 500.0, None, boxes=finger(0.05, 0.25), rail=rail).run(21, 0.05)
    assert 0.0795 < far.motions[:, 0, 3].max() < 0.083
    for fall in (pulled, far):
        assert np.abs(fall.motions[:, :3, :3] - np.eye(3)).max() < 1e-9
        assert np.abs(fall.motions[:, 1:3, 3]).max() < 1e-9


def test_what_is_fixed_stays() -> None:
    rail = Rail((0.0, 0.0, 1.0), 0.0, 0.0)
    fall = Rigid(drawer(), 500.0, None, boxes=finger(0.05, 0.1), rail=rail).run(21, 0.05)
    assert (fall.motions == np.eye(4)).all()
    assert rail.describe() == {"joint": "fixed"}


def board() -> np.ndarray:
    """A board that stands on its edge along y, 20 cm wide, with its foot at a height of 30 cm."""
    y, z = np.meshgrid(np.linspace(-0.1, 0.1, 41), np.linspace(0.3, 0.4, 21))
    side = np.stack([np.zeros(y.size), y.ravel(), z.ravel()], -1)
    return np.concatenate([side + np.array([x, 0, 0]) for x in (-0.003, 0.003)])


def test_what_is_on_a_hinge_turns_about_it_and_a_stiff_one_holds() -> None:
    lean = 0.4
    tilt = geometry.rigid(np.array([0.0, lean, 0.0]), np.zeros(3))
    at = np.array([0.0, 0.0, 0.3])
    points = (board() - at) @ tilt[:3, :3].T + at
    hinge = Hinge((0.0, 0.0, 0.3), (0.0, 1.0, 0.0), 0.0, 1.0, stiff=True)
    still = Rigid(points, 500.0, None, rail=hinge).run(11, 0.05)
    assert np.abs(still.motions - np.eye(4)).max() < 0.01
    loose = Hinge(hinge.at, hinge.axis, hinge.low, hinge.high)
    fallen = Rigid(points, 500.0, None, rail=loose).run(21, 0.05).motions[-1]
    np.testing.assert_allclose(fallen[:3, :3], geometry.rotation(np.array([0, 1.0, 0])), atol=5e-3)
    np.testing.assert_allclose(geometry.transform(fallen, at[None])[0], at, atol=1e-6)


def test_a_solid_falls_as_its_points_do() -> None:
    pose = geometry.rigid(np.zeros(3), np.array([0, 0, 0.26]))
    hull = Rigid(box(pose), 500.0, 0.0).run(11, 0.05)
    solid = Rigid(box(pose), 500.0, 0.0, solid=Solid("box", pose, tuple(HALF))).run(11, 0.05)
    np.testing.assert_allclose(solid.motions, hull.motions, atol=1e-3)


def test_a_cylinder_that_topples_goes_straight_and_is_not_turned_by_its_own_axes() -> None:
    """By symmetry; MuJoCo puts contacts at angles from the cylinder's own x axis, which steps must be short for."""
    ends = []
    for turn in (0.5, 2.0):
        pose = geometry.rigid(np.array([0, 0, turn]), np.array([0, 0, 0.06]))
        one = Rigid(np.eye(3), 525.0, 0.0, friction=1.5, velocity=(0, 1.2, 0),
                    solid=Solid("cylinder", pose, (0.045, 0.06)))  # fmt: skip
        end = one.run(31, 0.05).motions[-1]
        ends.append(geometry.transform(end, pose[None, :3, 3])[0])
    assert all(0.1 < end[1] < 0.115 and abs(end[0]) < 0.005 for end in ends), ends


@pytest.mark.parametrize(("inside", "about"), [(False, False), (True, True)])
def test_what_begins_inside_of_something_is_thrown_about(inside: bool, about: bool) -> None:
    x, y = np.meshgrid(np.arange(0.0, 0.02, 0.004), np.arange(-0.02, 0.02, 0.004))
    post = np.stack([x.ravel() + (0.02 if inside else 0.2), y.ravel(), np.full(x.size, 0.1)], -1)
    points = box(geometry.rigid(np.zeros(3), np.array([0, 0, HALF[2] + 0.02])))
    fall = Rigid(points, 500.0, 0.0, columns=columns(post, 0.0)).run(21, 0.05)
    how = SimulationSetting(Material())
    assert simulate.thrown(fall.motions, points.mean(0), how) is about
    given = SimulationSetting(Material(), velocity=(6.0, 0.0, 0.0))
    assert not simulate.thrown(fall.motions, points.mean(0), given)
