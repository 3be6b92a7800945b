"""What the edits of a copy made of the recorded things."""

from dataclasses import replace

import numpy as np
from analytic import BALL
from analytic import scene as analytic_scene

from rpaug.core.types import Scene
from rpaug.instruct import changes
from rpaug.operators.recolor import AlbedoRatio, Recolor
from rpaug.scene.targets.targets import Target

EYES = {"front": (0.0, -0.9, 0.6)}


def test_what_was_resized_is_not_said_to_be_moved() -> None:
    recorded = analytic_scene(EYES, length=2)
    body = next(one for one in recorded.bodies if BALL in one.instance_ids)
    to_world = np.array(body.to_world)
    to_world[..., 2, 3] += 0.1
    larger = replace(body, scale=2 * body.scale, to_world=to_world)
    found = changes.of(with_body(recorded, larger), ())
    assert found.scales == {BALL: 2.0}
    assert not found.moved
    assert changes.of(with_body(recorded, replace(larger, scale=body.scale)), ()).moved == {BALL}


def with_body(scene: Scene, body: object) -> Scene:
    others = [one for one in scene.bodies if BALL not in one.instance_ids]
    return replace(scene, bodies=(*others, body), recorded_bodies=scene.bodies)


def test_one_paint_without_a_word_leaves_none() -> None:
    recorded = analytic_scene(EYES, length=2)
    operator = Recolor(target=Target(handle=BALL), color="red")
    edit = operator.sample(recorded, np.random.default_rng(0))
    painted = operator.apply(recorded, edit)
    assert changes.of(painted, [(operator, edit)]).words == {BALL: "red"}
    (paint,) = painted.appearance
    assert isinstance(paint, AlbedoRatio)
    again = replace(painted, appearance=(paint, paint))
    assert changes.of(again, [(operator, edit)]).words == {BALL: None}
    assert changes.of(painted, ()).words == {BALL: None}


def test_what_is_painted_twice_goes_by_the_later_word_and_other_looks_on_it_leave_none() -> None:
    scene = analytic_scene(EYES, length=2)
    edits = []
    for color in ("red", "green", "blue"):
        operator = Recolor(target=Target(handle=BALL), color=color)
        edits.append((operator, operator.sample(scene, np.random.default_rng(0))))
        scene = operator.apply(scene, edits[-1][1])
    assert changes.of(scene, edits).words == {BALL: "blue"}
    (paint,) = scene.appearance
    unknown = replace(scene, appearance=(paint, paint))
    assert changes.of(unknown, edits).words == {BALL: None}
