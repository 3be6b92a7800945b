"""Highlights are told by how places look from elsewhere; matte recordings, and those that none explain, stay."""

import json
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from analytic import LENGTH, TABLE, scene, seen_by

from rpaug import twin
from rpaug.core import geometry
from rpaug.core.types import Episode, Scene
from rpaug.operators.light_direction import LightDirection
from rpaug.operators.remove import Remove
from rpaug.pipeline.contracts import shown
from rpaug.scene.build import build
from rpaug.scene.lighting import albedo, casting, highlights, intrinsic, rig, shading
from rpaug.scene.targets.targets import Target
from rpaug.twin.look import RIG, TwinLamp

EYES = {"front": (0.0, -0.8, 0.7), "side": (0.8, -0.2, 0.8), "left": (-0.8, -0.1, 0.9)}
LAMP = np.array([-0.6, 0.3, 0.74]) / np.linalg.norm([-0.6, 0.3, 0.74])
EXPONENT, STRENGTH = 20.0, 0.4


def shining(color=(1.0, 1.0, 1.0)) -> Scene:
    """The analytic scene, whose level ground mirrors one lamp."""
    plain = scene(EYES, length=LENGTH)

    def paint(name, t, rgb, depth, ids):  # type: ignore[no-untyped-def]
        camera = plain.episode.views[name].camera
        points = geometry.world_points(depth.astype(float), camera, t)
        level = (ids > 0) & (np.abs(points[..., 2]) < 1e-3)
        ray = camera.cam_to_world[t, :3, 3] - points
        middle = ray / np.maximum(np.linalg.norm(ray, axis=-1, keepdims=True), 1e-9) + LAMP
        cosine = middle[..., 2] / np.linalg.norm(middle, axis=-1)
        shine = STRENGTH * np.where(level, np.maximum(cosine, 0) ** EXPONENT, 0)
        lit = rgb * 0.6 + 255 * shine[..., None] * np.array(color)
        return np.clip(np.rint(lit), 0, 255).astype(np.uint8), depth, ids

    return seen_by(plain, paint)


def test_images_without_highlights_are_made_once_and_leave_what_casts_known():
    seen = shining((1.0, 0.6, 0.2))
    bare = highlights.matte(seen)
    made = {name: view.rgb(0) for name, view in bare.views.items()}
    assert any((seen.episode.views[name].rgb(0) != one).any() for name, one in made.items())
    assert all(bare.views[name].rgb(0) is one for name, one in made.items())
    known = casting.casters(rig.recorded(seen))
    assert casting.casters(rig.recorded(replace(seen, episode=bare))) is known


def test_metals_mirror_in_a_color_of_their_own():
    found = highlights.find(shining((1.0, 0.6, 0.2)))
    assert found is not None
    red, green, blue = max(found.finishes.values(), key=lambda one: sum(one.color)).color
    assert green / red == pytest.approx(0.6, abs=0.1)
    assert blue / red == pytest.approx(0.2, abs=0.1)


@pytest.mark.parametrize("color", [(1.0, 0.6, 0.2), (0.6, 0.6, 0.6)])
def test_a_metal_is_told_by_the_color_that_it_mirrors_in(color):
    seen = shining(color)
    found = highlights.find(seen)
    assert found is not None
    ground = max(found.finishes, key=lambda one: sum(found.finishes[one].color))
    assert highlights.metallic(seen, ground, (0.5, 0.3, 0.1)) == (color == (1.0, 0.6, 0.2))
    assert not highlights.metallic(seen, ground, (0.1, 0.3, 0.5))
    assert not highlights.metallic(seen, ground, (0.5, 0.5, 0.5))  # grey: not told from white


def test_a_matte_recording_stays_as_it_was():
    plain = scene(EYES, length=LENGTH)
    assert highlights.find(plain) is None
    assert highlights.matte(plain) is plain.episode
    assert intrinsic.unshadowed(plain) is plain.episode


def test_cameras_that_differ_in_exposure_show_no_highlights():
    def exposed(name, t, rgb, depth, ids):  # type: ignore[no-untyped-def]
        gain = {"front": 1.0, "side": 0.7, "left": 0.85}[name]
        return np.rint(gain * rgb).astype(np.uint8), depth, ids

    assert highlights.find(seen_by(scene(EYES, length=LENGTH), exposed)) is None


@pytest.fixture(scope="module")
def shiny() -> Scene:
    look = twin.Look(specular=True)
    return build(twin.perform("push_button", 2, frames=11, look=look).episode, with_bodies=False)


@pytest.fixture(scope="module")
def plain() -> Scene:
    return build(twin.perform("push_button", 2, frames=11).episode, with_bodies=False)


@pytest.mark.gl
def test_mirrored_lamps_are_found_where_they_stand(shiny: Scene):
    found = highlights.find(shiny)
    assert found is not None
    along = np.cos([lamp.height for lamp in RIG])
    heading = np.array([lamp.heading for lamp in RIG])
    up = np.sin([lamp.height for lamp in RIG])
    true = np.stack([along * np.cos(heading), along * np.sin(heading), up], -1)
    assert len(found.lamps.directions) == len(RIG)
    assert ((np.array(found.lamps.directions) @ true.T).max(1) > np.cos(np.deg2rad(4))).all()
    assert found.lamps.exponent == pytest.approx(25.6, rel=0.1)


