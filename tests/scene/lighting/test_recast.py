"""Shadows are cast anew where something moved, and nothing else changes."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rpaug import twin
from rpaug.core.types import Body, Mesh, Relit
from rpaug.pipeline.contracts import shown
from rpaug.scene.build import build
from rpaug.scene.lighting import casting, intrinsic, recast, rig
from rpaug.scene.placement.untouched import without

pytestmark = pytest.mark.gl
T = 5


def recorded(**look):
    take = twin.perform("push_button", 2, frames=11, look=twin.Look(**look))
    return take, build(take.episode, with_bodies=True)


@pytest.fixture(scope="module")
def shaded():
    take, scene = recorded(shadows=True)
    known = rig.find(scene)
    return take, replace(scene, relit=Relit(known, known))


def lid(scene, side, height):
    """A grey square above the middle of the table."""
    corners = side / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    points = np.column_stack([corners[:, 0] + 0.25, corners[:, 1], np.full(4, height)])
    up = np.tile([0.0, 0.0, 1.0], (4, 1))
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    mesh = Mesh(points, up, np.zeros((4, 2)), faces, np.full((1, 1, 3), 128, np.uint8))
    still = np.tile(np.eye(4), (scene.episode.length, 1, 1))
    return Body(frozenset({99}), still, "static", mesh=mesh)


def test_what_nobody_moved_keeps_its_bits(shaded):
    take, scene = shaded
    after = shown(scene)
    for name, view in take.episode.views.items():
        assert np.array_equal(after.views[name].rgb(T), view.rgb(T))


def test_without_lamps_there_is_nothing_to_cast(shaded):
    assert recast.of(replace(shaded[1], relit=None)) is None


def test_shadows_that_take_no_light_are_gone(shaded):
    """Against the same motion recorded without shadows."""
    take, scene = shaded
    plain = recorded()[0].episode
    after = shown(replace(scene, relit=replace(scene.relit, depth=0.0)))
    off, left = (
        np.mean([np.abs(one.views[n].rgb(T).astype(int) - plain.views[n].rgb(T)).mean() for n in plain.views])
        for one in (after, take.episode)
    )  # fmt: skip
    assert off < left / 2


def test_deeper_and_softer_shadows_take_more_and_end_slowly(shaded):
    take, scene = shaded
    view, table = take.episode.views["front"], take.truth.handles["table"]
    on_table = view.ids(T) == table

    def light(**changed):
        cast = recast.of(replace(scene, relit=replace(scene.relit, **changed)))
        return cast.light("front", T, view.depth(T), view.ids(T))[on_table]

    plain = light()
    np.testing.assert_allclose(light(depth=1.5), np.clip(1 - 1.5 * (1 - plain), 0.02, 1), rtol=1e-5)
    hard, soft = (light(softness=one) for one in (1e-4, 0.2))
    assert ((soft > hard + 0.05) & (hard < 0.9)).any()  # a shadow's inside gets some light
    assert ((soft < hard - 0.05) & (hard > 0.9)).any()  # and its outside loses some


def test_what_is_put_in_casts_a_shadow_and_lies_in_one(shaded):
    take, scene = shaded
    view, table = take.episode.views["overhead"], take.truth.handles["table"]
    top = float(np.median(scene_heights(view, table)))
    bodies = (*scene.bodies, lid(scene, 0.1, top + 0.08))
    before, after = recast.of(scene), recast.of(replace(scene, bodies=bodies))
    at = "overhead", T, view.depth(T), view.ids(T)
    gone = (after.light(*at) < before.light(*at) - 0.05) & (view.ids(T) == table)
    assert gone.sum() > 50
    under = np.where(view.ids(T) == table, 99, view.ids(T)).astype(np.int32)
    covered = after.light("overhead", T, view.depth(T) - np.float32(1e-4), under)
    assert covered[gone].mean() < 0.9  # in the lid's shadow
    assert covered[view.ids(T) == table].max() <= 1


def test_shadows_that_nothing_seen_casts_stay_on_the_floor(shaded):
    take, scene = shaded
    view, floor = take.episode.views["overhead"], take.truth.handles["floor"]
    now = rig.turned(scene.relit.recorded, 0.3, 1.0)
    shown = replace(scene, relit=replace(scene.relit, now=now))
    before = intrinsic.share(scene, "overhead", T)
    dark = (view.ids(T) == floor) & (np.arange(view.camera.width) % 40 < 20) & (before > 0.9)
    assert dark.sum() > 100
    at = "overhead", T, view.depth(T), view.ids(T)
    without, darkened = recast.of(shown).light(*at), recast.of(shown)
    vars(darkened)["_was"] = lambda name, t: np.where(dark, lone_light(scene), before)
    stays = darkened.light(*at)
    assert np.median((without - stays)[dark]) > 0.1
    np.testing.assert_array_equal(stays[~dark], without[~dark])


def test_the_rim_of_a_thing_s_shadow_goes_where_the_shadow_goes(shaded):
    """Recorded shadows reach a pixel or two further than those of known surfaces."""
    take, scene = shaded
    view, lamps = take.episode.views["overhead"], scene.relit.recorded
    cast, shape = recast.of(scene), view.ids(T).shape
    _, places = casting.discs_of(view, T, np.arange(view.ids(T).size))
    maps = np.array(
        [one.reached(places).reshape(shape) for one in cast._before.maps(T, lamps.directions)]
    )
    floor = (view.ids(T) == take.truth.handles["floor"]) & (maps[1:] == 1).all(0)
    shadow = cv2.dilate((maps[0] < 0.5).astype(np.uint8), np.ones((3, 3)))
    rim = floor & (maps[0] == 1) & (shadow > 0)
    far = floor & (cv2.dilate(shadow, np.ones((9, 9))) == 0)
    assert min(rim.sum(), far.sum()) > 5
    up, without = np.array([[0, 0, 1]], np.float32), [0.0] + [1.0] * (len(lamps.directions) - 1)
    dark = np.where(rim | far, lamps.light(up, without)[0], 1).astype(np.float32)
    vars(cast)["_was"] = lambda name, t: dark
    stays = cast._unseen("overhead", T)[0].reshape(shape)
    assert stays[far].mean() > 0.9
    assert stays[rim].mean() < 0.1


def lone_light(scene):
    """The share of level ground that the ambient light and one lamp alone reach."""
    lamps = scene.relit.recorded
    up, reached = np.array([[0, 0, 1]], np.float32), [1.0] + [0.0] * (len(lamps.directions) - 1)
    return lamps.light(up, reached)[0]


def scene_heights(view, table):
    from rpaug.core import geometry

    points = geometry.world_points(view.depth(T).astype(float), view.camera, T)
    return points[view.ids(T) == table][:, 2]


def test_a_moved_camera_sees_the_shadow_gone(shaded):
    take, scene = shaded
    handle = take.truth.handles["block_textured"]
    view = take.episode.views["front"]
    after = recast.of(without(scene, [handle]))
    gain = after.gain(view.camera, T, view.depth(T), view.ids(T))
    table = view.ids(T) == take.truth.handles["table"]
    assert (gain[table] > 1.1).any()
    assert np.median(gain[table]) == 1
