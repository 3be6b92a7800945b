"""Cast shadows are told from what surfaces are: lamps, the share of light, and the episode without shadows."""

import numpy as np
import pytest

from rpaug import twin
from rpaug.scene.build import build
from rpaug.scene.lighting import intrinsic, rig
from rpaug.scene.recorded import lit
from rpaug.twin.look import RIG

pytestmark = pytest.mark.gl


def recorded(**look):
    take = twin.perform("push_button", 2, frames=11, look=twin.Look(**look))
    return take, build(take.episode, with_bodies=True)


@pytest.fixture(scope="module")
def shaded():
    return recorded(shadows=True)


@pytest.fixture(scope="module")
def bare():
    return recorded()


def true_directions():
    along = np.cos([lamp.height for lamp in RIG])
    heading = np.array([lamp.heading for lamp in RIG])
    up = np.sin([lamp.height for lamp in RIG])
    return np.stack([along * np.cos(heading), along * np.sin(heading), up], -1)


def test_the_lamps_are_found_by_their_shadows(shaded):
    found = rig.find(shaded[1])
    assert found is not None
    nearest = (np.array(found.directions) @ true_directions().T).max(1)
    assert len(found.directions) == len(RIG)
    assert (
        nearest > np.cos(np.deg2rad(4.0))
    ).all()  # a pixel is about 1 degree wide in the shadows' reach
    assert abs(found.ambient - 0.3) < 0.05
    assert (np.abs(np.array(found.strengths) - 0.5) < 0.08).all()


def test_places_that_grow_darker_tell_lamps_that_patterns_hide():
    """Here a lamp overhead fits the patterns of what rests better than those that cast the shadows."""
    take = twin.perform("push_button", 10, frames=17, look=twin.Look(shadows=True))
    found = rig.find(build(take.episode, with_bodies=True))
    assert found is not None
    nearest = np.sort((np.array(found.directions) @ true_directions().T).max(0))
    assert (nearest[1:] > np.cos(np.deg2rad(2.0))).all()


def test_level_ground_that_all_lamps_reach_has_light_one(shaded):
    found = rig.find(shaded[1])
    up = np.array([[0, 0, 1]], np.float32)
    assert found.light(up, [1.0] * len(found.directions)) == pytest.approx(1, abs=1e-3)
    assert found.light(up, [0.0] * len(found.directions)) == pytest.approx(found.ambient)


def test_a_dark_pattern_is_no_shadow_where_nothing_casts_one(shaded, bare):
    """Tiles that vary by a tenth and more lay in shadow before, since nothing spoke against it."""
    take, scene = shaded
    for name in ("overhead", "left_shoulder", "right_shoulder"):
        view, plain = take.episode.views[name], bare[0].episode.views[name]
        floor = view.ids(0) == take.truth.handles["floor"]
        true = view.rgb(0)[floor].mean(-1) / plain.rgb(0)[floor].mean(-1)
        assert floor.sum() > 500
        assert (intrinsic.share(scene, name, 0)[floor] < 0.85 * true).mean() < 0.02


def test_surfaces_are_trusted_less_where_a_shadow_ends():
    reached = np.ones((9, 20), np.float32)
    reached[:, 10:] = 0
    sure = intrinsic._sure(reached.reshape(-1), reached.shape).reshape(reached.shape)
    assert (sure[:, 7:13] == 1).all()
    assert (sure[:, [0, 6, 13, 19]] == intrinsic.AWAY).all()


def test_a_pixel_at_the_edge_of_a_shadow_has_part_of_a_lamp():
    ids = np.ones((20, 30), np.int32)
    true = np.zeros(ids.shape, np.float32)
    true[:, 15:] = -0.8
    level = true - 0.5
    level[:, 14] = -0.9  # half in shadow
    found = intrinsic._at_edges(true, level, ids)
    np.testing.assert_allclose(found[2:-2, 14], -0.4, atol=1e-5)
    np.testing.assert_allclose(np.delete(found, 14, 1), np.delete(true, 14, 1), atol=1e-5)
    level[:, 14] = -2.0  # darker than either side
    assert intrinsic._at_edges(true, level, ids)[2:-2, 14] == pytest.approx(-0.8)


def test_without_moving_shadows_nothing_changes(bare):
    take, scene = bare
    assert rig.find(scene) is None
    assert intrinsic.unshadowed(scene) is take.episode
    assert intrinsic.best_light(scene, take.truth.handles["table"]) == 1.0
    for name in take.episode.views:
        told, before = (
            intrinsic.share(scene, name, 5),
            lit.share(take.episode, name, scene.moving, 5),
        )
        assert (told is None) == (before is None)
        if told is not None and before is not None:
            assert told.tobytes() == before.tobytes()


def test_the_share_of_light_is_what_the_shadows_took(shaded, bare):
    """Against the same motion recorded without shadows, on the table."""
    take, scene = shaded
    errors, ignored = [], []
    for name, view in bare[0].episode.views.items():
        plain, dark = (one.rgb(5).max(-1).astype(float) for one in (view, take.episode.views[name]))
        table = (view.ids(5) == bare[0].truth.handles["table"]) & (plain > 30)
        true = (dark / np.maximum(plain, 1))[table]
        errors.append(np.abs(intrinsic.share(scene, name, 5)[table] - true))
        ignored.append(np.abs(1 - true))
    assert np.concatenate(errors).mean() < 0.25 * np.concatenate(ignored).mean()


def test_without_its_shadows_an_episode_looks_as_if_none_had_fallen(shaded, bare):
    take, scene = shaded
    lifted = intrinsic.unshadowed(scene)
    before = after = 0.0
    for name in ("left_shoulder", "right_shoulder", "overhead"):
        goal = bare[0].episode.views[name].rgb(5).astype(float)
        before += ((take.episode.views[name].rgb(5) - goal) ** 2).mean()
        after += ((lifted.views[name].rgb(5) - goal) ** 2).mean()
    assert after < before / 4
