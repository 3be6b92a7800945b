"""Shadows on the table: lamps are found where there are some, and shadows go along with what casts them."""

from dataclasses import replace

import numpy as np
import pytest

from rpaug import twin
from rpaug.pipeline.contracts import shown
from rpaug.scene.build import build
from rpaug.scene.lighting import shadows
from rpaug.scene.placement.untouched import without
from rpaug.twin.look import RIG

pytestmark = pytest.mark.gl


def recorded(**look):
    take = twin.perform("push_button", 2, frames=11, look=twin.Look(**look))
    return take, build(take.episode, with_bodies=True)


@pytest.fixture(scope="module")
def shaded():
    return recorded(shadows=True)


def test_the_lamps_of_the_twin_are_found(shaded):
    found = np.array(shadows.of_table(shaded[1]))
    assert 1 <= len(found) <= 3
    along = np.cos([lamp.height for lamp in RIG])
    true = np.stack(
        [along * np.cos([lamp.heading for lamp in RIG]), along * np.sin([lamp.heading for lamp in RIG]),
         np.sin([lamp.height for lamp in RIG])], -1,
    )  # fmt: skip
    assert ((found[:, :3] @ true.T).max(1) > np.cos(0.2)).all()
    assert (np.abs(found[:, 3] - 0.22) < 0.1).all()


def test_lamps_are_sought_in_what_was_recorded_whatever_was_edited_since(shaded):
    take, scene = shaded
    gone = without(scene, [take.truth.handles["block_textured"]])
    assert shadows.of_table(gone) == shadows.of_table(scene)


def test_without_shadows_none_are_found():
    assert shadows.lamps(recorded()[1]) == []


@pytest.mark.parametrize(("told_by", "least"), [(shadows.of_table, 0.6), (shadows.lamps, 0.25)])
def test_a_shadow_goes_with_what_casts_it(shaded, told_by, least):
    take, scene = shaded
    instance_id = take.truth.handles["block_textured"]
    gone = without(scene, [instance_id])
    after = shown(shadows.follow(scene, gone, told_by(scene)))
    true = twin.perform(
        "push_button",
        2,
        frames=11,
        look=twin.Look(shadows=True),
        factor="removal",
        target="block_textured",
    )
    left = shown(gone)
    errors = {True: 0.0, False: 0.0}
    for name, view in true.episode.views.items():
        goal = view.rgb(0).astype(float)
        near = (np.abs(goal - take.episode.views[name].rgb(0)) > 8).any(-1)
        near &= view.ids(0) == take.truth.handles["table"]
        for lifted, made in ((True, after), (False, left)):
            errors[lifted] += ((made.views[name].rgb(0) - goal)[near] ** 2).sum()
    assert errors[True] < least * errors[False]


def test_without_lamps_nothing_changes(shaded):
    scene = shaded[1]
    gone = replace(scene, bodies=scene.bodies[:-1])
    assert shadows.follow(scene, gone, []) is gone


def test_a_large_image_of_the_table_is_shaded():
    shade = shadows.Shade(frozenset([1]), (0.0, 0.0), 0.0, np.full((4, 4), 0.5, np.float32))
    count = 2**15 + 3

    class Somewhere:
        points = np.zeros((count, 3), np.float32)

    assert (shade(np.ones((count, 3), np.float32), Somewhere()) == 0.5).all()


def test_a_shadow_lies_on_the_support_and_not_on_its_legs():
    shade = shadows.Shade(frozenset([1]), (0.0, 0.0), 0.7, np.full((4, 4), 0.5, np.float32))

    class TopAndLeg:
        points = np.array([[0.01, 0.01, 0.705], [0.01, 0.01, 0.3]], np.float32)

    assert shade(np.ones((2, 3), np.float32), TopAndLeg())[:, 0].tolist() == [0.5, 1.0]


def test_a_new_shadow_ends_a_pixel_from_its_outline():
    square = 0.1 * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    shadow = shadows.CastShadow(frozenset([1]), 0.7, 0.4, (), (square, square + 0.05))
    away = np.array([-0.05, -0.0011, 0.0, 0.0011, 0.05, 0.075], np.float32)

    class Along:
        points = np.stack([away, away + 0.002 * (away >= 0) + 0.01, 0 * away + 0.7], -1)
        footprint = np.full(len(away), 0.002, np.float32)

    color = np.linspace(0.1, 0.9, 18, dtype=np.float32).reshape(-1, 3)
    after = shadow(color, Along())
    np.testing.assert_array_equal(after[:2], color[:2])  # to the bit
    np.testing.assert_allclose(after[2], 0.8 * color[2], rtol=1e-5)  # half of it lies within
    np.testing.assert_allclose(after[3:], 0.6 * color[3:], rtol=1e-5)  # two outlines are no darker
    stays = shadows.CastShadow(frozenset([1]), 0.7, 0.4, (square,), (square,))
    np.testing.assert_array_equal(stays(color, Along()), color)
