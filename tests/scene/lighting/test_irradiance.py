"""Light that a turning surface meets."""

import numpy as np

from rpaug.gaussians.gaussians import SH0, Placement, normals
from rpaug.render.splat import Splats
from rpaug.scene.lighting import irradiance


def test_even_light_shades_nothing() -> None:
    faces = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    faces /= np.linalg.norm(faces, axis=1, keepdims=True)
    assert np.array_equal(
        irradiance.shading(irradiance.basis(faces), irradiance.even()), np.ones(50, np.float32)
    )


def test_light_from_above_brightens_what_faces_up() -> None:
    light = irradiance.even()
    light[3] = 0.4
    up, down = irradiance.shading(
        irradiance.basis(np.array([[0, 0, 1.0], [0, 0, -1.0]], np.float32)), light
    )
    assert np.isclose(up, 1.4)
    assert np.isclose(down, 0.6)


def test_no_face_goes_black() -> None:
    light = irradiance.even()
    light[1] = 50.0
    assert irradiance.shading(irradiance.basis(np.array([[-1.0, 0, 0]], np.float32)), light)[
        0
    ] == np.float32(irradiance.LEAST)


def splats(n: int = 6) -> Splats:
    rng = np.random.default_rng(1)
    return Splats(
        means=rng.normal(size=(n, 3)).astype(np.float32),
        quats=rng.normal(size=(n, 4)).astype(np.float32),
        scales=np.full((n, 3), 0.1, np.float32),
        opacities=np.full(n, 0.5, np.float32),
        sh=rng.uniform(-0.5, 0.5, (n, 1, 3)).astype(np.float32),
    )


def placement(light: np.ndarray) -> Placement:
    quarter = np.eye(4)
    quarter[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    turn = np.array([[np.sqrt(0.5), 0, 0, np.sqrt(0.5)]])
    return Placement((np.arange(4),), (quarter[None],), (turn,), light)


def test_colors_of_placed_splats_are_shaded_by_their_faces_in_the_world() -> None:
    light = np.array([1, 0.3, -0.2, 0.1, 0.05, 0, 0.1, -0.1, 0.02])
    own = splats()
    there = placement(light).place(own, 0)
    lit = irradiance.shading(irradiance.basis(normals(there.quats[:4])), light)
    before, after = (0.5 + SH0 * one.sh[:, 0] for one in (own, there))
    assert np.allclose(after[:4], before[:4] * lit[:, None], atol=1e-6)
    assert np.array_equal(there.sh[4:], own.sh[4:])


def test_the_gradient_by_the_light_is_that_of_finite_differences() -> None:
    from types import SimpleNamespace

    light = np.array([1, 0.3, -0.2, 0.1, 0.05, 0, 0.1, -0.1, 0.02])
    own, weights = splats(), np.random.default_rng(2).normal(size=(6, 1, 3)).astype(np.float32)

    def loss(at: np.ndarray) -> float:
        return float((placement(at).place(own, 0).sh.astype(np.float64) * weights).sum())

    gradients = SimpleNamespace(
        means=np.zeros((6, 3), np.float32), quats=np.zeros((6, 4)), sh=weights.copy()
    )
    there = placement(light)
    _, found = there.pull_back(gradients, own, there.place(own, 0), 0)  # type: ignore[arg-type]
    for k in range(irradiance.TERMS):
        step = np.eye(irradiance.TERMS)[k] * 1e-3
        wanted = (loss(light + step) - loss(light - step)) / 2e-3
        assert np.isclose(found[k], wanted, rtol=2e-2, atol=2e-3), k
