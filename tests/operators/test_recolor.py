"""Recoloring against what a truly repainted surface would show."""

import colorsys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from analytic import BALL, scene
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from rpaug import BadRecipe, Scene, TargetError, Unsupported
from rpaug.core import color_space
from rpaug.operators.fields import Color, Palette
from rpaug.operators.recolor import AlbedoRatio, Recolor
from rpaug.pipeline import gates
from rpaug.pipeline.contracts import OperatorContract, shown
from rpaug.scene.lighting import albedo
from rpaug.scene.targets.targets import Target

UNIT = st.floats(0.15, 1.0)
COLOR = st.tuples(UNIT, UNIT, UNIT)
HUE = st.floats(0, 360, exclude_max=True)  # degrees; 360 is 0
MATTE = SimpleNamespace(mirrored=None)


def small() -> Scene:
    return scene({"front": (1.6, 0.3, 1.0), "overhead": (0.1, -0.9, 1.5)}, length=3)


class TestContract(OperatorContract):
    frames = (0, 2)

    def operator(self) -> Recolor:
        return Recolor(target=Target(handle=BALL), color=Palette(((0.0, 0.0, 1.0),)))

    def scene(self) -> Scene:
        return small()


class TestContractOfTheLabMode(TestContract):
    def operator(self) -> Recolor:
        return Recolor(target=Target(handle=BALL), color=Palette(((0.0, 0.0, 1.0),)), mode="lab")


def test_what_was_never_recorded_has_no_color_to_change() -> None:
    recorded = small()
    unseen = replace(recorded.bodies[0], instance_ids=frozenset({999}))
    paint = Recolor(target=Target(handle=999), color=Palette(((0.0, 0.0, 1.0),)))
    with pytest.raises(Unsupported, match="instance 999 cannot be painted: no recorded image"):
        paint.sample(replace(recorded, bodies=(*recorded.bodies, unseen)), np.random.default_rng(0))


def edited(old, new, plain: bool = True):  # type: ignore[no-untyped-def]
    """The repainting as a function of color alone: it does not ask where a pixel lies."""
    ratio = AlbedoRatio(frozenset({1}), tuple(old), tuple(new), plain)
    return lambda color: ratio(color, MATTE)


def test_noise_is_never_scaled_up() -> None:
    rng = np.random.default_rng(0)
    seen = np.array([0.8, 0.4, 0.05]) + rng.normal(0, 0.02, (500, 3))
    painted = edited((0.8, 0.4, 0.05), (0.3, 0.3, 0.8), plain=False)(seen.astype(np.float32))
    assert painted.std(0).max() < 0.03
    np.testing.assert_allclose(painted.mean(0), (0.3, 0.3, 0.8), atol=0.01)


def test_what_a_metal_mirrors_takes_the_new_color_and_a_plastic_keeps_the_lamps() -> None:
    old, new = np.array([0.8, 0.4, 0.1]), np.array([0.2, 0.4, 0.8])
    light, shine = np.float32([[0.3], [0.5]]), np.float32([[0.2], [0.4]])
    seen = SimpleNamespace(mirrored=(shine * old).astype(np.float32))
    metal = AlbedoRatio(frozenset({1}), tuple(old), tuple(new), True, metal=True)
    painted = metal(((light + shine) * old).astype(np.float32), seen)
    np.testing.assert_allclose(painted, (light + shine) * new, atol=1e-6)
    seen = SimpleNamespace(mirrored=shine * np.ones(3, np.float32))
    plastic = AlbedoRatio(frozenset({1}), tuple(old), tuple(new), True)
    painted = plastic((light * old + shine).astype(np.float32), seen)
    np.testing.assert_allclose(painted, light * new + shine, atol=1e-6)


