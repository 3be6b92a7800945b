"""Light that changes color scales every surface alike."""

import numpy as np
import pytest
from analytic import scene, seen_by
from pydantic import TypeAdapter, ValidationError
from rgb_only_tables import episode

from rpaug import Scene
from rpaug.operators.light_color import LightColor, _scaled
from rpaug.pipeline.contracts import OperatorContract, shown
from rpaug.scene.build import build
from rpaug.scene.lighting import black_body


def small() -> Scene:
    return scene({"front": (1.6, 0.3, 1.0), "overhead": (0.1, -0.9, 1.5)}, length=2)


class TestContract(OperatorContract):
    frames = (0, 1)

    def operator(self) -> LightColor:
        return LightColor()

    def scene(self) -> Scene:
        return small()


def test_the_gain_is_new_over_recorded_plus_what_stays() -> None:
    operator = LightColor(
        range=((0.2, 0.3, 0.4), (0.2, 0.3, 0.4)), recorded=(0.4, 0.5, 0.5), ambient=0.5
    )
    edit = operator.sample(small(), np.random.default_rng(0))
    assert np.allclose(edit["gain"], [0.75, 0.8, 0.9])


def test_lights_that_are_held_back_from_white_are_told() -> None:
    gray = (0.5, 0.5, 0.5)
    bright = LightColor(brightness=(3.5, 3.9), recorded=gray)
    edit = bright.sample(small(), np.random.default_rng(0))
    assert edit["held_back"] < 0.95
    assert max(edit["gain"]) < 3.5
    assert list(bright.falls_short(edit).values()) == [(1, 1)]
    dim = LightColor(brightness=(0.3, 0.5), recorded=gray)
    edit = dim.sample(small(), np.random.default_rng(0))
    assert "held_back" not in edit
    assert list(dim.falls_short(edit).values()) == [(0, 1)]


def test_a_lamp_is_as_warm_and_as_bright_as_asked() -> None:
    gray = (0.5, 0.5, 0.5)
    operator = LightColor(temperature=(2700, 3500), brightness=(0.6, 0.8), recorded=gray)
    gains = np.array(
        [operator.sample(small(), np.random.default_rng(n))["gain"] for n in range(20)]
    )
    least, most = gains.mean(1).min(), gains.mean(1).max()
    assert 0.6 <= least < 0.65 < 0.75 < most <= 0.8
    red, blue = gains[:, 0] / gains[:, 1], gains[:, 2] / gains[:, 1]
    warmest, coolest = black_body.hue(2700), black_body.hue(3500)
    assert (red > coolest[0] / coolest[1] - 1e-9).all()
    assert (red < warmest[0] / warmest[1] + 1e-9).all()
    assert (blue < 0.8).all()


def test_a_drawn_lamp_cuts_no_white_off_and_an_exact_one_may() -> None:
    drawn = LightColor(temperature=(3500, 9000), brightness=(2.0, 4.0))
    recorded = small()
    for seed in range(5):
        edit = drawn.sample(recorded, np.random.default_rng(seed))
        for view in recorded.episode.views.values():
            brightest = np.quantile(view.rgb(0).max(-1), 0.99)
            assert max(edit["gain"]) * brightest <= 256
    exact = LightColor(brightness=(3.0, 3.0)).sample(recorded, np.random.default_rng(0))
    assert np.allclose(exact["gain"], 3)


def test_brightness_alone_keeps_the_tint() -> None:
    operator = LightColor(brightness=(0.5, 0.5), recorded=(0.5, 0.4, 0.3))
    assert np.allclose(operator.sample(small(), np.random.default_rng(0))["gain"], 0.5)


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({"temperature": (5000, 3000)}, "low 5000 exceeds high 3000"),
        ({"temperature": (0.3, 0.5)}, "greater than or equal to 1667"),
        ({"brightness": (1.0, 0.5)}, "low 1 exceeds high 0.5"),
        ({"brightness": (0.5, 1.0), "range": ((0.1,) * 3, (0.2,) * 3)}, "leave out either"),
    ],
)
def test_light_that_no_lamp_has_is_refused(fields: dict[str, object], why: str) -> None:
    with pytest.raises(ValidationError, match=why):
        TypeAdapter(LightColor).validate_python(fields)


