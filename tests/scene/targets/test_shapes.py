"""Measured shapes, on points sampled from exact ones as cameras above would see them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpaug.core import geometry
from rpaug.scene.targets.shapes import WORDS, shape

Cloud = tuple[np.ndarray, np.ndarray]


def wall(
    radius: float, height: float, inward: bool, rng: np.random.Generator, n: int = 300
) -> Cloud:
    turn = rng.uniform(0, 2 * np.pi, n)
    out = np.stack([np.cos(turn), np.sin(turn), np.zeros(n)], -1)
    at = radius * out
    at[:, 2] = rng.uniform(0, height, n)
    return at, -out if inward else out


def disc(radius: float, z: float, rng: np.random.Generator, n: int = 200) -> Cloud:
    far, turn = radius * np.sqrt(rng.random(n)), rng.uniform(0, 2 * np.pi, n)
    at = np.stack([far * np.cos(turn), far * np.sin(turn), np.full(n, z)], -1)
    return at, np.tile([0.0, 0, 1], (n, 1))


def slab(half: tuple[float, float], z: float, rng: np.random.Generator, n: int = 200) -> Cloud:
    at = np.c_[rng.uniform(-1, 1, (n, 2)) * half, np.full(n, z)]
    return at, np.tile([0.0, 0, 1], (n, 1))


def faces(
    half: tuple[float, float], height: float, rng: np.random.Generator, n: int = 100
) -> Cloud:
    at, out = [], []
    for axis in (0, 1):
        for side in (-1, 1):
            p = np.c_[rng.uniform(-1, 1, (n, 2)) * half, rng.uniform(0, height, n)]
            p[:, axis] = side * half[axis]
            normal = np.zeros((n, 3))
            normal[:, axis] = side
            at.append(p)
            out.append(normal)
    return np.concatenate(at), np.concatenate(out)


def joined(*clouds: Cloud) -> Cloud:
    return np.concatenate([c[0] for c in clouds]), np.concatenate([c[1] for c in clouds])


def example(name: str, rng: np.random.Generator) -> Cloud:
    match name:
        case "block":
            return joined(faces((0.03, 0.05), 0.08, rng), slab((0.03, 0.05), 0.08, rng))
        case "box":
            inside = faces((0.085, 0.095), 0.06, rng)
            return joined(
                faces((0.09, 0.10), 0.07, rng),
                (inside[0] + [0, 0, 0.01], -inside[1]),
                slab((0.08, 0.09), 0.008, rng),
            )
        case "cylinder":
            return joined(wall(0.04, 0.12, False, rng), disc(0.04, 0.12, rng))
        case "cup":
            return joined(
                wall(0.04, 0.08, False, rng), wall(0.037, 0.08, True, rng), disc(0.036, 0.006, rng)
            )
        case "bowl":
            return joined(
                wall(0.08, 0.05, False, rng), wall(0.077, 0.05, True, rng), disc(0.076, 0.006, rng)
            )
        case "ball":
            out = rng.normal(size=(600, 3))
            out /= np.linalg.norm(out, axis=-1, keepdims=True)
            return 0.04 * out, out
        case "pad":
            return joined(slab((0.07, 0.06), 0.01, rng), faces((0.07, 0.06), 0.01, rng, 10))
    raise ValueError(name)


@pytest.mark.parametrize("name", ["block", "box", "cylinder", "cup", "bowl", "ball", "pad"])
@settings(max_examples=12, deadline=None)
@given(turn=st.floats(-3.1, 3.1), seed=st.integers(0, 99))
def test_shapes_are_told_however_they_stand(name: str, turn: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, normals = example(name, rng)
    pose = geometry.rigid(np.array([0, 0, turn]), np.array([0.3, -0.2, 0.75]))
    points = geometry.transform(pose, points) + rng.normal(0, 0.0005, points.shape)
    assert shape(points, normals @ pose[:3, :3].T) == name


def test_too_little_or_too_large_has_no_shape() -> None:
    rng = np.random.default_rng(0)
    points, normals = example("cup", rng)
    assert shape(points[:20], normals[:20]) == ""
    assert shape(5 * points, normals) == ""
    assert shape(points, np.zeros_like(normals)) == ""


def test_every_word_means_a_shape_that_is_measured() -> None:
    given = {"block", "box", "cylinder", "cup", "bowl", "ball", "pad"}
    assert set().union(*WORDS.values()) == given