def test_each_part_of_a_thing_of_two_colors_keeps_its_highlight() -> None:
    light = np.linspace(0.2, 0.9, 200)[:, None]
    red, blue, new = np.array([0.9, 0.1, 0.1]), np.array([0.1, 0.2, 0.8]), np.array([0.5, 0.9, 0.7])
    matte = np.concatenate([light * red, light * blue])
    shine = 0.2 * (np.arange(400) % 200 > 180)[:, None]  # where the light is strongest
    found = albedo.estimate(np.clip(matte + shine, 0, 1))
    assert not found.plain
    assert len(found.hues) == 2
    paint = AlbedoRatio(frozenset({1}), (1.0, 1.0, 1.0), tuple(new), False, found.hues)
    out = paint((matte + shine).astype(np.float32), MATTE)
    assert np.abs(out - np.clip(new * matte + shine, 0, 1)).max() < 0.01


def halves(first: tuple[int, ...], second: tuple[int, ...]) -> Scene:
    """The ball half in one color and half in another, light and dark alike."""
    recorded = scene({"front": (1.0, -0.9, 0.8)}, length=1)
    view = recorded.episode.views["front"]
    ids, rgb = view.ids(0), view.rgb(0).copy()
    rows, columns = np.nonzero(ids == BALL)
    light = 0.4 + 0.5 * (rows - rows.min()) / np.ptp(rows)
    left = columns < columns.mean()
    rgb[rows, columns] = np.where(left[:, None], first, second) * light[:, None]
    views = {"front": replace(view, rgb=lambda t: rgb)}
    return replace(recorded, episode=replace(recorded.episode, views=views))


def test_a_part_is_told_by_its_color_and_the_rest_stays() -> None:
    recorded = halves((250, 10, 10), (120, 120, 120))
    paint = Recolor(target=Target(handle=BALL), color=Palette(((0.0, 0.5, 0.0),)), only="red")
    edit = paint.sample(recorded, np.random.default_rng(0))
    after = shown(paint.apply(recorded, edit)).views["front"].rgb(0)
    before = recorded.episode.views["front"].rgb(0)
    red = before[..., 0] > 3.0 * before[..., 1]
    red &= recorded.episode.views["front"].ids(0) == BALL
    assert red.any()
    np.testing.assert_array_equal((after != before).any(-1), red)
    assert (after[red][:, 1] > 2 * after[red][:, 0]).all()
    assert gates._color(paint.apply(recorded, edit)) < 3  # type: ignore[operator]


def test_a_part_that_there_is_not_is_refused_with_what_there_is() -> None:
    recorded = halves((250, 10, 10), (120, 120, 120))
    for only, why in (("blue", "nothing blue; it shows"), ("red", "red all over")):
        here = halves((250, 10, 10), (240, 10, 10)) if "all" in why else recorded
        paint = Recolor(target=Target(handle=BALL), color=Palette(((0.0, 0.5, 0.0),)), only=only)
        with pytest.raises((TargetError, Unsupported), match=why):
            paint.sample(here, np.random.default_rng(0))
    with pytest.raises(BadRecipe, match="no such color word"):
        Recolor(target=Target(handle=BALL), color=Palette(((0.0, 0.5, 0.0),)), only="handle")


@given(HUE, HUE, st.floats(0.2, 1), st.integers(0, 99))
def test_a_color_is_drawn_within_hue_saturation_and_value(
    low: float, high: float, most: float, seed: int
) -> None:
    given = {"hsv": [[low, high], [0.2, most], [0.5, 0.8]]}
    color = TypeAdapter(Color).validate_python(given)
    hue, saturation, value = colorsys.rgb_to_hsv(*color.draw(np.random.default_rng(seed)))
    span = high - low if high >= low else high - low + 360
    assert (360 * hue - low + 1e-6) % 360 <= span + 2e-6
    assert 0.2 - 1e-9 <= saturation <= most + 1e-9
    assert 0.5 - 1e-9 <= value <= 0.8 + 1e-9


