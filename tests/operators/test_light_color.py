"""Light that changes color scales every surface alike."""

import numpy as np
import pytest
from analytic import scene
from pydantic import TypeAdapter, ValidationError

from rpaug import Scene
from rpaug.operators.light_color import LightColor
from rpaug.pipeline.contracts import OperatorContract, shown


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


def test_every_pixel_of_every_camera_is_scaled() -> None:
    recorded = small()
    operator = LightColor(range=((0.2, 0.3, 0.1), (0.2, 0.3, 0.1)), recorded=(0.5, 0.5, 0.5))
    after = shown(operator.apply(recorded, operator.sample(recorded, np.random.default_rng(0))))
    for name, view in recorded.episode.views.items():
        wanted = np.rint(view.rgb(1).astype(float) * [0.4, 0.6, 0.2])
        assert np.abs(after.views[name].rgb(1) - wanted).max() <= 1


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
