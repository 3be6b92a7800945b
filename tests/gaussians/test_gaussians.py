"""Lifting, placing and rendering Gaussians, against exact boxes."""

from dataclasses import replace

import boxes
import numpy as np
import pytest
from boxes import BLOCK, World
from hypothesis import given
from hypothesis import strategies as st

from rpaug.core import geometry
from rpaug.core.errors import TargetError, Unsupported
from rpaug.core.types import Scene, Surface
from rpaug.gaussians import gaussian_view, gaussians
from rpaug.gaussians.fit import Begun, FitSettings, fit, psnr, ssim
from rpaug.gaussians.gaussians import LiftedImage, Placement
from rpaug.gaussians.seeds import seeds
from rpaug.render.splat import Gradients, Splats

angle = st.floats(-3.1, 3.1)


@given(st.tuples(angle, angle, angle))
def test_quaternions_turn_as_their_matrices_do(turn: tuple[float, float, float]) -> None:
    matrix = geometry.rotation(np.array(turn))
    w, x, y, z = gaussians.quaternions(matrix[None])[0]
    back = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    np.testing.assert_allclose(back, matrix, atol=1e-9)


@given(st.tuples(angle, angle, angle), st.tuples(angle, angle, angle))
def test_turning_is_the_product_of_rotations(
    a: tuple[float, float, float], b: tuple[float, float, float]
) -> None:
    first, second = geometry.rotation(np.array(a)), geometry.rotation(np.array(b))
    one, two = gaussians.quaternions(np.stack([first, second]))
    product = gaussians.quaternions((second @ first)[None])[0]
    turned = gaussians.turned(two, one[None])[0]
    np.testing.assert_allclose(min(turned @ product, -turned @ product), -1, atol=1e-9)


def plate(world: World) -> LiftedImage:
    camera = world.episode().views["left"].camera
    depth, ids, rgb = world.cast(camera, 0)
    return LiftedImage(rgb, depth, ids, camera.K, camera.cam_to_world[0], ids > 0)


def test_lifted_gaussians_lie_flat_on_their_surfaces() -> None:
    picture = plate(boxes.still(1))
    made = gaussians.lifted(picture)
    table = made.ids == boxes.TABLE
    on_top = np.abs(made.means[table, 2]) < 1e-4
    assert on_top.mean() > 0.9
    shortest = gaussian_view._axes(made.quats[table][on_top], made.scales[table][on_top].argmin(-1))
    # Exact but for pixels at the table's own edges, whose only neighbours lie on its side.
    assert np.median(np.abs(shortest[:, 2])) > 1 - 1e-5
    np.testing.assert_allclose(
        0.5 + gaussians.SH0 * made.sh[:, 0], picture.rgb[picture.use] / 255, atol=1e-6
    )


def test_placing_and_pulling_back_are_adjoint() -> None:
    """For loss = <g, place(x)> the gradient by x is pull_back(g): checked by finite differences."""
    rng = np.random.default_rng(5)
    world = boxes.pick_and_place()
    track = np.stack([world.pose(BLOCK, t) for t in range(20)])
    track = track @ geometry.rigid(np.array([0.3, -0.8, 0.5]), np.array([0.1, 0.2, 0.3]))
    placement = Placement((np.array([1, 3]),), (track,), (gaussians.quaternions(track[:, :3, :3]),))
    means, quats = rng.normal(size=(5, 3)), rng.normal(size=(5, 4))
    flat = np.ones((5, 3), np.float32)
    g_means, g_quats = rng.normal(size=(5, 3)), rng.normal(size=(5, 4))

    def loss(m: np.ndarray, q: np.ndarray) -> float:
        placed = placement.place(Splats(m, flat[:, 0], flat[:, None], q, flat), 12)
        return float((placed.means * g_means).sum() + (placed.quats * g_quats).sum())

    own = Splats(means, flat[:, 0], flat[:, None], quats, flat)
    by_placed = Gradients(
        g_means.copy(),
        flat[:, 0],
        flat[:, None].copy(),
        g_quats.copy(),
        flat,
        None,
        None,
        flat[:, 0],
    )
    pulled, _ = placement.pull_back(by_placed, own, placement.place(own, 12), 12)
    for array, gradient in ((means, pulled.means), (quats, pulled.quats)):
        for row, column in ((1, 0), (3, 2), (4, 1)):
            nudged = [means.copy(), quats.copy()]
            nudged[0 if array is means else 1][row, column] += 1e-6
            slope = (loss(*nudged) - loss(means, quats)) / 1e-6
            assert slope == pytest.approx(gradient[row, column], abs=1e-5)


@pytest.fixture(scope="module")
def fitted(placed: tuple[World, Scene]) -> tuple[World, Scene, float]:
    world, scene = placed
    found, report = fit(scene, settings=FitSettings(steps=120, train_frames=12, threads=1), seed=1)
    return world, replace(scene, gaussians=found), report.train_db


