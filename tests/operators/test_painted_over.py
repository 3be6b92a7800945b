"""What is painted as a whole takes the place of all paint before it, and a part leaves the rest in it."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from analytic import BALL, BOX, scene

from rpaug import Operator, Scene
from rpaug.operators.background_texture import BackgroundTexture
from rpaug.operators.fields import Palette
from rpaug.operators.light_color import LightColor
from rpaug.operators.recolor import AlbedoRatio, Recolor
from rpaug.operators.retexture import Retexture
from rpaug.operators.table_color import TableColor
from rpaug.operators.table_texture import TableTexture
from rpaug.pipeline import copies, gates
from rpaug.pipeline.contracts import shown
from rpaug.pipeline.recipe import build
from rpaug.scene.targets.targets import Target

THING = Target(handle=BOX)
RED, BLUE, GREEN = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.5, 0.0)
WHOLE = {
    "recolor": Recolor(target=THING, color=Palette((RED,))),
    "recolor in lab": Recolor(target=THING, color=Palette((GREEN,)), mode="lab"),
    "retexture": Retexture(target=THING, texture="checker_black"),
    "table_color": TableColor(target=THING),
    "table_texture": TableTexture(target=THING, texture="oak"),
    "background_texture": BackgroundTexture(target=THING, texture="blue"),
}


def recorded() -> Scene:
    return scene({"front": (1.0, -0.9, 0.8)}, length=1)


def after(base: Scene, *operators: Operator) -> Scene:
    for operator in operators:
        base = operator.apply(base, operator.sample(base, np.random.default_rng(0)))
    return base


def image(edited: Scene) -> np.ndarray:
    return shown(edited).views["front"].rgb(0)


@pytest.mark.parametrize(("first", "second"), list(product(WHOLE, WHOLE)))
def test_the_later_paint_shows_as_it_does_alone(first: str, second: str) -> None:
    base = recorded()
    twice = image(after(base, WHOLE[first], WHOLE[second]))
    np.testing.assert_array_equal(twice, image(after(base, WHOLE[second])))


def test_what_is_painted_over_no_part_of_stays_painted() -> None:
    ball = Recolor(target=Target(handle=BALL), color=Palette((GREEN,)))
    both = Recolor(target=Target(handle=[BOX, BALL]), color=Palette((RED,)))
    edited = after(recorded(), both, ball)
    assert [(one.instance_ids, one.new) for one in edited.appearance] == [  # type: ignore[attr-defined]
        (frozenset({BALL}), GREEN),
        (frozenset({BOX}), RED),
    ]


def test_light_falls_on_the_paint_that_is_there_at_last() -> None:
    base = recorded()
    light = LightColor(temperature=(3000.0, 3000.0), brightness=(0.7, 0.7))
    twice = image(after(base, WHOLE["recolor"], light, WHOLE["retexture"]))
    np.testing.assert_array_equal(twice, image(after(base, WHOLE["retexture"], light)))


@pytest.mark.parametrize("first", WHOLE)
def test_a_part_leaves_the_rest_in_the_paint_before_it(first: str) -> None:
    base = two_colors()
    whole, part = WHOLE[first], Recolor(target=THING, color=Palette((BLUE,)), only="red")
    both, ids = image(after(base, whole, part)), base.episode.views["front"].ids(0)  # type: ignore[misc]
    alone, rest = image(after(base, part)), image(after(base, whole))
    mine = (alone != image(base)).any(-1)
    assert 0 < mine.sum() < (ids == BOX).sum()
    np.testing.assert_array_equal(both[mine], alone[mine])
    np.testing.assert_array_equal(both[~mine], rest[~mine])
    np.testing.assert_array_equal(image(after(base, part, whole)), rest)
    color = gates._color(after(base, whole, part))
    assert color is not None
    assert color < 5


def two_colors() -> Scene:
    """The box red on its left and gray on its right."""
    base = recorded()
    view = base.episode.views["front"]
    ids, rgb = view.ids(0), view.rgb(0).copy()  # type: ignore[misc]
    rows, columns = np.nonzero(ids == BOX)
    light = 0.4 + 0.5 * (rows - rows.min()) / np.ptp(rows)
    left = columns < columns.mean()
    rgb[rows, columns] = np.where(left[:, None], (250, 10, 10), (120, 120, 120)) * light[:, None]
    views = {"front": replace(view, rgb=lambda t: rgb)}
    return replace(base, episode=replace(base.episode, views=views))


def test_a_blue_that_came_out_nearly_black_fails_its_gate() -> None:
    base = recorded()
    blue = AlbedoRatio(frozenset({BOX}), (0.92, 0.86, 0.79), BLUE, True)
    assert gates._color(replace(base, appearance=(blue,))) < 5  # type: ignore[operator]
    stacked = replace(
        base, appearance=(replace(blue, new=RED), blue)
    )  # as though red were its old color
    assert image(stacked)[base.episode.views["front"].ids(0) == BOX].max() < 50  # type: ignore[misc]
    assert gates._color(stacked) > 10  # type: ignore[operator]


def test_a_thing_in_the_dark_is_judged_by_the_light_it_is_in() -> None:
    base = recorded()
    view = base.episode.views["front"]
    dim = replace(view, rgb=lambda t: (view.rgb(t) * 0.1).astype(np.uint8))
    dark = replace(base, episode=replace(base.episode, views={"front": dim}))
    blue = AlbedoRatio(frozenset({BOX}), (0.6, 0.6, 0.6), BLUE, True)
    assert gates._color(replace(dark, appearance=(blue,))) < 5  # type: ignore[operator]


def test_two_edits_that_paint_the_same_thing_are_told() -> None:
    target = {"handle": BOX}
    recipe = build(
        {
            "version": 1,
            "edits": [
                {"op": "recolor", "target": {"handle": [BOX, BALL]}, "color": "red"},
                {"op": "recolor", "target": {"handle": BALL}, "color": "green"},
                {"op": "retexture", "target": target, "texture": "oak"},
            ],
        }
    )
    _, draws = copies.draw(recorded(), recipe, 1)
    said = [one.describe().get("painted_over") for one in draws]
    assert said[0] is None
    for number, one in ((1, said[1]), (2, said[2])):
        (words,) = one  # type: ignore[misc]
        assert words.startswith(f"edits.{number} (")
        assert f"takes the place of edits.0 (recolor of handle [{BOX}, {BALL}])" in words
