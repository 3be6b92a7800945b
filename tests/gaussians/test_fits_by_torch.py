"""Fits on torch's engine come as far as those on the CPU kernels: static, per frame, in space and time, refined."""

from dataclasses import replace
from pathlib import Path

import pytest
import waves
from analytic import EYES, LENGTH, scene, tracked
from gsplat_kernels import EMULATED, ON_GPU, running

import rpaug
from rpaug.compose import joint
from rpaug.core import registry
from rpaug.core.types import Scene
from rpaug.gaussians import fit4, store
from rpaug.gaussians.descent import FitSettings, on, settings_for
from rpaug.gaussians.fit import fitted
from rpaug.gaussians.stops import Stop
from rpaug.scene.build import build

backends = pytest.mark.parametrize("backend", [EMULATED, ON_GPU])
NEAR = 0.3  # dB
SETTINGS = replace(settings_for(steps=6), train_frames=4, checked_frames=1, threads=2)


@pytest.fixture(scope="module")
def recorded() -> Scene:
    return tracked(
        scene({"front": EYES["front"], "wrist": EYES["wrist"]}, length=LENGTH, moving="wrist")
    )


@backends
def test_a_fit_shows_as_much(recorded: Scene, backend: str) -> None:
    expected = fitted(recorded, settings=SETTINGS)[1]
    with running(backend) as name:
        found = fitted(recorded, settings=replace(SETTINGS, backend=name))[1]
    assert (found.device, expected.device) == ("cuda", "cpu")
    assert found.train_db == pytest.approx(expected.train_db, abs=NEAR)
    assert found.held_out_db == pytest.approx(expected.held_out_db, abs=NEAR)
    assert found.gaussians == expected.gaussians


@backends
def test_residuals_of_frames_show_as_much(recorded: Scene, backend: str) -> None:
    """`fidelity` checks by the engine too, and goes on frame by frame."""
    rule = Stop(kind="fidelity", target=60, every=5)
    settings = replace(SETTINGS, steps=6, stop=rule, moment_passes=1, moment_steps=2)
    expected = fitted(recorded, settings=settings)[1]
    with running(backend) as name:
        found = fitted(recorded, settings=replace(settings, backend=name))[1]
    assert found.moments == expected.moments > 0
    assert found.train_db == pytest.approx(expected.train_db, abs=NEAR)


@backends
def test_what_bends_is_shown_as_well(backend: str) -> None:
    quick = fit4.FourSettings(
        rounds=1, train_frames=3, checked_frames=2, densify_rounds=(), least_pixels=20
    )
    expected = fit4.fitted(waves.scene(), settings=quick)[1]
    with running(backend) as name:
        found = fit4.fitted(waves.scene(), settings=replace(quick, backend=name))[1]
    assert found.db[waves.SHEET] == pytest.approx(expected.db[waves.SHEET], abs=NEAR)


@backends
def test_the_joint_fine_tune_gains_as_much(backend: str) -> None:
    folder = Path(rpaug.__file__).parent / "sample"
    adapter = registry.adapter_for(folder)
    plain = build(adapter.read(folder, adapter.episodes(folder)[0]), with_bodies=True)
    given = fitted(plain, settings=replace(settings_for(steps=4), checked_frames=1), seed=0)[0]
    painted = replace(given, appearance=(Darker(given.roles["manipulated"]),))
    short = joint.RefineSettings(steps=3, times=2, held=1)
    expected = joint.refined(painted, short)[1]
    with running(backend) as name:
        found = joint.refined(painted, replace(short, backend=name))[1]
    assert found["gaussians"] == expected["gaussians"] > 0
    assert found["after_db"] == pytest.approx(expected["after_db"], abs=NEAR)


class Darker:
    """Half of every color, on some handles."""

    def __init__(self, instance_ids: frozenset[int]) -> None:
        self.instance_ids = instance_ids

    def __call__(self, color, surface):
        return 0.5 * color


def test_a_store_keeps_both_devices_fits_apart_and_no_count_of_threads(recorded: Scene) -> None:
    usual = FitSettings()
    keys = {store.key(recorded, one, 0) for one in (usual, replace(usual, threads=16))}
    keys.add(store.key(recorded, replace(usual, backend="numba"), 0))
    assert len(keys) == 1
    assert store.key(recorded, on(usual, "cuda"), 0) not in keys
    assert on(usual, "cpu") is usual