def test_ranges_of_color_are_checked() -> None:
    for wrong in ([[0, 400], [0, 1], [0, 1]], [[0, 10], [0.5, 0.2], [0, 1]], [[0, 10], [0, 1]]):
        with pytest.raises(ValidationError):
            TypeAdapter(Color).validate_python({"hsv": wrong})


def test_a_pattern_of_many_colors_has_no_highlights() -> None:
    found = albedo.estimate(np.random.default_rng(0).uniform(0.1, 0.9, (500, 3)))
    assert (found.plain, found.hues) == (False, ())


@given(COLOR, COLOR)
def test_a_shaded_plain_surface_keeps_its_shading(old, new) -> None:  # type: ignore[no-untyped-def]
    shading = np.linspace(0.05, 1, 50)[:, None]
    out = edited(old, new)((shading * old).astype(np.float32))
    assert np.abs(out - shading * new).max() < 2e-3


@pytest.mark.parametrize("plain", [True, False])
def test_pure_red_turns_pure_blue(plain: bool) -> None:
    shading = np.linspace(0, 1, 256)[:, None]
    recorded = np.rint(shading * [255.0, 0, 0]).astype(np.float32) / 255
    out = edited((1, 0, 0), (0, 0, 1), plain)(recorded)
    assert np.abs(out - shading * [0, 0, 1.0]).max() < 3e-3


def test_noise_of_a_dark_channel_is_not_blown_up() -> None:
    rng = np.random.default_rng(0)
    shading = rng.random((4000, 1))
    recorded = (
        np.rint(255 * np.clip(shading * [0.8, 0.02, 0.02] + rng.normal(0, 0.002, (4000, 3)), 0, 1))
        / 255
    )
    out = edited((0.8, 0.02, 0.02), (0.02, 0.02, 0.8))(recorded.astype(np.float32))
    error = out - shading * [0.02, 0.02, 0.8]
    assert -10 * np.log10((error**2).mean()) > 45


def test_a_tint_of_a_texture_multiplies_it() -> None:
    texture = np.random.default_rng(0).uniform(0.2, 1, (500, 3))
    old, new = np.array([1.0, 1.0, 1.0]), np.array([0.4, 0.7, 0.9])
    out = edited(old * 0.9, new * 0.9, plain=False)((texture * old).astype(np.float32))
    assert np.abs(out - texture * new).max() < 1e-5


def test_highlights_of_a_plain_surface_stay_white() -> None:
    diffuse = np.linspace(0.2, 0.8, 40)[:, None] * [0.7, 0.2, 0.1]
    shine = np.linspace(0, 0.25, 40)[:, None]
    out = edited((0.7, 0.2, 0.1), (0.1, 0.2, 0.7))((diffuse + shine).astype(np.float32))
    truth = diffuse[:, ::-1] + shine
    strong = shine[:, 0] > 0.06
    assert np.abs(out - truth)[strong].max() < 0.01


def test_black_and_empty_do_not_divide_by_zero() -> None:
    black = edited((0, 0, 0), (1, 0, 0))(np.zeros((4, 3), np.float32))
    assert np.isfinite(black).all()
    assert edited((1, 0, 0), (0, 1, 0))(np.zeros((0, 3), np.float32)).shape == (0, 3)


def test_all_cameras_and_frames_share_one_draw() -> None:
    recorded = small()
    operator = Recolor(target=Target(handle=BALL), color=Palette(((0, 0, 1), (0, 1, 0), (1, 0, 0))))
    edit = operator.sample(recorded, np.random.default_rng(5))
    after = shown(operator.apply(recorded, edit))
    channel = int(np.argmax(edit["color"]))
    for view in after.views.values():
        for t in range(3):
            ball = view.rgb(t)[view.ids(t) == BALL]
            assert (ball.argmax(1) == channel).all()


def test_a_target_that_is_not_there_is_an_error_that_lists_what_is() -> None:
    operator = Recolor(target=Target(handle=4711), color=Palette(((0, 0, 1),)))
    with pytest.raises(TargetError, match=f"4711.*{BALL}"):
        operator.sample(small(), np.random.default_rng(0))


