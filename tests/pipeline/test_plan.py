"""The lowest tier that can show a camera, and no more."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from analytic import BALL, scene

from rpaug import Edit, Effect, Needs, Operator, Scene, Unsupported
from rpaug.core import geometry, registry
from rpaug.operators.camera_pose import CameraPose
from rpaug.operators.light_color import LightColor
from rpaug.pipeline import plan, recipe
from rpaug.pipeline.contracts import shown
from rpaug.scene.targets.targets import Target

EYES = {"front": (1.6, 0.3, 1.0), "overhead": (0.1, -0.9, 1.5)}


def test_appearance_stays_on_recorded_pixels_and_a_moved_camera_takes_surfels() -> None:
    episode = scene(EYES, length=2).episode
    assert plan.make([LightColor()], episode).representations == {"front": 0, "overhead": 0}
    assert not plan.make([LightColor()], episode).bodies
    assert plan.make([CameraPose(camera="front")], episode).representations["front"] == 1
    assert plan.make([LightColor()], episode, tier=3).representations["front"] == 3


def test_only_the_camera_that_moved_is_rendered_anew() -> None:
    recorded, operator = scene(EYES, length=2), CameraPose(camera="front")
    made = plan.make([operator], recorded.episode)
    edited = operator.apply(recorded, operator.sample(recorded, np.random.default_rng(0)))
    assert plan.settle(made, edited).representations == {"front": 1, "overhead": 0}
    assert plan.settle(made, recorded).representations == {"front": 0, "overhead": 0}


def test_bodies_that_were_moved_are_seen_where_they_are_now() -> None:
    recorded = scene(EYES, length=2)
    lift = geometry.rigid(np.zeros(3), np.array([0.0, 0.0, 0.3]))
    bodies = tuple(
        replace(body, to_world=lift @ body.to_world, motion="static")
        if BALL in body.instance_ids
        else body
        for body in recorded.bodies
    )
    tracked = tuple(replace(body, motion="static") for body in recorded.bodies)
    edited = replace(recorded, bodies=bodies, recorded_bodies=tracked)
    assert set(plan.settle(plan.make([], recorded.episode), edited).representations.values()) == {1}
    before, after = (shown(one).views["front"].ids(0) == BALL for one in (recorded, edited))
    assert (
        np.argwhere(after)[:, 0].mean() < np.argwhere(before)[:, 0].mean() - 5
    )  # higher up in the image


def test_the_cost_grows_with_copies_and_tiers() -> None:
    episode = scene(EYES, length=2).episode
    many = plan.make([LightColor()], episode).cost(episode, 10_000)
    assert many["seconds"] > 50  # reading and writing cost something, however small it is
    cheap = plan.make([LightColor()], episode).cost(episode, 1)
    assert plan.make([LightColor()], episode).cost(episode, 2, 1)["megabytes"] > 2
    assert plan.make([LightColor()], episode, tier=3).cost(episode, 1)["seconds"] > cheap["seconds"]


def test_things_in_colors_alone_cost_more_than_recorded_ones() -> None:
    episode = scene(EYES, length=2).episode
    bare = {name: replace(view, depth=None, ids=None) for name, view in episode.views.items()}
    colors = replace(episode, views=bare)
    light, things = plan.make([LightColor()], colors), replace(plan.make([], colors), bodies=True)
    assert light.cost(colors, 1) == light.cost(episode, 1)
    assert things.cost(colors, 1)["seconds"] > 1.5 * things.cost(episode, 1)["seconds"]


A, B = {"handle": 1}, {"handle": 2}
PART = {"handle": 1, "part": {"camera": "front", "box": [10, 10, 20, 20]}}
# Of each operator: its tier where no more is wanted, whether bodies are tracked, whether Gaussians are fitted.
PLANS = {
    "background_texture": ({}, 0, True, False),
    "camera_pose": ({"camera": "front"}, 1, True, False),
    "distractors": ({}, 1, True, False),
    "duplicate": ({"target": A}, 1, True, False),
    "insert": ({"near": A}, 1, True, False),
    "light_color": ({}, 0, False, False),
    "light_direction": ({}, 0, False, False),
    "move": ({"target": A, "near": B}, 1, True, False),
    "object_size": ({"target": A}, 1, True, False),
    "physics": ({"target": A, "material": "rubber"}, 1, True, False),
    "recolor": ({"target": A, "color": "blue"}, 0, True, False),
    "remove": ({"target": A}, 1, True, False),
    "retexture": ({"target": A}, 0, True, False),
    "sensor_blur": ({}, 0, False, False),
    "sensor_exposure": ({}, 0, False, False),
    "sensor_jpeg": ({}, 0, False, False),
    "sensor_noise": ({}, 0, False, False),
    "shadows": ({}, 0, False, False),
    "spread": ({"targets": [A, B]}, 1, True, False),
    "stylize": ({"target": A}, 0, True, True),
    "table_color": ({}, 0, True, False),
    "table_texture": ({}, 0, True, False),
}


@pytest.mark.parametrize("name", registry.operator_names())
def test_the_plan_of_each_operator(name: str) -> None:
    fields, tier, bodies, gaussians = PLANS[name]
    made = plan.make([recipe.option(name, fields).operator], scene(EYES, length=2).episode)
    assert set(made.representations.values()) == {tier}
    assert (made.bodies, made.gaussians, made.parts) == (bodies, gaussians, ())


def test_lamps_are_sought_where_one_is_named() -> None:
    episode = scene(EYES, length=2).episode
    asked = [LightColor(), LightColor(lamp=1), recipe.option("shadows", {}).operator]
    assert [plan.make([one], episode).lamps for one in asked] == [False, True, True]


def test_parts_are_those_of_targets_not_of_anchors() -> None:
    episode = scene(EYES, length=2).episode
    part = Target.model_validate(PART)
    for name, fields in (
        ("recolor", {"target": PART, "color": "blue"}),
        ("spread", {"targets": [PART, B, PART]}),
    ):
        assert plan.make([recipe.option(name, fields).operator], episode).parts == (part,)
    beside = recipe.option("move", {"target": A, "near": PART}).operator
    assert plan.make([beside], episode).parts == ()


@dataclass(frozen=True, kw_only=True)
class Other(Operator):
    """An operator of somebody else's."""

    effect = Effect.RGB

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        return {}

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        return scene


def test_another_operators_needs_are_met() -> None:
    recorded = scene(EYES, length=2)
    for needs in (Needs(), Needs(bodies=True), Needs(gaussians=True)):
        kind = type("Some", (Other,), {"needs": needs})
        made = plan.make([kind()], recorded.episode)
        assert made.bodies == (needs.bodies or needs.gaussians)
        assert made.modelled == needs.gaussians
    deep = type("Deep", (Other,), {"needs": Needs(depth=True)})()
    plan.check(deep, recorded)
    flat = {name: replace(view, depth=None) for name, view in recorded.episode.views.items()}
    flat_scene = replace(recorded, episode=replace(recorded.episode, views=flat))
    plan.check(Other(), flat_scene)
    with pytest.raises(Unsupported, match="needs recorded depth"):
        plan.check(deep, flat_scene)
