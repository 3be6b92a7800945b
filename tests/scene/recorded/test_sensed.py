"""A sensor's depth is repaired for the scene and comes back as it was; rendered depth is left alone."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import BALL, BOX, EYES, TABLE, scene

from rpaug import Scene
from rpaug.compose import views
from rpaug.core.errors import SourceLacks
from rpaug.core.types import Episode
from rpaug.operators.recolor import Recolor
from rpaug.operators.remove import Remove
from rpaug.pipeline import plan
from rpaug.pipeline.prepare import build_and_plan
from rpaug.pipeline.recipe import Recipe
from rpaug.scene.build import build
from rpaug.scene.placement import untouched
from rpaug.scene.placement.free_space import MARGIN
from rpaug.scene.recorded import sensed

NOISE = 0.003  # of depth
TIMES = (0, 3, 7)


def measured(recorded: Scene, seed: int = 0) -> Episode:
    """The episode with noise, holes that come and go, and one that stays."""

    def image(view, number, t):
        rng = np.random.default_rng([seed, number, t])
        depth = view.depth(t) * (1 + NOISE * rng.standard_normal(view.depth(t).shape))
        depth[rng.random(depth.shape) < 0.05] = 0
        depth[40:46, 30:36] = 0
        return depth.astype(np.float32)

    seen = {}
    for number, (name, view) in enumerate(recorded.episode.views.items()):
        images = [image(view, number, t) for t in range(recorded.episode.length)]
        seen[name] = replace(view, depth=images.__getitem__)
    return replace(recorded.episode, views=seen)


@pytest.fixture(scope="module")
def true() -> Scene:
    return scene(EYES, moving="wrist")


@pytest.fixture(scope="module")
def noisy(true) -> Episode:
    return measured(true)


def test_rendered_depth_is_left_alone(true) -> None:
    assert sensed.repaired(true.episode) is true.episode
    assert sensed.told(build(true.episode, with_bodies=False).episode) == ()


@pytest.mark.parametrize("name", list(EYES))
def test_noise_shrinks_and_holes_are_filled(true, noisy, name) -> None:
    view, exact = sensed.repaired(noisy).views[name], true.episode.views[name]
    before, after, filled = [], [], []
    for t in TIMES:
        truth, raw, now = exact.depth(t), noisy.views[name].depth(t), view.depth(t)
        known = (truth > 0) & (raw > 0)
        before.append(np.abs(raw - truth)[known])
        after.append(np.abs(now - truth)[known])
        holes = (truth > 0) & (raw == 0)
        assert (now[holes] > 0).mean() > 0.97
        filled.append(np.abs(now - truth)[holes & (now > 0)])
        assert (now[truth == 0] == 0).all()  # nothing is made up where nothing is
    # Not all: a face that is seen edge on looks like pixels that fly.
    least, most = (np.quantile(np.concatenate(part), 0.95) for part in (after, before))
    assert least < 0.75 * most
    told = view.sensed
    assert told is not None
    assert (np.concatenate(filled) < told.spread).mean() > 0.85  # nine tenths, it says
    assert told.spread < MARGIN
    assert told.missing > told.unknown


def test_a_camera_that_stands_averages_what_it_saw_of_one_place(true, noisy) -> None:
    view, exact = sensed.repaired(noisy).views["front"], true.episode.views["front"]
    rest = np.logical_and.reduce([exact.ids(t) == exact.ids(0) for t in range(8)]) & (
        exact.depth(0) > 0
    )
    one, other = (view.depth(t)[rest] for t in (0, 7))
    raw, late = (noisy.views["front"].depth(t)[rest] for t in (0, 7))
    both = (raw > 0) & (late > 0)
    assert np.median(np.abs(one - other)) < 0.1 * np.median(np.abs(raw - late)[both])


def test_a_moved_thing_keeps_its_own_depth(true, noisy) -> None:
    view, exact = sensed.repaired(noisy).views["front"], true.episode.views["front"]
    for t in TIMES:
        ball = exact.ids(t) == BALL
        assert np.median(np.abs(view.depth(t) - exact.depth(t))[ball]) < NOISE


def test_an_edit_of_colors_leaves_the_recorded_depth_itself(true, noisy) -> None:
    built = replace(true, episode=sensed.repaired(noisy))
    edit = Recolor(target={"handle": BOX}, color={"rgb": [1, 0, 0]})
    edited = edit.apply(built, edit.sample(built, np.random.default_rng(0)))
    shown = views.edited(edited, dict.fromkeys(EYES, 0), lambda frame: None)
    for name in EYES:
        assert shown.views[name].depth == noisy.views[name].depth
        assert shown.views[name].sensed is None


def test_where_nothing_changed_depth_comes_back_bit_by_bit(true, noisy) -> None:
    built = replace(true, episode=sensed.repaired(noisy))
    edited = untouched.without(built, [BALL])
    shown = views.edited(edited, dict.fromkeys(EYES, 1), lambda frame: None)
    for name in ("front", "side"):
        for t in TIMES:
            there = true.episode.views[name].ids(t) == BALL
            now, raw = shown.views[name].depth(t), noisy.views[name].depth(t)
            np.testing.assert_array_equal(now[~there], raw[~there])
            truth = scene(EYES, moving="wrist", ball=False).episode.views[name].depth(t)
            assert np.median(np.abs(now - truth)[there]) < 2 * NOISE


def test_what_was_repaired_is_said(noisy) -> None:
    recipe = Recipe.from_dict(
        {"version": 1, "edits": [{"op": "recolor", "target": {"handle": TABLE}, "color": "red"}]}
    )
    _, planned = build_and_plan(noisy, recipe, 0)
    (line,) = [one for one in planned.assumed if one.startswith("side: its depth is a sensor's")]
    assert "what was filled may be off by" in line


@pytest.mark.parametrize("spread", [1.1 * MARGIN, float("inf")])
def test_depth_that_may_be_far_off_moves_nothing(noisy, spread) -> None:
    built = build(noisy, with_bodies=False)
    seen = {
        name: replace(view, sensed=replace(view.sensed, spread=spread))
        for name, view in built.episode.views.items()
    }
    doubtful = replace(built, episode=replace(built.episode, views=seen))
    plan.check(Remove(target={"handle": BALL}), built)
    plan.check(Recolor(target={"handle": BALL}, color="red"), doubtful)
    with pytest.raises(SourceLacks, match="what was filled of the sensor's depth"):
        plan.check(Remove(target={"handle": BALL}), doubtful)
