"""Lamps are taken only where known surfaces cast the shadows that are seen; their fit on the twin is in
`test_intrinsic`."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import TABLE, scene, seen_by

from rpaug.assets import library
from rpaug.core.types import Body, Rig, Scene
from rpaug.scene.lighting import albedo, intrinsic, rig, shading
from rpaug.scene.recorded import lit

LENGTH = 12
T = 7


@pytest.fixture
def wandering() -> Scene:
    """A band of shadow wanders over the table that nothing in the scene casts."""

    def paint(name, t, rgb, depth, ids):  # type: ignore[no-untyped-def]
        width = ids.shape[1] // LENGTH
        light = np.ones(ids.shape)
        light[:, t * width : (t + 1) * width] = 0.8
        stripes = np.where(np.arange(ids.shape[0])[:, None] // 3 % 2, 0.5, 0.9)
        gray = (200 * stripes * light).round()[..., None].repeat(3, 2)
        return np.where((ids == TABLE)[..., None], gray, rgb).astype(np.uint8), depth, ids

    return seen_by(scene({"front": (1.6, 0.3, 1.0)}, length=LENGTH), paint)


def test_lamps_whose_shadows_are_not_those_seen_are_refused(wandering: Scene) -> None:
    assert rig.find(wandering) is None
    assert intrinsic.unshadowed(wandering) is wandering.episode
    told = intrinsic.share(wandering, "front", T)
    before = lit.share(wandering.episode, "front", wandering.moving, T)
    assert told is not None
    assert before is not None
    assert told.min() < 0.85
    assert told.tobytes() == before.tobytes()


def test_how_bright_a_surface_is_is_a_guess_where_lamps_are_refused(wandering: Scene) -> None:
    assert rig.unexplained(wandering)
    (guessed,) = shading.describe(wandering, [TABLE])["surfaces"]
    (known,) = shading.describe(wandering, [TABLE], (0.5, 0.5, 0.5))["surfaces"]
    assert guessed["in_shadow"]
    assert "in_shadow" not in known
    assert [count for count, _ in albedo.guessed([guessed]).values()] == [0, 1]
    assert not rig.unexplained(scene({"front": (1.6, 0.3, 1.0)}, length=LENGTH))


def test_real_recordings_without_cast_shadows_are_known_to_have_none(real: Scene) -> None:
    """RLBench renders none: what is put in casts none either."""
    assert rig.nothing_casts(real)
    assert rig.find(real) is None


def test_nothing_casts_where_things_move_and_no_shadow_goes_along(wandering: Scene) -> None:
    assert not rig.nothing_casts(wandering)  # a band of shadow goes along
    lit_alike = scene({"front": (1.6, 0.3, 1.0)}, length=LENGTH)
    assert lit_alike.moving
    assert rig.nothing_casts(lit_alike)
    resting = replace(
        lit_alike,
        roles={**lit_alike.roles},
        bodies=tuple(replace(one, motion="static") for one in lit_alike.bodies),
    )
    assert not resting.moving
    assert not rig.nothing_casts(resting)  # nothing would show that there are any


def test_what_edits_put_in_is_no_part_of_the_recording(wandering: Scene) -> None:
    """Else lamps and highlights would be sought anew for each copy with a distractor."""
    recorded, pose = rig.recorded(wandering), np.tile(np.eye(4), (LENGTH, 1, 1))
    cup = Body(frozenset([99]), pose, "static", mesh=library.mesh("mug_blue"))
    added = rig.recorded(replace(wandering, bodies=(*wandering.bodies, cup)))
    assert added.bodies == recorded.bodies == wandering.bodies


def test_no_lamp_is_without_strength(wandering: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """Were they not refused, the invented lamps would be few: the last refinement leaves one of them dark."""
    monkeypatch.setattr(rig, "EXPLAINED", 0.0)
    found = rig.find(wandering)
    assert found is not None
    assert min(found.strengths) >= rig.WEAK * (found.ambient + sum(found.strengths))


def test_a_real_recording_without_cast_shadows_is_left_alone(real: Scene) -> None:
    assert rig.find(real) is None
    assert intrinsic.unshadowed(real) is real.episode
    for name in real.episode.views:
        told, before = (
            intrinsic.share(real, name, 0),
            lit.share(real.episode, name, real.moving, 0),
        )
        assert (told is None) == (before is None)
        if told is not None and before is not None:
            assert told.tobytes() == before.tobytes()


LAMPS = Rig(0.4, ((0.6, 0.0, 0.8), (0.0, -0.8, 0.6)), (0.45, 0.4))
UP = np.array([[0, 0, 1]], np.float32)


def test_lamps_turn_together_and_stay_above_the_horizon() -> None:
    turned = np.array(rig.turned(LAMPS, np.pi / 2, 1.0).directions)
    np.testing.assert_allclose(turned, [[0, 0.6, 0.8], [0.8, 0, 0.6]], atol=1e-12)
    low = np.array(rig.turned(LAMPS, 0.0, 0.01).directions)
    np.testing.assert_allclose(low[:, 2], rig.LOWEST)
    high = np.array(rig.turned(LAMPS, 0.0, 5.0).directions)
    np.testing.assert_allclose(high[:, 2], 1)


def test_lamps_that_are_given_light_level_ground_by_one() -> None:
    given = rig.with_ambient(rig.nearest_at(LAMPS, np.array([0.0, -0.6, 0.8])), 0.2)
    assert given.directions == (LAMPS.directions[0], (0.0, -0.6, 0.8))
    assert given.light(UP, [1.0, 1.0]) == pytest.approx(1, abs=1e-4)
    assert given.ambient / (given.ambient + sum(given.strengths)) == pytest.approx(0.2, abs=1e-4)


def test_shadows_are_looked_for_before_anything_is_tracked(wandering: Scene) -> None:
    assert rig.shadows_wander(wandering.episode)
    still = scene({"front": (1.6, 0.3, 1.0)}, length=LENGTH).episode
    assert not rig.shadows_wander(still)
