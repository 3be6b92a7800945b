"""The table takes the drawn color and nothing else does."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import BOX, TABLE, scene
from pydantic import TypeAdapter, ValidationError

from rpaug import Scene
from rpaug.operators.table_color import TableColor
from rpaug.pipeline.contracts import OperatorContract, shown


def small() -> Scene:
    recorded = scene({"front": (1.6, 0.3, 1.0), "overhead": (0.1, -0.9, 1.5)}, length=2)
    return replace(recorded, roles={"table": frozenset({TABLE})})


class TestContract(OperatorContract):
    frames = (0, 1)

    def operator(self) -> TableColor:
        return TableColor()

    def scene(self) -> Scene:
        return small()


def test_the_old_albedo_is_swapped_for_one_in_range() -> None:
    recorded = small()
    operator = TableColor(range=((0.3, 0.2, 0.1), (0.3, 0.2, 0.1)), albedo=(0.6, 0.4, 0.4))
    edit = operator.sample(recorded, np.random.default_rng(0))
    assert np.allclose(edit["color"], [0.3, 0.2, 0.1])
    after = shown(operator.apply(recorded, edit))
    for name, view in recorded.episode.views.items():
        ids, before, now = view.ids(0), view.rgb(0).astype(float), after.views[name].rgb(0)
        assert np.array_equal(now[ids == BOX], view.rgb(0)[ids == BOX])
        painted = ids == TABLE
        assert np.abs(now[painted] - before[painted] * [0.5, 0.5, 0.25]).max() <= 1


@pytest.mark.parametrize(("light", "guessed"), [(1.0, 0), (4.0, 1)])
def test_a_table_as_bright_as_can_be_is_said_to_be_guessed(light: float, guessed: int) -> None:
    recorded = small()
    views = {
        name: replace(
            view, rgb=lambda t, rgb=view.rgb: np.minimum(light * rgb(t), 255).astype("u1")
        )
        for name, view in recorded.episode.views.items()
    }
    lit = replace(recorded, episode=replace(recorded.episode, views=views))
    for albedo, count in ((None, guessed), ((0.6, 0.4, 0.4), 0)):
        operator = TableColor(albedo=albedo)
        edit = operator.sample(lit, np.random.default_rng(0))
        (found,) = operator.falls_short(edit).items()
        assert found[1] == (count, 1)
        assert found[0].endswith("is a guess")


def test_colosseums_range_is_the_default_and_is_covered() -> None:
    recorded = small()
    draws = np.array(
        [TableColor().sample(recorded, np.random.default_rng(i))["color"] for i in range(25)]
    )
    assert draws.min() >= 0.25
    assert draws.min() < 0.32
    assert draws.max() > 0.93


def test_a_range_upside_down_is_refused() -> None:
    with pytest.raises(ValidationError, match="exceeds"):
        TypeAdapter(TableColor).validate_python({"range": [[0.5, 0, 0], [0.4, 1, 1]]})
