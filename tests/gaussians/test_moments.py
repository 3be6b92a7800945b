"""Residuals of single times: they follow the Gaussians they belong to, and a fit puts them where they help."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from boxes import BLOCK, World
from clouds import some

from rpaug.core import geometry
from rpaug.core.types import FrameResidual, Gaussians, Scene
from rpaug.gaussians import frame_residuals, gaussian_view, gaussians, store
from rpaug.gaussians.descent import settings_for
from rpaug.gaussians.fit import fitted
from rpaug.gaussians.fit_residuals import fit_frame_residuals
from rpaug.gaussians.frame_residuals import PARTS
from rpaug.gaussians.gaussians import Placement
from rpaug.render.splat import Splats


def a_set(count: int = 12, seed: int = 0) -> Gaussians:
    """Gaussians with moments at times 2 and 7."""
    rng = np.random.default_rng(seed)

    def moment(rows: list[int]) -> FrameResidual:
        shapes = ((3,), (4,), (3,), (), (1, 3))
        arrays = (rng.normal(0, 0.1, (len(rows), *s)).astype(np.float16) for s in shapes)
        return FrameResidual(np.array(rows, np.int32), *arrays)

    return replace(some(count), frame_residuals={2: moment([1, 4, 5]), 7: moment([0, 5])})


def assert_alike(one: Gaussians, other: Gaussians) -> None:
    for name in PARTS:
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=4e-3, atol=2e-3)


def test_only_the_rows_of_a_time_differ_at_it() -> None:
    usual = a_set()
    then = frame_residuals.at(usual, 2)
    for name in PARTS:
        differs = (getattr(then, name) != getattr(usual, name)).reshape(len(usual), -1).any(1)
        assert set(np.flatnonzero(differs)) <= {1, 4, 5}
    assert (then.means != usual.means).any()
    assert len(frame_residuals.at(usual, 3).frame_residuals) == 0
    np.testing.assert_array_equal(frame_residuals.at(usual, 3).means, usual.means)


def test_a_difference_is_what_leads_there() -> None:
    usual = a_set()
    rows = np.array([0, 3, 8])
    there = gaussians.chosen(replace(some(12), frame_residuals={}), [9, 10, 11])
    there = replace(there, opacities=np.clip(there.opacities, 0.01, 0.99))
    with_it = replace(usual, frame_residuals={5: frame_residuals.difference(usual, there, rows)})
    assert_alike(gaussians.chosen(frame_residuals.at(with_it, 5), rows), there)


def test_moments_follow_chosen_joined_and_moved_gaussians() -> None:
    usual = a_set()
    keep = np.array([5, 4, 0])
    assert_alike(
        frame_residuals.at(gaussians.chosen(usual, keep), 2),
        gaussians.chosen(frame_residuals.at(usual, 2), keep),
    )
    two = gaussians.joined([usual, a_set(6, seed=1)])
    assert_alike(
        gaussians.chosen(frame_residuals.at(two, 7), slice(0, 12)), frame_residuals.at(usual, 7)
    )
    assert_alike(
        gaussians.chosen(frame_residuals.at(two, 7), slice(12, 18)),
        frame_residuals.at(a_set(6, 1), 7),
    )
    motion = geometry.rigid(np.array([0.4, -0.9, 0.2]), np.array([1.0, 2, 3]))
    assert_alike(
        frame_residuals.at(gaussians.moved(usual, motion), 2),
        gaussians.moved(frame_residuals.at(usual, 2), motion),
    )
    with pytest.raises(ValueError, match="only once"):
        gaussians.chosen(usual, [1, 1])


def test_a_store_keeps_them(tmp_path: Path, placed: tuple[World, Scene]) -> None:
    kept = replace(placed[1], gaussians=a_set())
    store.save(tmp_path, "abc", kept, settings={}, report={})
    found = store.load(tmp_path, "abc")
    assert found is not None
    assert list(found.gaussians.frame_residuals) == [2, 7]
    for t, moment in a_set().frame_residuals.items():
        for name in ("rows", *PARTS):
            np.testing.assert_array_equal(
                getattr(found.gaussians.frame_residuals[t], name), getattr(moment, name)
            )


def test_taking_back_undoes_placing(placed: tuple[World, Scene]) -> None:
    _, scene = placed
    own = Splats.of(replace(some(8), ids=np.full(8, BLOCK, np.int32)))
    light = np.array([1, 0.2, -0.1, 0.1, 0, 0.05, 0, 0, 0.03])
    there = Placement.of(np.full(8, BLOCK, np.int32), scene.bodies, light)
    back = there.take_back(there.place(own, 14), 14)
    for name in PARTS:
        np.testing.assert_allclose(getattr(back, name), getattr(own, name), atol=1e-5)


@pytest.fixture(scope="module")
def faithful(placed: tuple[World, Scene]) -> tuple[Scene, Scene]:
    """A scene fitted by a few steps, and the same with moments."""
    settings = replace(settings_for("heldout", steps=60), train_frames=6, threads=1)
    usual, _ = fitted(placed[1], settings=settings, seed=1)
    assert usual.gaussians is not None
    found = fit_frame_residuals(usual, [3, 14], steps=8, depth_weight=3.0, threads=2)
    return usual, replace(usual, gaussians=replace(usual.gaussians, frame_residuals=found))


def test_fitted_moments_show_their_times_better_and_leave_others_alone(
    faithful: tuple[Scene, Scene],
) -> None:
    def error(scene: Scene, t: int) -> float:
        rgb, _, _ = gaussian_view.render_view(scene, "left", t)
        recorded = scene.episode.views["left"].rgb(t)
        return float(((rgb.astype(float) - recorded) ** 2).mean())

    usual, better = faithful
    assert error(better, 14) < 0.7 * error(usual, 14)
    assert error(better, 15) == error(usual, 15)
    assert better.gaussians is not None
    moved = np.unique(better.gaussians.ids[better.gaussians.frame_residuals[14].rows])
    still = {h for b in usual.bodies if (b.to_world == np.eye(4)).all() for h in b.instance_ids}
    assert not still & set(moved.tolist())


def test_moments_do_not_depend_on_threads(faithful: tuple[Scene, Scene]) -> None:
    usual, _ = faithful
    one, two = (
        fit_frame_residuals(usual, [3, 14], steps=2, depth_weight=3.0, threads=n)[14]
        for n in (1, 2)
    )
    np.testing.assert_array_equal(one.means, two.means)


def test_a_fidelity_fit_stops_at_its_target(placed: tuple[World, Scene]) -> None:
    def report(target: float) -> tuple[int, float]:
        settings = settings_for("fidelity", target=target, steps=40)
        settings = replace(settings, train_frames=4, checked_frames=2, moment_steps=4)
        _, found = fitted(placed[1], settings=settings)
        return found.moments, found.fixed_db

    moments_easy, easy = report(20.0)
    moments_hard, hard = report(easy + 0.5)
    assert moments_easy == 0
    assert moments_hard == placed[1].episode.length
    assert hard > easy
