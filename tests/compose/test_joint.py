"""The joint fine-tune steps the edited Gaussians alone, and keeps what came of it only where that is nearer."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import rpaug
from rpaug.compose import baking, joint
from rpaug.compose.goals import goals
from rpaug.core import registry
from rpaug.core.types import Scene
from rpaug.gaussians.descent import PARAMETERS, settings_for
from rpaug.gaussians.fit import fitted
from rpaug.pipeline import copies, plan, prepare, recipe
from rpaug.render.splat import Splats
from rpaug.scene.build import build

SHORT = joint.RefineSettings(steps=60, times=4, held=2)


@pytest.fixture(scope="module")
def sample() -> Scene:
    from pathlib import Path

    folder = Path(rpaug.__file__).parent / "sample"
    adapter = registry.adapter_for(folder)
    scene = build(adapter.read(folder, adapter.episodes(folder)[0]), with_bodies=True)
    return fitted(scene, settings=replace(settings_for(steps=60), checked_frames=1), seed=0)[0]


@dataclass(frozen=True)
class Paint:
    """Stripes by place: what one color a Gaussian cannot show at first."""

    instance_ids: frozenset[int] | None

    def __call__(self, color, surface):
        stripe = (np.floor(surface.points[:, :1] / 0.05) % 2).astype(np.float32)
        return color * np.array([0.2, 0.3, 1.0], np.float32) + 0.3 * stripe


def painted(scene: Scene) -> Scene:
    return replace(scene, appearance=(Paint(scene.roles["manipulated"]),))


def moved(scene: Scene, factor: float) -> Scene:
    instance_ids = scene.roles["manipulated"]
    bodies = tuple(
        replace(body, scale=factor) if body.instance_ids & instance_ids else body
        for body in scene.bodies
    )
    return replace(scene, bodies=bodies, recorded_bodies=scene.bodies)


def test_all_but_the_edited_gaussians_keep_every_bit(sample: Scene) -> None:
    assert sample.gaussians is not None
    scene = painted(sample)
    tuned, facts = joint.refined(scene, SHORT)
    rows = joint.edited(scene)
    assert facts["kept"]
    assert facts["after_db"] > facts["before_db"]
    assert facts["gaussians"] == len(rows) > 100
    others = np.setdiff1d(np.arange(len(sample.gaussians)), rows)
    assert tuned.gaussians is not None
    for name in PARAMETERS:
        before, after = getattr(sample.gaussians, name), getattr(tuned.gaussians, name)
        assert np.array_equal(before[others], after[others])
    assert not np.array_equal(sample.gaussians.sh[rows], tuned.gaussians.sh[rows])
    assert tuned.appearance == ()  # the paint is the Gaussians' own now
    again, _ = joint.refined(scene, SHORT)
    assert again.gaussians is not None
    assert np.array_equal(again.gaussians.sh, tuned.gaussians.sh)


def test_resized_things_are_stepped_by_the_rows_they_are_drawn_from(sample: Scene) -> None:
    scene = moved(sample, 0.9)
    rows = joint.edited(scene)
    assert scene.gaussians is not None
    assert set(scene.gaussians.ids[rows].tolist()) <= scene.roles["manipulated"]
    descent = joint._JointDescent(scene, rows, SHORT)
    placed = descent._place.place(Splats.of(scene.gaussians), 3)
    drawn, origin, scales = descent._edited(scene.gaussians, placed, 3)
    assert origin is not None
    assert np.array_equal(drawn.sh, placed.sh[origin])
    assert np.allclose(drawn.scales, placed.scales[origin] * scales[:, None])
    assert set(origin[scales != 1].tolist()) == set(rows.tolist())


def test_an_outcome_that_is_no_nearer_is_dropped(sample: Scene) -> None:
    scene = painted(sample)
    wild = replace(SHORT, steps=3, rates=replace(joint.LOOKS, sh=5.0, opacities=5.0))
    same, facts = joint.refined(scene, wild)
    assert same is scene
    assert not facts["kept"]


def test_without_edits_or_masks_nothing_is_done(sample: Scene) -> None:
    assert joint.refined(sample, SHORT)[0] is sample
    bare = {name: replace(view, ids=None) for name, view in sample.episode.views.items()}
    scene = painted(replace(sample, episode=replace(sample.episode, views=bare)))
    same, facts = joint.refined(scene, SHORT)
    assert same is scene
    assert "lacks" in facts["skipped"]


def test_what_cannot_be_laid_into_gaussians_stays_an_edit(sample: Scene) -> None:
    """Light, what came after it, and things of which there are copies."""
    instance_ids = sample.roles["manipulated"]
    light, paint = Paint(None), Paint(instance_ids)
    after = replace(sample, appearance=(light, paint))
    assert baking.painted(after) == frozenset()
    assert baking.baked(after).appearance == (light, paint)
    assert baking.baked(replace(sample, appearance=(paint, light))).appearance == (light,)
    (body,) = [body for body in sample.bodies if body.instance_ids & instance_ids][:1]
    old = min(body.instance_ids & instance_ids)
    twice = replace(body, instance_ids=frozenset([9999]), copy_of={old: 9999})
    copied = replace(sample, appearance=(paint,), bodies=(*sample.bodies, twice))
    assert old not in baking.painted(copied)
    (left,) = baking.baked(copied).appearance
    assert left.instance_ids == frozenset([old])
    left, last = baking.baked(replace(copied, appearance=(paint, light))).appearance
    assert (left.instance_ids, last) == (frozenset([old]), light)  # in the order of the edits


def test_goals_are_the_recorded_pixels_with_the_paint(sample: Scene) -> None:
    instance_ids = sample.roles["manipulated"]
    for goal in goals(painted(sample), [3], instance_ids):
        view = sample.episode.views[goal.name]
        assert view.ids is not None
        beside = ~np.isin(view.ids(3), list(instance_ids))
        same = goal.rgb[beside] == view.rgb(3)[beside].astype(np.float32) / 255
        assert same.mean() > 0.9  # anti-aliased outlines are mixtures


def test_a_recipe_asks_for_it_and_the_report_tells(sample: Scene) -> None:
    made = recipe.build(
        {
            "version": 1,
            "refine": 3,
            "edits": [{"op": "recolor", "target": {"role": "manipulated"}, "color": "blue"}],
        }
    )
    assert made.refine == 3
    edited, draws = copies.draw(sample, made, 1)
    for tier in (3, 0):
        planned = plan.make(prepare.operators(made), sample.episode, tier)
        done = copies.render(edited, draws, replace(planned, refine=made.refine))
        given = done.plan.describe()["refined"]
        assert given["gaussians"] > 100 if tier == 3 else "tier 3" in given["skipped"]
        assert done.scene.appearance == edited.appearance
