"""The lights that shipped recipes draw: no frame loses half of its mean, no colored thing its hue.

COLOSSEUM's recipes draw what COLOSSEUM draws, darkness among it.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import rpaug_recipes

from rpaug.compose import views
from rpaug.core import color_space, registry
from rpaug.core.types import Effect, Episode, Scene
from rpaug.pipeline import prepare, recipe
from rpaug.pipeline.recipe import Option
from rpaug.scene.lighting import albedo

LIGHTS = {"light_color", "light_direction"}
COLORED = 3 * color_space.COLORLESS  # chroma from which a thing is plainly of some color
SHIPPED = sorted(Path(rpaug_recipes.__file__).parent.glob("*.yaml"))


def lights() -> list[tuple[str, Option]]:
    """Every light edit of the shipped recipes, with its recipe's name."""
    found = []
    for path in SHIPPED:
        if path.stem != "materials":
            steps = recipe.load(path).steps
            found += [(path.stem, one) for s in steps for one in s.options if one.name in LIGHTS]
    return found


@cache
def sample() -> Scene:
    made = recipe.build({"version": 1, "edits": [{"op": "light_color"}]})
    return prepare.prepare_scene(registry.read(registry.SAMPLE, None), made, 0, None)[0]


def chroma(episode: Episode, instance_id: int) -> float:
    seen = albedo.pixels(episode, instance_id)
    if len(seen) < 30:
        return 0.0
    return float(np.hypot(*color_space.to_lab(np.median(seen, 0))[1:]))


def test_some_shipped_recipe_draws_lights() -> None:
    assert {"demo", "robust", "light_color"} <= {name for name, _ in lights()}


@pytest.mark.parametrize(("name", "light"), lights(), ids=[name for name, _ in lights()])
def test_lights_of_shipped_recipes_leave_brightness_and_hue(name: str, light: Option) -> None:
    scene, rng = sample(), np.random.default_rng(0)
    assert light.operator.effect is Effect.RGB
    front = {"front": scene.episode.views["front"]}
    scene = replace(scene, episode=replace(scene.episode, views=front))
    before = front["front"].rgb(8)
    colored = [
        one
        for one in np.unique(front["front"].ids(8)).tolist()
        if chroma(scene.episode, one) > COLORED
    ]  # type: ignore[misc]
    assert len(colored) >= 4
    for _ in range(12):
        lit = light.operator.apply(scene, light.operator.sample(scene, rng))
        shown = views.edited(lit, {"front": 0}, lambda *ignored: None)
        assert shown.views["front"].rgb(8).mean() >= before.mean() / 2
        for instance_id in colored:
            assert chroma(shown, instance_id) > color_space.COLORLESS, (name, instance_id)
