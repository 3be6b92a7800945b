"""Colors are named by what they would be in white light."""

import numpy as np
import pytest

import rpaug
from rpaug.core import color_space, white
from rpaug.pipeline import prepare
from rpaug.scene.targets import survey

ORANGE, BLUE = (225, 95, 30), (70, 130, 165)


@pytest.mark.parametrize("light", [(1.0, 1.0, 1.0), (0.5, 0.5, 0.5), (0.6, 0.55, 0.45)])
def test_a_color_is_the_same_in_dim_and_in_tinted_light(light: tuple) -> None:
    rgb = np.full((3, 40, 40, 3), 128, np.uint8)
    rgb[:, :8] = 255
    rgb[:, 10:20, 10:20], rgb[:, 25:35, 25:35] = ORANGE, BLUE
    linear = color_space.to_linear(rgb / 255.0) * np.array(light)
    dim = np.rint(255 * color_space.from_linear(linear)).astype(np.uint8)
    episode = rpaug.Episode.from_arrays(dim)
    for place, color in ((15, ORANGE), (30, BLUE)):
        seen = tuple((dim[0, place, place] / 255.0).tolist())
        found = white.in_white_light(episode, seen)
        assert np.abs(np.array(found) - np.array(color) / 255.0).max() < 0.05


WARM, COOL = (1.0, 0.8, 0.6), (0.87, 0.94, 1.0)


def room(light: tuple[float, float, float], table: tuple[int, int, int]) -> rpaug.Episode:
    """A plate of white china on a table before a dim brown floor, in a lamp's light, with a camera's noise."""
    rgb = np.full((3, 60, 60, 3), (70, 52, 40), float)
    rgb[:, 20:] = table
    rgb[:, 30:50, 20:40] = (225, 225, 222)
    noise = np.random.default_rng(0).normal(0, 2, rgb.shape)
    return rpaug.Episode.from_arrays(np.clip(rgb * light + noise, 0, 255).astype(np.uint8))


@pytest.mark.parametrize("light", [(1.0, 1.0, 1.0), WARM, COOL])
@pytest.mark.parametrize("table", [(150, 105, 60), (40, 90, 40), (90, 140, 220)])
def test_the_brightest_that_a_lamp_may_show_white_tells_its_hue(light: tuple, table: tuple) -> None:
    found = white.hue(room(light, table))
    np.testing.assert_allclose(found, np.array(light) / np.mean(light), atol=0.03)


def test_of_several_bright_hues_white_is_the_one_near_gray() -> None:
    rgb = np.full((1, 60, 60, 3), (70, 52, 40), np.uint8)
    rgb[:, :30] = (185, 211, 216)  # a pale blue sink, as bright as
    rgb[:, 40:] = (212, 204, 196)  # a white counter
    np.testing.assert_allclose(
        white.hue(rpaug.Episode.from_arrays(rgb)), np.array([212, 204, 196]) / 204, atol=0.01
    )


def test_nothing_that_may_be_white_tells_no_hue() -> None:
    rgb = np.full((1, 40, 40, 3), (90, 140, 220), np.uint8)
    rgb[:, :20] = (200, 30, 30)
    assert white.hue(rpaug.Episode.from_arrays(rgb)).tolist() == [1, 1, 1]


def test_what_returns_all_light_is_brighter_than_what_is_white_up_to_what_an_image_holds() -> None:
    dim = room((0.7, 0.56, 0.42), (150, 105, 60))
    assert white.shown(dim).max() == pytest.approx(0.7 * 225 / 255, abs=0.02)
    np.testing.assert_allclose(white.full(dim), white.shown(dim) / 0.9)
    assert white.full(room(WARM, (150, 105, 60))).max() <= 1


def test_what_is_told_by_color_is_named_in_its_own_light() -> None:
    rgb = np.full((6, 48, 48, 3), 90, np.uint8)
    rgb[:, :6] = 140  # white, in this light
    rgb[:, 20:32, 20:32] = (110, 46, 20)  # an orange thing, brown by itself
    found = prepare.found_instances(rpaug.Episode.from_arrays(rgb), ())
    (view,) = found.episode.views.values()
    assert view.ids is not None
    thing = int(view.ids(0)[26, 26])
    assert color_space.nearest(np.array([110, 46, 20]) / 255.0) == "brown"
    assert survey.color_names(found.episode, [thing])[thing] == "orange"