def test_a_fit_shows_the_recorded_views(fitted: tuple[World, Scene, float]) -> None:
    """The flat init alone gives about 22 dB; a short fit 40 on average."""
    world, scene, train_db = fitted
    assert train_db > 33
    for t in (0, 14, len(world.gripper) - 1):
        rgb, depth, ids = gaussian_view.render_view(scene, "left", t)
        view = scene.episode.views["left"]
        assert view.depth is not None
        assert view.ids is not None
        assert psnr(rgb, view.rgb(t)) > 24
        assert (ids != view.ids(t)).mean() < 0.06  # pixels on outlines
        # A third of a pixel's footprint: what the centre of a flat Gaussian may move unnoticed.
        assert np.median(np.abs(depth - view.depth(t))) < 0.008


def test_depth_and_handle_are_those_of_one_surface(fitted: tuple[World, Scene, float]) -> None:
    """Every depth lies on a recorded surface of the same handle, up to a footprint; none lies between two."""
    world, scene, _ = fitted
    _, depth, ids = gaussian_view.render_view(scene, "right", 14)
    assert ((depth > 0) == (ids > 0)).all()
    camera = scene.cameras["right"]
    points = geometry.world_points(depth, camera, 14)
    block = geometry.transform(geometry.inverse(world.pose(BLOCK, 14)), points[ids == BLOCK])
    assert (np.abs(block).max(-1) < 0.035 + 0.02).mean() > 0.95


def test_the_same_seed_gives_the_same_gaussians(placed: tuple[World, Scene]) -> None:
    settings = FitSettings(steps=6, train_frames=4, checked_frames=1)
    one, _ = fit(placed[1], settings=replace(settings, threads=1), seed=3)
    two, _ = fit(placed[1], settings=replace(settings, threads=2), seed=3)
    other, _ = fit(placed[1], settings=settings, seed=4)
    np.testing.assert_array_equal(one.means, two.means)
    np.testing.assert_array_equal(one.sh, two.sh)
    assert not np.array_equal(one.means, other.means)


def test_seeds_cover_every_handle(placed: tuple[World, Scene]) -> None:
    world, scene = placed
    begun = seeds(scene)
    assert set(begun.ids.tolist()) == set(world.boxes)
    block = begun.means[begun.ids == BLOCK] - [0.1, -0.12, 0.035]  # its own frame: where it began
    assert np.abs(block).max() < 0.035 + 0.005


def test_appearance_edits_reach_their_handles_only(fitted: tuple[World, Scene, float]) -> None:
    class Red:
        instance_ids = frozenset({BLOCK})

        def __call__(self, color: np.ndarray, surface: Surface) -> np.ndarray:
            return np.tile(np.array([1, 0, 0], np.float32), (len(color), 1))

    _, scene, _ = fitted
    before = gaussian_view.render_view(scene, "left", 3)
    after = gaussian_view.render_view(replace(scene, appearance=(Red(),)), "left", 3)
    np.testing.assert_array_equal(before[1], after[1])
    np.testing.assert_array_equal(before[2], after[2])
    inside = before[2] == BLOCK
    assert after[0][inside].mean(0) @ [1, -1, -1] > 80
    far = np.ones_like(inside)
    rows, columns = np.nonzero(inside)
    far[rows.min() - 4 : rows.max() + 5, columns.min() - 4 : columns.max() + 5] = False
    np.testing.assert_array_equal(before[0][far], after[0][far])


def test_what_is_missing_is_said(
    placed: tuple[World, Scene], fitted: tuple[World, Scene, float]
) -> None:
    with pytest.raises(Unsupported, match="no Gaussians"):
        gaussian_view.render_view(placed[1], "left", 0)
    with pytest.raises(TargetError, match="there are: front, left, right"):
        gaussian_view.render_view(fitted[1], "top", 0)
    with pytest.raises(Unsupported, match="depth and instance masks"):
        fit(replace(placed[1], bodies=()))


def test_psnr_and_ssim_of_known_pairs() -> None:
    image = np.random.default_rng(0).integers(0, 256, (32, 32, 3)).astype(np.uint8)
    assert psnr(image, image) == 100
    assert ssim(image, image) == pytest.approx(1)
    assert psnr(np.zeros_like(image), np.full_like(image, 255)) == 0
    assert ssim(image, 255 - image) < 0


def test_what_was_fitted_and_what_was_held_out_are_told_apart(
    placed: tuple[World, Scene], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, scene = placed
    fitted = {0, scene.episode.length - 1}

    def judged(shown: Scene, times: list[int], threads: int) -> np.ndarray:
        db = [30.0 if t in fitted else 20.0 for t in times]
        return np.tile(np.array(db)[:, None, None], (1, len(shown.episode.views), 3))

    monkeypatch.setattr("rpaug.gaussians.fit.judged", judged)
    monkeypatch.setattr(
        "rpaug.gaussians.fit._descended",
        lambda shown, begun, *_: (replace(shown, gaussians=begun.gaussians), 0),
    )
    _, report = fit(scene, settings=FitSettings(train_frames=2), begun=Begun(seeds(scene)))
    assert (report.train_db, report.held_out_db) == (30.0, 20.0)
    assert 20 < report.fixed_db < 30
