"""What breaks rasterisers, on every backend: finite, and equal to the float64 reference."""

import dataclasses

import numpy as np
import pytest
from gsplat_kernels import EMULATED, ON_GPU
from splat_cases import (
    assert_close,
    assert_within,
    composited_alike,
    draw,
    finite,
    gradients,
    on_a_ridge,
    on_a_threshold,
    one,
    pulls,
    relative,
    splats,
    together_of,
    view,
)

from rpaug.render.splat import Settings, Splats, View

backends = pytest.mark.parametrize("backend", ["reference", "numba", EMULATED, ON_GPU])
BY_GSPLAT = ("gsplat", EMULATED)
MOST_APART = 0.02  # of the pixels, on a threshold to rounding
PLAIN_QUAT = (1.0, 0.0, 0.0, 0.0)


def solid_pulls(given: Splats, at: View, settings: Settings | None = None) -> dict:
    """Random image gradients, that by depth only where a tenth of a pixel is covered at least."""
    images = pulls(at, 0 if given.features is None else given.features.shape[1])
    alpha = draw(given, at, "reference", settings).alpha
    return images | {"depth": np.where(alpha >= 0.1, images["depth"], np.float32(0))}


def same_as_reference(
    given: Splats, at: View, backend: str, settings: Settings | None = None
) -> None:
    """Image and gradients are finite and those of the reference: end to end, and given the same projection."""
    images, apart = solid_pulls(given, at, settings), np.zeros((at.height, at.width), bool)
    if backend in BY_GSPLAT:
        apart, ridge = on_a_threshold(given, at, settings), on_a_ridge(given, at, settings)
        assert apart.mean() <= MOST_APART
        assert ridge.sum() <= max(at.width, at.height)  # a needle's
        images = {name: _without(pull, apart | ridge) for name, pull in images.items()}
    picture, found = (
        draw(given, at, backend, settings),
        gradients(given, at, backend, settings, images),
    )
    assert np.isfinite(picture.color).all()
    assert np.isfinite(picture.depth_expected).all()
    assert finite(found)
    if backend == "reference":
        return
    expected, limit = draw(given, at, "reference", settings), 1e-3
    if backend in BY_GSPLAT:
        assert_within(picture, expected, apart, ridge=ridge)
    else:
        assert_close(picture, expected)
        limit = 1e-4
        error, flips = composited_alike(given, at, settings)
        assert error <= 1e-5
        assert flips <= 0.001 * at.width * at.height
    truth = gradients(given, at, "reference", settings, images)
    for name, gradient in truth.items():
        # Below 1e-6 there is nothing but rounding: these losses' gradients are about 1.
        if gradient is not None and np.linalg.norm(gradient) > 1e-6:
            assert relative(found[name], gradient) < limit, name


def _without(pull: np.ndarray | None, apart: np.ndarray) -> np.ndarray | None:
    """An image's gradient, zero at some pixels."""
    return (
        None
        if pull is None
        else np.where(apart.reshape(apart.shape + (1,) * (pull.ndim - 2)), 0, pull)
    )


def test_depth_gradients_at_faint_rims_are_bounded():
    """Expected depth is D / A with A = 1 - light left over: where A is 1/255, float32 knows it to 2e-5 only.

    One splat's depth does not depend on its alpha at all; what is left of two terms of 255 z that cancel is
    noise of 0.01 a pixel. Fits compare depth where half is covered, where this is 1e-7.
    """
    for given in (one(scale=0.02), one(scale=(0.3, 0.1, 0.05), quat=(0.7, -0.2, 0.5, 0.4))):
        found, truth = (gradients(given, view(), name) for name in ("numba", "reference"))
        for name, gradient in truth.items():
            if gradient is not None:
                assert relative(found[name], gradient) < 5e-4, name


@backends
@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("scale", [1e-12, 1e-4, 2e-2])
def test_sub_pixel_splats(backend, antialiased, scale):
    same_as_reference(one(scale=scale), view(), backend, Settings(antialiased=antialiased))


@backends
def test_antialiased_brightness_survives_half_the_resolution(backend):
    """The light of a splat near a pixel's size does not depend on how many pixels see it."""
    settings, full = Settings(antialiased=True), view(64, 64, focal=64.0)
    halved = View(np.diag([0.5, 0.5, 1.0]) @ full.K, full.world_to_camera, 32, 32)
    small = one(scale=1.3 * 2 / 64, opacity=0.95)
    light = [
        draw(small, at, backend, settings).alpha.astype(np.float64).sum() for at in (full, halved)
    ]
    assert light[0] == pytest.approx(4 * light[1], rel=0.02)


@backends
@pytest.mark.parametrize("depth", [-1.0, 0.0, 0.01 - 1e-4])
def test_behind_the_near_plane_nothing_is_drawn(backend, depth):
    behind = one(mean=(0.0, 0.0, depth), scale=0.005)
    assert draw(behind, view(), backend).alpha.max() == 0
    assert all(
        not gradient.any()
        for gradient in gradients(behind, view(), backend).values()
        if gradient is not None
    )


