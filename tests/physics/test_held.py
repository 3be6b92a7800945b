"""A drawer is on its rail, a lid on its hinge, what stands close on both sides holds, the rest is free."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from tabletop import scene

from rpaug.core import geometry
from rpaug.core.types import Body, Scene
from rpaug.physics.held import enclosed, held
from rpaug.physics.rigid import Hinge, Rail

HANDLE, LEVEL = 77, 0.75
AXIS = np.array([0.6, -0.8, 0.0])


@lru_cache(1)
def grid() -> np.ndarray:
    side = np.linspace(-0.05, 0.05, 9)
    return np.stack(np.meshgrid(side, side, side), -1).reshape(-1, 3)


def moving(way: np.ndarray, turn: float = 0.0) -> Scene:
    """A scene in which one thing goes along `way` and turns about the vertical."""
    poses = [
        geometry.rigid(np.array([0, 0, turn * s]), s * way)
        for s in np.linspace(0, 1, scene().episode.length)
    ]
    body = Body(frozenset({HANDLE}), np.stack(poses), "aligned")
    return replace(scene(), bodies=(body,))


def found(where: Scene, foot: float, standing: np.ndarray) -> Rail | Hinge | None:
    points = grid() + np.array([0, 0, LEVEL + foot + 0.05])
    return held(where, frozenset({HANDLE}), points, standing, LEVEL, 0.02)


NOTHING = np.zeros((0, 3))


@pytest.mark.gl
def test_what_slides_above_the_table_is_on_a_rail_as_long_as_its_recorded_way() -> None:
    rail = found(moving(0.15 * AXIS), 0.1, NOTHING)
    assert isinstance(rail, Rail)
    assert abs(np.dot(rail.axis, AXIS)) == pytest.approx(1, abs=1e-6)
    assert rail.high - rail.low == pytest.approx(0.15, abs=1e-6)
    given = rail.describe()
    assert given["joint"] == "slide"
    assert 0 in given["range"]


@pytest.mark.gl
@pytest.mark.parametrize(
    ("way", "turn", "foot"),
    [(0.15 * AXIS, 0.0, 0.0), (0.15 * AXIS, 0.5, 0.1), (np.array([0, 0, 0.15]), 0.0, 0.1)],
    ids=["pushed over the table", "turned", "lifted"],
)
def test_what_is_pushed_turned_or_lifted_is_free(way, turn: float, foot: float) -> None:
    assert found(moving(way, turn), foot, NOTHING) is None


@pytest.mark.gl
def test_what_never_moved_is_fixed_where_it_is_enclosed() -> None:
    middle = [0, 0, LEVEL + 0.15]
    sides = [grid() * [0, 1, 1] + middle + [x, 0, 0] for x in (-0.058, 0.058)]
    still = moving(np.zeros(3))
    rail = found(still, 0.1, np.concatenate(sides))
    assert rail is not None
    assert rail.fixed
    assert found(still, 0.1, sides[0]) is None
    assert found(still, 0.0, np.concatenate(sides)) is None


def test_what_is_far_away_encloses_nothing() -> None:
    sides = [grid() * [0, 1, 1] + [x, 0, 0] for x in (-0.09, 0.09)]
    assert not enclosed(grid(), np.concatenate(sides))
    assert not enclosed(grid(), NOTHING)


def swinging(angle: float, away: float, sunk: float = 0.0) -> Scene:
    """A scene in which one thing turns about an upright axis `away` metres beside it, and sinks as it does."""
    at = np.array([0.05 + away, 0.0, LEVEL])
    poses = []
    for s in np.maximum(np.linspace(-0.5, 1, scene().episode.length), 0):
        pose = geometry.rigid(np.array([0, 0, angle * s]), np.zeros(3))
        pose[:3, 3] = at - pose[:3, :3] @ at - [0, 0, sunk * s]
        poses.append(pose)
    return replace(scene(), bodies=(Body(frozenset({HANDLE}), np.stack(poses), "aligned"),))


@pytest.mark.gl
def test_what_turns_about_an_axis_beside_it_is_on_a_hinge() -> None:
    hinge = found(swinging(-0.9, 0.005), 0.1, NOTHING)
    assert isinstance(hinge, Hinge)
    assert abs(hinge.axis[2]) == pytest.approx(1, abs=1e-6)
    np.testing.assert_allclose(hinge.at[:2], [0.055, 0.0], atol=1e-6)
    assert hinge.high - hinge.low == pytest.approx(0.9, abs=1e-6)
    assert min(abs(hinge.low), abs(hinge.high)) < 1e-9
    assert hinge.stiff
    assert hinge.describe()["joint"] == "hinge"


@pytest.mark.gl
@pytest.mark.parametrize(
    ("angle", "away", "sunk", "foot"),
    [(0.1, 0.005, 0.0, 0.1), (0.9, 0.2, 0.0, 0.1), (0.9, 0.005, 0.05, 0.1), (0.9, 0.005, 0.0, 0.0)],
    ids=["hardly turned", "carried round", "sunk", "turned on the table"],
)
def test_what_shows_no_hinge_is_free(angle, away, sunk, foot: float) -> None:
    assert found(swinging(angle, away, sunk), foot, NOTHING) is None