def test_every_pixel_of_every_camera_is_scaled() -> None:
    recorded = small()
    operator = LightColor(range=((0.2, 0.3, 0.1), (0.2, 0.3, 0.1)), recorded=(0.5, 0.5, 0.5))
    after = shown(operator.apply(recorded, operator.sample(recorded, np.random.default_rng(0))))
    for name, view in recorded.episode.views.items():
        wanted = np.rint(view.rgb(1).astype(float) * [0.4, 0.6, 0.2])
        assert np.abs(after.views[name].rgb(1) - wanted).max() <= 1


def under_sky(tilt: float) -> Scene:
    """With a gray backdrop that is no instance at the far plane, or bent by `tilt` metres a row like a wall."""

    def above(name, t, rgb, depth, ids):  # type: ignore[no-untyped-def]
        rgb[ids == 0] = 120
        far = 10.0 + tilt * np.arange(len(depth), dtype=np.float32)[:, None] + 0 * depth
        return rgb, np.where(ids == 0, far, depth).astype(np.float32), ids

    return seen_by(small(), above)


def test_no_lamp_lights_the_sky_but_a_wall_without_a_name() -> None:
    operator = LightColor(range=((0.2, 0.3, 0.1), (0.2, 0.3, 0.1)), recorded=(0.5, 0.5, 0.5))
    for tilt, wanted in ((0.0, [120, 120, 120]), (0.01, [48, 72, 24])):
        recorded = under_sky(tilt)
        after = shown(operator.apply(recorded, operator.sample(recorded, np.random.default_rng(0))))
        for name, view in recorded.episode.views.items():
            sky = view.ids(1) == 0
            assert sky.any()
            assert (after.views[name].rgb(1)[sky] == wanted).all()
            assert (after.views[name].rgb(1)[~sky] != view.rgb(1)[~sky]).any()


def test_draws_stay_in_range_and_cover_it() -> None:
    recorded, operator = small(), LightColor(recorded=(0.5, 0.5, 0.5))
    draws = np.array(
        [operator.sample(recorded, np.random.default_rng(i))["color"] for i in range(300)]
    )
    assert draws.min() >= 0
    assert draws.max() <= 0.5
    assert np.abs(draws.mean(0) - 0.25).max() < 0.03


@pytest.mark.parametrize(
    "fields",
    [
        {"range": [[0.5, 0, 0], [0.4, 1, 1]]},
        {"range": [[0, 0, 0], [1.5, 1, 1]]},
        {"recorded": [0, 0.5, 0.5]},
        {"recorded": "guess"},
        {"ambient": 1.5},
    ],
)
def test_senseless_fields_are_refused(fields: dict) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(LightColor).validate_python(fields)


def test_photographs_get_brighter_as_often_as_darker_and_keep_their_whites() -> None:
    photographed = build(episode(), with_bodies=True)
    operator = LightColor(range=((0.36, 0.36, 0.33), (0.5, 0.5, 0.5)))
    drawn = [operator.sample(photographed, np.random.default_rng(seed)) for seed in range(40)]
    bright = np.array([np.mean(edit["gain"]) for edit in drawn])
    assert 0.3 < (bright > 1).mean() < 0.7
    brightest = max(drawn, key=lambda edit: max(edit["gain"]))
    after = shown(operator.apply(photographed, brightest)).views["image_0"].rgb(0)
    assert (after == 255).any(-1).mean() < 0.01
    exact = LightColor(range=((0.25, 0.25, 0.25), (0.25, 0.25, 0.25)), recorded=(0.5, 0.5, 0.5))
    assert exact.sample(photographed, np.random.default_rng(0))["gain"] == [0.5, 0.5, 0.5]


def test_a_gain_is_its_product_up_to_white():
    color = np.random.default_rng(0).random((500, 3), np.float32)
    gain = np.array([0.7, 1.0, 1.9], np.float32)
    np.testing.assert_array_equal(_scaled(color, gain), np.minimum(color * gain, np.float32(1)))