@pytest.mark.gl
def test_without_its_highlights_an_episode_is_matte(shiny: Scene, plain: Scene):
    told = highlights.matte(shiny)
    for name in ("left_shoulder", "right_shoulder", "overhead"):
        goal = plain.episode.views[name].rgb(5).astype(float)
        before, after = (
            ((one.views[name].rgb(5) - goal) ** 2).mean() for one in (shiny.episode, told)
        )
        assert after < before / 20
    assert highlights.find(plain) is None


@pytest.mark.gl
def test_under_cast_shadows_only_what_a_lamp_reaches_mirrors_it():
    both, dark = (
        twin.perform("push_button", 2, frames=11, look=twin.Look(specular=on, shadows=True)).episode
        for on in (True, False)
    )
    shaded = build(both, with_bodies=True)
    found = highlights.find(shaded)
    assert found is not None
    assert len(found.shadows) == len(found.lamps.directions)
    told = highlights.matte(shaded)
    for name in ("front", "left_shoulder", "right_shoulder"):
        goal = dark.views[name].rgb(5).astype(float)
        before, after = (((one.views[name].rgb(5) - goal) ** 2).mean() for one in (both, told))
        assert after < before / 2  # of the floor's shadows, much is cast by what no image shows


def test_a_metal_is_as_bright_as_metals_are(monkeypatch):
    """How bright a metal's color is its matte part does not tell; its hue it does."""
    dim = seen_by(scene(EYES, length=LENGTH), lambda name, t, rgb, *rest: (rgb // 2, *rest))
    (matte,) = shading.describe(dim, [TABLE])["surfaces"]
    monkeypatch.setattr(highlights, "metallic", lambda *_: True)
    (metal,) = shading.describe(dim, [TABLE])["surfaces"]
    assert max(matte["albedo"]) < albedo.METAL
    assert max(metal["albedo"]) == pytest.approx(albedo.METAL)
    gains = np.divide(metal["albedo"], matte["albedo"])
    assert gains == pytest.approx(gains[0])
    assert metal["of_metal"]
    (known,) = shading.describe(dim, [TABLE], (0.2, 0.3, 0.4))["surfaces"]
    assert known["albedo"] == [0.2, 0.3, 0.4]
    assert known["metal"]
    assert "of_metal" not in known


def off(
    made: Episode, true: Episode, recorded: Episode, instance_ids: Sequence[int] | None = None
) -> float:
    """The mean squared error in what shines or showed one of the instance ids, over all still cameras."""
    found = []
    for name in ("front", "left_shoulder", "right_shoulder", "overhead"):
        images = (one.views[name].rgb(5).astype(float) for one in (made, true))
        error = ((next(images) - next(images)) ** 2).mean(-1)
        ids = recorded.views[name].ids(5)
        found.append(error.ravel() if instance_ids is None else error[np.isin(ids, instance_ids)])
    return float(np.concatenate(found).mean())


@pytest.mark.gl
def test_what_shows_behind_a_removed_thing_mirrors_the_lamps_as_its_camera_sees_them(monkeypatch):
    look = twin.Look(specular=True)
    true = twin.perform("pick_block", 3, frames=17, look=look, factor="removal")
    recorded = build(twin.perform("pick_block", 3, frames=17, look=look).episode, with_bodies=True)
    gone = list(true.truth.changed)
    operator = Remove(target=Target(handle=gone))
    edit = operator.sample(recorded, np.random.default_rng(0))
    told = off(shown(operator.apply(recorded, edit)), true.episode, recorded.episode, gone)
    monkeypatch.setattr(highlights, "find", lambda _: None)
    untold = off(shown(operator.apply(recorded, edit)), true.episode, recorded.episode, gone)
    assert told < untold / 1.5


def towards(lamp: TwinLamp) -> tuple[float, float, float]:
    along = np.cos(lamp.height)
    return (
        float(along * np.cos(lamp.heading)),
        float(along * np.sin(lamp.heading)),
        float(np.sin(lamp.height)),
    )


@pytest.mark.gl
def test_highlights_go_along_with_their_lamp():
    look = twin.Look(specular=True, lamps=RIG[:1])
    before, true = (
        twin.perform("pick_block", 3, frames=17, look=look, factor=factor)
        for factor in (None, "light_direction")
    )
    recorded = build(before.episode, with_bodies=True)
    found = highlights.find(recorded)
    assert found is not None
    old, new = (towards(lamps[0]) for lamps in (look.lamps, true.truth.new.lamps))
    operator = LightDirection(to=new, recorded=old, ambient=0.375)
    edit = operator.sample(recorded, np.random.default_rng(0))
    assert json.loads(json.dumps(edit)) == edit
    told = off(shown(operator.apply(recorded, edit)), true.episode, recorded.episode)
    without = {name: value for name, value in edit.items() if name != "mirrored"}
    untold = off(shown(operator.apply(recorded, without)), true.episode, recorded.episode)
    assert told < untold / 1.5
