"""Sensor effects come last, change images only, and are the same whenever an image is asked for again."""

import json

import numpy as np
import pytest
from analytic import scene
from pydantic import TypeAdapter, ValidationError

from rpaug import Operator, Scene, TargetError
from rpaug.compose import views
from rpaug.operators.sensor_blur import Blur, SensorBlur
from rpaug.operators.sensor_exposure import Exposure, SensorExposure
from rpaug.operators.sensor_jpeg import JPEG, SensorJPEG
from rpaug.operators.sensor_noise import Noise, SensorNoise
from rpaug.pipeline.contracts import OperatorContract, shown

RNG = np.random.default_rng(0)


def small() -> Scene:
    return scene({"front": (1.6, 0.3, 1.0), "overhead": (0.1, -0.9, 1.5)}, length=2)


class TestNoise(OperatorContract):
    frames = (0, 1)

    def operator(self) -> Operator:
        return SensorNoise(read=(0.01, 0.02))

    def scene(self) -> Scene:
        return small()


class TestBlur(TestNoise):
    def operator(self) -> Operator:
        return SensorBlur()


class TestJPEG(TestNoise):
    def operator(self) -> Operator:
        return SensorJPEG()


class TestExposure(TestNoise):
    def operator(self) -> Operator:
        return SensorExposure()


def grey(value: int) -> np.ndarray:
    return np.full((200, 200, 3), value, np.uint8)


@pytest.mark.parametrize("value", [40, 128, 200])
def test_noise_has_the_variance_it_says(value: int) -> None:
    out = Noise(read=0.02, shot=0.001, seed=0)(grey(value), np.random.default_rng(1)) / 255
    assert abs(out.mean() - value / 255) < 1e-3
    assert out.var() == pytest.approx(0.02**2 + 0.001 * value / 255, rel=0.05)


def test_noise_differs_between_cameras_and_frames_but_not_between_calls() -> None:
    recorded, operator = small(), SensorNoise(read=(0.02, 0.02))
    edit = operator.sample(recorded, np.random.default_rng(0))
    after = shown(operator.apply(recorded, edit))

    def noise(name: str, t: int) -> np.ndarray:
        return after.views[name].rgb(t).astype(int) - recorded.episode.views[name].rgb(t)

    assert np.array_equal(noise("front", 0), noise("front", 0))
    pairs = [("front", 0), ("front", 1), ("overhead", 0)]
    effects = operator.apply(recorded, edit).sensor  # cameras of one size: theirs differ
    samples = [views.sense(effects, grey(128), *pair).ravel() for pair in pairs]
    assert np.abs(np.corrcoef(samples) - np.eye(3)).max() < 0.1


def test_moved_cameras_have_the_same_sensor() -> None:
    recorded, operator = small(), SensorExposure(stops=(-1.0, -1.0))
    edit = operator.sample(recorded, np.random.default_rng(0))
    fixed = shown(operator.apply(recorded, edit))
    drawn = shown(operator.apply(recorded, edit), tier=1)
    for name, view in fixed.views.items():
        assert np.array_equal(view.rgb(0), drawn.views[name].rgb(0))


def test_an_exposure_of_one_stop_doubles_the_light() -> None:
    from rpaug.core.color_space import to_linear

    image = RNG.integers(20, 120, (50, 50, 3)).astype(np.uint8)
    brighter = Exposure(1.0)(image, RNG)
    ratio = to_linear(brighter / 255.0) / to_linear(image / 255.0)
    assert np.abs(ratio - 2).max() < 0.15
    assert np.array_equal(Exposure(0.0)(image, RNG), image)


def test_blur_keeps_the_mean_and_flattens() -> None:
    image = RNG.integers(0, 256, (64, 64, 3)).astype(np.uint8)
    out = Blur(1.5)(image, RNG)
    assert abs(out.mean() - image.mean()) < 1
    assert out.std() < 0.4 * image.std()


def test_jpeg_loses_more_at_lower_quality_and_keeps_red_red() -> None:
    image = small().episode.views["front"].rgb(0)
    errors = [np.abs(JPEG(q)(image, RNG).astype(int) - image).mean() for q in (95, 60, 15)]
    assert errors == sorted(errors)
    red = np.zeros((16, 16, 3), np.uint8)
    red[..., 0] = 200
    assert np.abs(JPEG(90)(red, RNG).astype(int) - red).max() < 6


def test_it_happens_in_the_cameras_that_are_named_alone() -> None:
    recorded, operator = small(), SensorExposure(stops=(-1, -1), cameras=("front",))
    after = operator.apply(recorded, operator.sample(recorded, np.random.default_rng(0)))
    views = recorded.episode.views
    assert shown(after).views["front"].rgb(0).mean() < 0.8 * views["front"].rgb(0).mean()
    np.testing.assert_array_equal(shown(after).views["overhead"].rgb(0), views["overhead"].rgb(0))
    with pytest.raises(TargetError, match="no camera is called 'wrist'"):
        SensorNoise(cameras=("wrist",)).sample(recorded, np.random.default_rng(0))


