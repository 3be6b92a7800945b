"""The reference itself: its derivatives by finite differences, its images by closed forms."""

import numpy as np
import pytest
import torch
from splat_cases import draw, one, splats, view

from rpaug.render.splat import Settings, View, _reference


@pytest.mark.parametrize("harmonics", [1, 16])
@pytest.mark.parametrize("antialiased", [False, True])
def test_gradcheck(harmonics, antialiased):
    given, at = splats(4, 5, harmonics, features=1), view(5, 4, 6.0)
    settings = Settings(antialiased=antialiased)
    inputs = [
        torch.tensor(a, dtype=torch.float64, requires_grad=True)
        for a in (
            given.means,
            given.opacities,
            given.sh,
            given.quats,
            3 * given.scales,
            given.features,
        )
    ]

    def images(means, opacities, sh, quats, scales, features):
        made, _, _ = _reference.rasterise(
            means,
            opacities,
            sh,
            quats,
            scales,
            None,
            features,
            at,
            settings,
            torch.zeros(3).double(),
        )
        return made.color, made.depth, made.alpha, made.features

    assert torch.autograd.gradcheck(images, inputs, eps=1e-7, atol=1e-4, rtol=1e-3)


def test_a_lone_splat_has_the_closed_form():
    """alpha = opacity * exp(-d^2 / (2 (f^2 s^2 / z^2 + 0.3))) about the projected centre, at integer pixels."""
    K = np.array([[50.0, 0, 12], [0, 50.0, 9], [0, 0, 1]])
    picture = draw(one(scale=0.1, opacity=0.8), View(K, np.eye(4), 25, 20), "reference")
    rows, columns = np.mgrid[:20, :25]
    square = (columns - 12) ** 2 + (rows - 9) ** 2
    alpha = 0.8 * np.exp(-square / (2 * ((50 * 0.1 / 2) ** 2 + 0.3)))
    alpha[alpha < 1 / 255] = 0
    np.testing.assert_allclose(picture.alpha, alpha, atol=1e-6)
    np.testing.assert_allclose(picture.color[9, 12], 0.8 * np.array([0.9, 0.5, 0.2]), atol=1e-6)
    np.testing.assert_allclose(picture.depth_expected[alpha > 0], 2.0, atol=1e-6)
    assert picture.surface_index[9, 12] == 0
    assert picture.surface_index[0, 0] == -1


def test_harmonics_are_orthonormal():
    """Gauss-Legendre in z times a uniform ring integrates products of degree 6 exactly."""
    z, weight = np.polynomial.legendre.leggauss(8)
    angle = np.arange(16) * np.pi / 8
    ring = np.sqrt(1 - z**2)[:, None] * np.stack([np.cos(angle), np.sin(angle)])[:, None]
    points = np.stack([*ring, np.broadcast_to(z[:, None], (8, 16))], -1).reshape(-1, 3)
    basis = _reference.harmonics(torch.tensor(points), 16).numpy()
    gram = (basis * np.repeat(weight, 16)[:, None]).T @ basis * np.pi / 8
    np.testing.assert_allclose(gram, np.eye(16), atol=1e-12)


def test_a_camera_or_settings_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="positive focal"):
        View(np.diag([-1.0, 1, 1]), np.eye(4), 4, 4)
    with pytest.raises(ValueError, match="1x1 or more"):
        View(np.eye(3), np.eye(4), 0, 4)
    with pytest.raises(ValueError, match="alpha_floor"):
        Settings(alpha_floor=1e-4)
