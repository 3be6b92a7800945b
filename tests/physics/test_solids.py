"""Points of the surface of simple solids, seen from above, tell which solid they are; others are none."""

import numpy as np
import pytest

from rpaug.core import geometry
from rpaug.physics.solids import LYING, Solid, solid

LEVEL = 0.75


def standing(kind: str, size: tuple[float, ...], turn: float, lying: bool) -> Solid:
    pose = geometry.rigid(np.array([0, 0, turn]), np.array([0.3, -0.2, 0.0]))
    if lying:
        pose[:3, :3] = pose[:3, :3] @ LYING
    pose[2, 3] = LEVEL + Solid(kind, pose, size).reach(np.array([[0, 0, -1.0]]))[0]
    return Solid(kind, pose, size)


def seen(what: Solid, count: int = 2500) -> np.ndarray:
    """Points on its surface, but for the lowest part: random ones, led to the surface along its own distance."""
    rng = np.random.default_rng(0)
    points = what.pose[:3, 3] + rng.uniform(-0.15, 0.15, (count, 3))
    for _ in range(40):
        slope = np.stack(
            [
                (what.distance(points + s) - what.distance(points - s)) / 2e-6
                for s in 1e-6 * np.eye(3)
            ],
            1,
        )
        points = points - what.distance(points)[:, None] * slope
    return points[points[:, 2] > LEVEL + 0.01]


@pytest.mark.parametrize(
    ("kind", "size", "lying"),
    [
        ("box", (0.055, 0.032, 0.045), False),
        ("cylinder", (0.045, 0.06), False),
        ("cylinder", (0.03, 0.07), True),
        ("capsule", (0.03, 0.05), True),
        ("sphere", (0.04,), False),
    ],
)
def test_a_solid_is_found_from_its_points(kind: str, size: tuple[float, ...], lying: bool) -> None:
    true = standing(kind, size, 0.4, lying)
    found = solid(seen(true), 0.006, LEVEL)
    assert found is not None
    assert found.kind == kind
    np.testing.assert_allclose(sorted(found.size), sorted(size), atol=2e-4)
    np.testing.assert_allclose(found.pose[:3, 3], true.pose[:3, 3], atol=2e-4)


def test_a_cone_is_none_of_them() -> None:
    rng = np.random.default_rng(0)
    up, turn = rng.uniform(0, 1, 2000), rng.uniform(0, 2 * np.pi, 2000)
    r = 0.05 * (1 - up)
    points = np.stack([r * np.cos(turn), r * np.sin(turn), LEVEL + 0.1 * up], -1)
    assert solid(points, 0.006, LEVEL) is None


def test_an_octagonal_block_is_no_cylinder() -> None:
    rng = np.random.default_rng(0)
    turn = rng.uniform(0, 2 * np.pi, 2000)
    r = 0.05 * np.cos(np.pi / 8) / np.cos((turn % (np.pi / 4)) - np.pi / 8)
    points = np.stack([r * np.cos(turn), r * np.sin(turn), LEVEL + rng.uniform(0, 0.1, 2000)], -1)
    assert solid(points, 0.006, LEVEL) is None
