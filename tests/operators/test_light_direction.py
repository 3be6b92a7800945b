"""Relighting against a scene lit in closed form, and what cannot be relit."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import BALL, scene
from pydantic import TypeAdapter, ValidationError

from rpaug import Scene, Unsupported
from rpaug.operators.light_direction import LightDirection
from rpaug.pipeline.contracts import OperatorContract, shown
from rpaug.scene.lighting import light
from rpaug.scene.lighting.light import Lamp
from rpaug.scene.recorded import surface

EYES = {"front": (1.6, 0.3, 1.0), "overhead": (0.1, -0.9, 1.5), "side": (-1.2, -1.0, 0.9)}
RECORDED = np.array([0.5, -0.4, 0.77])
RECORDED = RECORDED / np.linalg.norm(RECORDED)


def lit(direction: np.ndarray, ambient: float = 0.3) -> Scene:
    """The analytic scene in plain colors under one lamp."""
    recorded = scene(EYES, length=2)
    lamp = Lamp(tuple(direction), ambient, 1.0)

    def image(view, t):  # type: ignore[no-untyped-def]
        ids = view.ids(t)
        facing = surface.of_view(view, t, (), ids)(np.arange(ids.size)).facing
        albedo = np.select([ids == 7, ids == BALL, ids > 0], [0.7, 0.9, 0.5], 0.0)
        shade = albedo * lamp.shading(facing).reshape(ids.shape)
        return np.rint(255 * np.repeat(shade[..., None], 3, 2)).astype(np.uint8)

    views = {
        name: replace(view, rgb=lambda t, view=view: image(view, t))
        for name, view in recorded.episode.views.items()
    }
    return replace(recorded, episode=replace(recorded.episode, views=views))


class TestContract(OperatorContract):
    frames = (0, 1)

    def operator(self) -> LightDirection:
        return LightDirection()

    def scene(self) -> Scene:
        return lit(RECORDED)


def test_the_dominant_lamp_is_found() -> None:
    found = light.dominant(lit(RECORDED).episode)
    assert np.degrees(np.arccos(np.dot(found.direction, RECORDED))) < 8
    assert abs(found.ambient - 0.3) < 0.11
    assert found.explained > 0.8


def test_moving_the_lamp_gives_what_it_would_have_lit() -> None:
    recorded, new = lit(RECORDED), np.array([0.0, 0.6, 0.8])
    operator = LightDirection(to=(0.0, 0.6, 0.8), recorded=tuple(RECORDED), ambient=0.3)
    after = shown(operator.apply(recorded, operator.sample(recorded, np.random.default_rng(0))))
    truth = lit(new).episode
    errors = []
    for name, view in truth.views.items():
        off = view.rgb(0).astype(float) - after.views[name].rgb(0)
        errors.append(off[view.rgb(0).max(-1) < 250].ravel())
    assert 10 * np.log10(255**2 / (np.concatenate(errors) ** 2).mean()) > 32


def test_draws_stay_within_the_turn_and_above_the_horizon() -> None:
    recorded, operator = lit(RECORDED), LightDirection(turn=0.6, recorded=tuple(RECORDED))
    for seed in range(4):
        drawn = np.array(operator.sample(recorded, np.random.default_rng(seed))["direction"])
        assert np.arccos(drawn @ RECORDED) <= 0.6 + 1e-9
        assert drawn[2] > 0.1


@pytest.mark.parametrize(
    "fields", [{"turn": 0}, {"to": [0, 0, 0]}, {"ambient": 0}, {"recorded": "guess"}]
)
def test_senseless_fields_are_refused(fields: dict) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(LightDirection).validate_python(fields)


def test_without_depth_there_is_nothing_to_light() -> None:
    recorded = lit(RECORDED)
    blind = {name: replace(view, depth=None) for name, view in recorded.episode.views.items()}
    with pytest.raises(Unsupported, match="depth"):
        LightDirection().sample(
            replace(recorded, episode=replace(recorded.episode, views=blind)),
            np.random.default_rng(0),
        )


def test_a_lamp_that_faces_do_not_tell_is_said_to_be_a_guess() -> None:
    """Things whose brightness is a pattern, under no lamp; and what is known needs no guess."""
    patterned, told = scene(EYES, length=2), lit(RECORDED)
    operator = LightDirection()
    for recorded, guesses in ((patterned, 1), (told, 0)):
        edit = operator.sample(recorded, np.random.default_rng(0))
        ((words, count),) = operator.falls_short(edit).items()
        assert count == (guesses, 1)
        assert words.startswith("lamps are a guess")
    given = LightDirection(recorded=tuple(RECORDED))
    assert given.falls_short(given.sample(patterned, np.random.default_rng(0))) == {}