@given(seed=st.integers(0, 999), taken=st.sampled_from(sorted(color_space.RLBENCH)))
def test_no_color_is_drawn_that_shading_alone_tells_from_another_things(
    seed: int, taken: str
) -> None:
    palette = Palette(tuple(color_space.RLBENCH.values()))
    other = np.array(color_space.RLBENCH[taken])
    drawn = np.array(palette.draw(np.random.default_rng(seed), [tuple(other.tolist())]))
    assert drawn @ other <= 0.95 * np.linalg.norm(drawn) * np.linalg.norm(other)


def test_two_things_of_one_copy_are_told_apart_by_color() -> None:
    recorded, rng = small(), np.random.default_rng(0)
    lime, green, red = (color_space.RLBENCH[name] for name in ("lime", "green", "red"))
    other = AlbedoRatio(frozenset([BALL + 1]), lime, lime, True)
    painted = replace(recorded, appearance=(other,))
    operator = Recolor(target=Target(handle=BALL), color=Palette((green, red)))
    assert all(operator.sample(painted, rng)["color"] == list(red) for _ in range(8))
    assert Palette((green,)).draw(rng, [lime]) == list(green)  # what was asked for by name stays


def test_known_highlights_of_grey_surfaces_stay_and_unknown_ones_go_by_hue() -> None:
    grey, blue = (0.5, 0.5, 0.5), (0.1, 0.2, 0.8)
    color = np.array([[0.7, 0.7, 0.7], [0.7, 0.7, 0.7]], np.float32)
    mirrored = np.array([[0.2, 0.2, 0.2], [np.nan] * 3], np.float32)
    paint = AlbedoRatio(frozenset({1}), grey, blue, True)
    known, unknown = paint(color, SimpleNamespace(mirrored=mirrored))  # type: ignore[arg-type]
    np.testing.assert_allclose(known, np.add(blue, 0.2), atol=1e-5)
    np.testing.assert_allclose(unknown, np.multiply(blue, 1.4).clip(0, 1), atol=1e-5)


def painted_slowly(color: np.ndarray, old: np.ndarray, new: np.ndarray, plain: bool) -> np.ndarray:
    """The formulas as they are written, in float64; not a number where noise and highlight are hard to tell apart."""
    color, old, new = (one.astype(np.float64) for one in (color, old, new))
    a, b = old @ old, old.sum()
    shine, edge = np.zeros((len(color), 1)), np.zeros(len(color), bool)
    if plain and 3 * a - b * b > 0.05 * 3 * a:
        part = np.minimum((a * color.sum(1) - b * color @ old) / (3 * a - b * b), color.min(1))
        shine = np.where(part > albedo.HIGHLIGHT, part, 0)[:, None]
        edge = np.abs(part - albedo.HIGHLIGHT) < 1e-5
    matte = color - shine
    shading = (matte @ old / max(a, 1e-6))[:, None]
    gain = np.minimum(new / np.maximum(old, 1e-6), 1)
    made = np.clip(shading * new + gain * (matte - shading * old) + shine, 0, 1)
    return np.where(edge[:, None], np.nan, made)


@given(seed=st.integers(0, 2**32 - 1), plain=st.booleans())
@settings(deadline=None)
def test_colors_are_painted_as_the_formulas_read(seed: int, plain: bool) -> None:
    rng = np.random.default_rng(seed)
    old, new = rng.random((2, 3)).round(3)
    color = (old * rng.random((50, 1)) + 0.3 * rng.random((50, 3))).clip(0, 1).astype(np.float32)
    edit = AlbedoRatio(frozenset([1]), tuple(old), tuple(new), plain)
    made = edit(color, SimpleNamespace(mirrored=None))  # type: ignore[arg-type]
    expected = painted_slowly(color, old, new, plain)
    told = ~np.isnan(expected)
    assert told.sum() > 100
    assert np.abs(made - expected)[told].max() < 1e-5