def test_each_camera_may_have_a_draw_of_its_own() -> None:
    recorded, operator = small(), SensorExposure(stops=(-1, 1), gain=(0.9, 1.1), each=True)
    edit = operator.sample(recorded, np.random.default_rng(0))
    assert set(edit["each"]) == {"front", "overhead"}
    assert edit["each"]["front"] != edit["each"]["overhead"]
    after = operator.apply(recorded, json.loads(json.dumps(edit)))
    for name, drawn in edit["each"].items():
        alone = Exposure(**drawn)(recorded.episode.views[name].rgb(0), RNG)
        np.testing.assert_array_equal(shown(after).views[name].rgb(0), alone)


def test_gains_tint_and_gamma_bends_the_middle() -> None:
    white = grey(128)
    red = Exposure(0.0, gains=(1.2, 1.0, 1.0))(white, RNG)
    assert (red[..., 0] > 128).all()
    assert (red[..., 1:] == 128).all()
    assert Exposure(0.0, gamma=1.1)(white, RNG)[0, 0, 0] < 128
    ends = Exposure(0.0, gamma=1.1)(np.array([[[0, 255, 255]]], np.uint8), RNG)
    assert ends.tolist() == [[[0, 255, 255]]]


def test_a_gain_may_be_each_channels_own() -> None:
    cast = SensorExposure(stops=(0, 0), gain=((0.9, 1, 1.1), (0.9, 1, 1.2)))
    red, green, blue = cast.sample(small(), np.random.default_rng(0))["gains"]
    assert (red, green) == (0.9, 1)
    assert 1.1 < blue < 1.2


def test_contrast_leaves_the_middle_and_saturation_the_luma() -> None:
    image = RNG.integers(0, 256, (40, 40, 3)).astype(np.uint8)
    flat = Exposure(0.0, contrast=0.5)(image, RNG).astype(float)
    np.testing.assert_allclose(flat - 127.5, 0.5 * (image - 127.5), atol=1)
    assert np.array_equal(Exposure(0.0, contrast=1.0, saturation=1.0)(image, RNG), image)
    gray = Exposure(0.0, saturation=0.0)(image, RNG)
    assert (gray == gray[..., :1]).all()
    mild = RNG.integers(90, 160, (40, 40, 3)).astype(np.uint8)
    luma = np.array([0.299, 0.587, 0.114])
    vivid = Exposure(0.0, saturation=1.5)(mild, RNG)
    np.testing.assert_allclose(vivid @ luma, mild @ luma, atol=1)
    apart = mild - (mild @ luma)[..., None]
    np.testing.assert_allclose(vivid - (mild @ luma)[..., None], 1.5 * apart, atol=1)
    drawn = SensorExposure(contrast=(0.8, 1.2), saturation=(0.5, 0.5)).draw(
        np.random.default_rng(0)
    )
    assert drawn["saturation"] == 0.5
    assert 0.8 < drawn["contrast"] < 1.2


def test_flicker_puts_each_frame_of_each_camera_off_by_its_own() -> None:
    from rpaug.core.color_space import to_linear

    recorded, operator = small(), SensorExposure(stops=(0, 0), flicker=(0.4, 0.4))
    edit = json.loads(json.dumps(operator.sample(recorded, np.random.default_rng(0))))
    effects = operator.apply(recorded, edit).sensor
    off = {
        (name, t): float(
            np.log2(
                to_linear(views.sense(effects, grey(128), name, t) / 255.0) / to_linear(128 / 255)
            ).mean()
        )
        for name in ("front", "overhead")
        for t in range(40)
    }
    front, overhead = ([off[name, t] for t in range(40)] for name in ("front", "overhead"))
    assert min(len(set(front)), len(set(overhead))) > 15  # of the levels there are
    assert abs(np.corrcoef(front, overhead)[0, 1]) < 0.4
    assert 0.3 < max(off.values()) <= 0.42
    assert -0.42 <= min(off.values()) < -0.3
    assert abs(np.mean(list(off.values()))) < 0.1
    again = views.sense(effects, grey(128), "front", 3)
    assert np.array_equal(again, views.sense(effects, grey(128), "front", 3))
    assert "flicker" not in SensorExposure().sample(recorded, np.random.default_rng(0))


def test_a_smear_spreads_a_point_along_its_direction() -> None:
    point = np.zeros((21, 21, 3), np.uint8)
    point[10, 10] = 250
    out = Blur(sigma=0, length=6, angle=0.0)(point, RNG)[..., 0].astype(int)
    assert out[10].sum() == pytest.approx(250, abs=8)
    assert (np.flatnonzero(out[10]) == np.arange(7, 14)).all()
    assert out[:9].max() == out[12:].max() == 0
    down = Blur(sigma=0, length=6, angle=np.pi / 2)(point, RNG)[..., 0].astype(int)
    np.testing.assert_allclose(down, out.T, atol=1)


@pytest.mark.parametrize(
    ("kind", "fields"),
    [
        (SensorNoise, {"read": [0.2, 0.1]}),
        (SensorNoise, {"shot": [-0.1, 0.1]}),
        (SensorBlur, {"sigma": [-1, 1]}),
        (SensorJPEG, {"quality": [0, 50]}),
        (SensorExposure, {"stops": [1, -1]}),
        (SensorExposure, {"gain": [[1, 1, 1], [1, 0.9, 1]]}),
        (SensorExposure, {"flicker": [-0.1, 0.1]}),
        (SensorExposure, {"contrast": [1.2, 0.8]}),
        (SensorExposure, {"saturation": [0.2, 1]}),
    ],
)
def test_senseless_fields_are_refused(kind: type, fields: dict) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(kind).validate_python(fields)
