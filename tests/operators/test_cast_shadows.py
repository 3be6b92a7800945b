"""Cast shadows are changed where lamps are known, and refused where they are not."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import TABLE, scene
from pydantic import TypeAdapter, ValidationError

from rpaug import Scene, Unsupported
from rpaug.core.types import Relit, Rig
from rpaug.operators.light_color import LightColor
from rpaug.operators.light_direction import LightDirection
from rpaug.operators.shadows import Shadows
from rpaug.pipeline.contracts import OperatorContract, shown
from rpaug.scene.lighting import recast

EYES = {"front": (1.6, 0.3, 1.0), "overhead": (0.1, -0.9, 1.5)}
LAMP = Rig(0.4, ((0.6, 0.0, 0.8),), (0.75,))


def lit() -> Scene:
    """The analytic scene, known to lie under one lamp."""
    return replace(scene(EYES, length=2), relit=Relit(LAMP, LAMP))


class TestShadowsContract(OperatorContract):
    frames = (0, 1)

    def operator(self) -> Shadows:
        return Shadows(depth=(0.2, 0.4), softness=(0.05, 0.1), turn=1.0)

    def scene(self) -> Scene:
        return lit()


class TestLightDirectionContract(OperatorContract):
    frames = (0, 1)

    def operator(self) -> LightDirection:
        return LightDirection(to=(0.0, -0.6, 0.8))

    def scene(self) -> Scene:
        return lit()


class TestLampColorContract(OperatorContract):
    frames = (0, 1)

    def operator(self) -> LightColor:
        return LightColor(lamp="strongest")

    def scene(self) -> Scene:
        return lit()


def test_a_lamp_that_is_put_out_leaves_the_ambient_light() -> None:
    before = lit()
    dark = LightColor(lamp=1, range=((0, 0, 0), (0, 0, 0)), recorded=(0.5, 0.5, 0.5))
    after = shown(dark.apply(before, dark.sample(before, np.random.default_rng(0))))
    view = before.episode.views["overhead"]
    light = recast.of(before).light("overhead", 0, view.depth(0), view.ids(0))
    table = view.ids(0) == TABLE
    ratio = after.views["overhead"].rgb(0).mean(-1) / np.maximum(view.rgb(0).mean(-1), 1)
    np.testing.assert_allclose(ratio[table & (light > 0.99)], LAMP.ambient, atol=0.02)
    np.testing.assert_allclose(ratio[table & (light < 0.41)], 1, atol=0.02)


def test_colors_of_lamps_multiply_and_stay_with_lamps_that_turn() -> None:
    rng, before = np.random.default_rng(0), lit()
    red = LightColor(lamp="all", range=((0.5, 0.1, 0.1),) * 2, recorded=(0.5, 0.5, 0.5))
    once = red.apply(before, red.sample(before, rng))
    twice = red.apply(once, red.sample(once, rng))
    np.testing.assert_allclose(twice.relit.gains, [[1, 0.04, 0.04]])
    turned = LightDirection(to=(0.0, -0.6, 0.8))
    assert turned.apply(twice, turned.sample(twice, rng)).relit.gains == twice.relit.gains


def test_a_lamp_that_is_not_told_is_refused() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(Unsupported, match="no shadow was seen"):
        LightColor(lamp="strongest").sample(scene(EYES, length=2), rng)
    with pytest.raises(Unsupported, match="lamp 2 of the 1"):
        LightColor(lamp=2).sample(lit(), rng)
    for wrong in ({"lamp": 0}, {"lamp": "left"}, {"lamp": 1, "ambient": 0.5}):
        with pytest.raises(ValidationError):
            TypeAdapter(LightColor).validate_python(wrong)


def test_without_known_lamps_it_is_refused() -> None:
    with pytest.raises(Unsupported, match="no shadow was seen"):
        Shadows().sample(scene(EYES, length=2), np.random.default_rng(0))


def test_edits_of_shadows_add_up() -> None:
    rng, once = np.random.default_rng(0), lit()
    half = Shadows(depth=(0.5, 0.5))
    twice = half.apply(half.apply(once, half.sample(once, rng)), half.sample(once, rng))
    assert twice.relit == replace(once.relit, depth=0.25)
    turned = LightDirection(to=(0.0, -0.6, 0.8))
    after = turned.apply(twice, turned.sample(twice, rng))
    np.testing.assert_allclose(after.relit.now.directions, [[0, -0.6, 0.8]], atol=1e-9)
    assert (after.relit.depth, after.relit.recorded) == (0.25, LAMP)


def test_a_lamp_that_moved_casts_from_where_it_stands() -> None:
    before = lit()
    operator = LightDirection(to=(0.0, -0.6, 0.8))
    after = operator.apply(before, operator.sample(before, np.random.default_rng(0)))
    view = before.episode.views["overhead"]
    light = recast.of(after).light("overhead", 0, view.depth(0), view.ids(0))
    table = light[view.ids(0) == TABLE]
    assert np.median(table) == pytest.approx(1, abs=0.01)  # as high as before
    assert (table < 0.45).sum() > 30  # the box's and the ball's shadows
    brighter = shown(after).views["overhead"].rgb(0)[view.ids(0) == TABLE].astype(int)
    assert (brighter.mean(-1) < view.rgb(0)[view.ids(0) == TABLE].mean(-1) - 10).sum() > 30


def test_fields_are_held_within_reason() -> None:
    for wrong in (
        {"depth": (0.5, 3.0)},
        {"depth": (0.6, 0.5)},
        {"softness": (0.0, 1.0)},
        {"turn": 4.0},
    ):
        with pytest.raises(ValidationError):
            TypeAdapter(Shadows).validate_python(wrong)