@backends
def test_just_beyond_the_near_plane(backend):
    same_as_reference(one(mean=(0.0, 0.0, 0.01 + 1e-4), scale=2e-4), view(), backend)


@backends
@pytest.mark.parametrize("beyond", [1.3, 3.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_splats_beyond_the_edge_of_the_image(backend, beyond, axis):
    mean = [0.1, -0.1, 2.0]
    mean[axis] = beyond * 2.0 * (24 / 50 if axis == 0 else 20 / 55)
    same_as_reference(
        one(mean=tuple(mean), scale=(0.5, 0.4, 0.3), quat=(0.9, 0.2, 0.3, 0.1)), view(), backend
    )


@backends
def test_crop_of_a_render_is_the_render_of_the_crop(backend):
    """For Gaussians within the margin of both images; farther out the Jacobian is held at different places."""
    given = splats(100, seed=3)
    small = dataclasses.replace(given, scales=np.minimum(given.scales, 0.02))
    x, y, width, height = 9, 6, 21, 19
    whole, shifted = view(), view().K.copy()
    shifted[:2, 2] -= x, y
    part = View(shifted, np.eye(4), width, height)
    cropped = draw(small, whole, backend).color[y : y + height, x : x + width]
    np.testing.assert_allclose(draw(small, part, backend).color, cropped, atol=2e-5)


@backends
@pytest.mark.parametrize(
    "scale", [(1.0, 1e-6, 1e-6), (0.0, 0.0, 0.0), (1e3, 1e3, 1e3), (0.0, 1.0, 0.1)]
)
@pytest.mark.parametrize("antialiased", [False, True])
def test_degenerate_covariance(backend, scale, antialiased):
    given = one(scale=scale, quat=(0.8, 0.1, -0.3, 0.5))
    same_as_reference(given, view(), backend, Settings(antialiased=antialiased))


@backends
@pytest.mark.parametrize("scale", [np.inf, 1e30, np.nan])
def test_infinite_scale_is_left_out_and_counted(backend, scale):
    picture = draw(one(scale=scale), view(), backend)
    assert picture.nonfinite == 1
    assert picture.alpha.max() == 0
    assert finite(gradients(one(scale=scale), view(), backend))


@backends
def test_needle_at_forty_five_degrees(backend):
    """Ten thousand pixels long, thinner than one: float32 conics lose it to cancellation."""
    turned = (np.cos(np.pi / 8), 0.0, 0.0, np.sin(np.pi / 8))
    focal = view().K[0, 0]
    K = np.array([[focal, 0, 20.0], [0, focal, 20.0], [0, 0, 1.0]])
    needle = one(scale=(1e4 * 2 / focal, 1e-6, 1e-6), quat=turned)
    same_as_reference(needle, View(K, np.eye(4), 48, 40), backend)


@backends
@pytest.mark.parametrize("count", [300, 1000])
@pytest.mark.parametrize("opacity", [0.005, 0.1, 0.6, 0.97])
def test_stacked_splats(backend, count, opacity):
    parts = [
        (
            (0.01 * np.sin(k), 0.0, 1 + 0.003 * k),
            0.15,
            opacity,
            PLAIN_QUAT,
            (0.5 + 0.4 * np.sin(k), 0.3, 0.6),
        )
        for k in range(count)
    ]
    same_as_reference(together_of(parts), view(24, 20, 25.0), backend)


@backends
def test_full_opacity_is_held_and_has_no_gradient_there(backend):
    at = view(9, 9, 20.0)
    centred = View(np.array([[20.0, 0, 4], [0, 20.0, 4], [0, 0, 1]]), np.eye(4), 9, 9)
    opaque = one(scale=30.0, opacity=1.0)  # alpha > 0.999 in every pixel
    picture = draw(opaque, centred, backend)
    np.testing.assert_allclose(picture.alpha, 0.999, atol=1e-6)
    same_as_reference(opaque, at, backend)
    assert np.abs(gradients(opaque, centred, backend)["opacities"]).max() == 0


def test_a_splat_that_is_quite_opaque_may_get_thinner():
    """Where its alpha is not held it has its gradient up to 1 itself; beyond, it is drawn as 1."""
    just, quite, more = (
        gradients(one(scale=0.3, opacity=opacity), view(9, 9, 20.0), "numba")["opacities"]
        for opacity in (0.999, 1.0, 1.001)
    )
    assert abs(quite[0]) > 1
    np.testing.assert_allclose(quite, just, rtol=1e-3)
    assert more[0] == 0


@backends
def test_two_splats_that_end_the_light_exactly(backend):
    """Light falls to 1e-4 to within rounding: either both are drawn or the first alone, forward as backward."""
    parts = [((0.0, 0.0, depth), 1e3, 0.99, PLAIN_QUAT, (0.5, 0.5, 0.5)) for depth in (2.0, 3.0)]
    picture = draw(together_of(parts), view(), backend)
    both, first = np.abs(picture.alpha - 0.9999) < 1e-5, np.abs(picture.alpha - 0.99) < 1e-4
    assert (both | first).all()
    assert finite(gradients(together_of(parts), view(), backend))


@backends
def test_alpha_at_the_floor(backend):
    floor = np.float32(1 / 255)
    K = np.array([[50.0, 0, 5], [0, 50, 5], [0, 0, 1]])
    at = View(K, np.eye(4), 11, 11)
    drawn = {}
    for ulps in (-1, 0, 1):
        opacity = np.nextafter(floor, np.float32(np.sign(ulps))) if ulps else floor
        drawn[ulps] = draw(one(opacity=float(opacity)), at, backend).alpha[5, 5]
        assert finite(gradients(one(opacity=float(opacity)), at, backend))
    assert drawn[-1] == 0
    assert drawn[1] > 0


@backends
def test_equal_depths_blend_in_the_order_given(backend):
    red, blue = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    parts = [((0.0, 0.0, 2.0), 0.2, 0.8, PLAIN_QUAT, color) for color in (red, blue)]
    middle = (19, 24)
    first = draw(together_of(parts), view(), backend).color[middle]
    second = draw(together_of(parts[::-1]), view(), backend).color[middle]
    assert first[0] > 0.7 > 0.2 > first[2]
    assert second[2] > 0.7 > 0.2 > second[0]


@backends
@pytest.mark.parametrize("factor", [0.0, 1e6, 1e-6, -1.0])
def test_quaternions_of_any_length(backend, factor):
    quat = tuple(factor * q for q in (0.7, -0.2, 0.5, 0.4))
    given = one(scale=(0.3, 0.1, 0.05), quat=quat)
    same_as_reference(given, view(), backend)
    slope = gradients(given, view(), backend)["quats"]
    reach = max(np.abs(slope).max() * np.abs(given.quats).max(), 1e-9)
    assert abs((slope * given.quats).sum()) < 1e-5 * reach


@backends
@pytest.mark.parametrize("name", ["means", "opacities", "sh", "quats", "scales", "features"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_one_bad_splat_changes_nothing_else(backend, name, value):
    given, at = splats(60, features=2), view()
    array = getattr(given, name).copy()
    array[17].flat[-1] = value if array.ndim > 1 else 0
    if array.ndim == 1:
        array[17] = value
    bad = dataclasses.replace(given, **{name: array})
    without = dataclasses.replace(
        given, **{n: np.delete(a, 17, 0) for n, a in vars(given).items() if a is not None}
    )
    found, expected = draw(bad, at, backend), draw(without, at, backend)
    np.testing.assert_array_equal(found.color, expected.color)
    np.testing.assert_array_equal(found.features, expected.features)
    assert (found.nonfinite, expected.nonfinite) == (1, 0)
    slopes, truth = gradients(bad, at, backend), gradients(without, at, backend)
    for key, slope in slopes.items():
        if slope is not None:
            assert not slope[17].any(), key
            others = np.delete(slope, 17, 0)
            if backend == "gsplat":  # it sums by atomics, in any order
                assert relative(others, truth[key]) < 1e-5, key
            else:
                np.testing.assert_array_equal(others, truth[key])


def none_at_all() -> Splats:
    given = splats(1)
    return dataclasses.replace(given, **{n: a[:0] for n, a in vars(given).items() if a is not None})


@backends
@pytest.mark.parametrize(
    "given", [none_at_all(), one(mean=(0.0, 0.0, -3.0)), one(mean=(500.0, 0.0, 2.0))]
)
def test_nothing_to_draw(backend, given):
    picture = draw(given, view(), backend, background=(0.1, 0.2, 0.3))
    np.testing.assert_allclose(
        picture.color, np.broadcast_to(np.float32([0.1, 0.2, 0.3]), (40, 48, 3))
    )
    assert not picture.alpha.any()
    assert not picture.depth_expected.any()
    assert not picture.depth_surface.any()
    assert (picture.surface_index == -1).all()
    assert all(not g.any() for g in gradients(given, view(), backend).values() if g is not None)


@backends
@pytest.mark.parametrize("size", [(1, 1), (3, 5), (33, 31), (65, 2), (47, 34)])
def test_odd_sizes(backend, size):
    same_as_reference(splats(80, seed=5), view(*size), backend)


@backends
def test_far_away_origin(backend):
    """The scene and its camera moved by ten kilometres look the same: means come in float64."""
    given, at = splats(80, seed=2), view()
    far = np.array([1e4, -1e4, 1e4])
    pose = np.eye(4)
    pose[:3, 3] = -far
    moved = dataclasses.replace(given, means=given.means.astype(np.float64) + far)
    there = View(at.K, pose, at.width, at.height)
    here = draw(given, at, backend)
    np.testing.assert_allclose(draw(moved, there, backend).color, here.color, atol=1e-5)
    found, truth = gradients(moved, there, backend), gradients(given, at, backend)
    assert relative(found["means"], truth["means"]) < (1e-3 if backend == "gsplat" else 1e-5)
