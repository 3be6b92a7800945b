"""Gaussians drawn from a mesh: they lie on it, flat, and its images are what they show."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpaug.assets import library, sampled
from rpaug.core import geometry
from rpaug.core.types import Mesh
from rpaug.gaussians.gaussians import normals

COUNT = 60


def triangle(corners: np.ndarray, color: tuple[int, int, int] = (200, 30, 90)) -> Mesh:
    across = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    normal = across / np.linalg.norm(across)
    faces = np.array([[0, 1, 2]], np.int32)
    image = np.full((4, 4, 3), color, np.uint8)
    return Mesh(corners, np.tile(normal, (3, 1)), np.full((3, 2), 0.5), faces, image)


def axes(quats: np.ndarray) -> np.ndarray:
    """The rotations of unit quaternions (w, x, y, z), by their textbook formula."""
    w, x, y, z = quats.astype(float).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


@given(st.lists(st.floats(-np.pi, np.pi), min_size=3, max_size=3), st.floats(0.02, 0.3))
def test_every_disc_lies_in_its_face(turn: list[float], size: float) -> None:
    pose = geometry.rigid(np.array(turn), np.array([0.1, -0.2, 0.3]))
    flat = size * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.3, 0.8, 0.0]])
    thing = triangle(geometry.transform(pose, flat))
    drawn = sampled.gaussians(thing, COUNT)
    np.testing.assert_allclose(np.linalg.norm(drawn.quats, axis=1), 1, atol=1e-5)
    thin = np.take_along_axis(axes(drawn.quats), drawn.scales.argmin(1)[:, None, None], 2)[..., 0]
    np.testing.assert_allclose(thin, np.tile(pose[:3, 2], (COUNT, 1)), atol=1e-4)
    np.testing.assert_allclose(normals(drawn.quats), thin, atol=1e-4)
    own = geometry.transform(geometry.inverse(pose), drawn.means.astype(float)) / size
    assert np.abs(own[:, 2]).max() < 1e-4
    weights = np.linalg.solve(np.array([[1.0, 0.3], [0.0, 0.8]]), own[:, :2].T)
    assert weights.min() > -1e-4
    assert weights.sum(0).max() < 1 + 1e-4


@pytest.mark.parametrize("name", ["mug_red", "cereal_box", "lemon"])
def test_discs_of_a_thing_look_outwards_all_over_it(name: str) -> None:
    thing = library.mesh(name)
    drawn = sampled.gaussians(thing, 4 * COUNT)
    axis = axes(drawn.quats)[:, :, 2]
    corners = thing.points[thing.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1)
    faces = across[area > 0] / area[area > 0, None]
    middles = corners[area > 0].mean(1)
    away = np.abs(((drawn.means[:, None] - middles) * faces).sum(-1))
    fits = (away < 1e-5) & (axis @ faces.T > 1 - 1e-4)
    assert fits.any(1).all()
    # As many on a part of the surface as its share of the area: their mean is the surface's.
    mean = (middles * area[area > 0, None]).sum(0) / area.sum()
    np.testing.assert_allclose(drawn.means.mean(0), mean, atol=0.03 * np.ptp(thing.points))
