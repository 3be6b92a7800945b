"""The lowest tier that can show a camera, and no more."""

from dataclasses import replace

import numpy as np
from analytic import BALL, scene

from rpaug.core import geometry
from rpaug.operators.camera_pose import CameraPose
from rpaug.operators.light_color import LightColor
from rpaug.pipeline import plan
from rpaug.pipeline.contracts import shown

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
    cheap = plan.make([LightColor()], episode).cost(episode, 1)
    assert plan.make([LightColor()], episode).cost(episode, 2)["megabytes"] >= cheap["megabytes"]
    assert plan.make([LightColor()], episode, tier=3).cost(episode, 1)["seconds"] > cheap["seconds"]
