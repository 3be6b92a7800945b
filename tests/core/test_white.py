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
