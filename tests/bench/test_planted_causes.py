"""The bench of planted causes in foreign worlds, without a simulator: what a cause holds, and what reaches it."""

import numpy as np
import pytest

from tools.bench.foreign import diagnosed
from tools.bench.foreign.diagnosed import Plant
from tools.bench.foreign.planted import FACTORS

VALUES = [{"camera": yaw, "object size": size, "table": 1.0} for yaw, size in zip(
    np.linspace(-9, 9, 30), np.linspace(-0.5, 0.5, 30), strict=True)]  # fmt: skip
PLAIN = {
    "object color": "recolor", "object texture": "retexture", "table": "table_texture", "background":
    "background_texture",
}  # fmt: skip


def plants(factor: str) -> list[Plant]:
    return [Plant(VALUES, factor, np.random.default_rng(seed)) for seed in range(20)]


@pytest.mark.parametrize("factor", ["camera", "object size", "table"])
def test_a_range_holds_a_good_part_of_what_was_drawn_on_its_sides(factor: str) -> None:
    for plant in plants(factor):
        mine = [one for one in VALUES if np.sign(one[factor]) in plant.sides]
        held = [one for one in VALUES if plant.holds(one)]
        assert len(held) >= diagnosed.NARROWEST * len(mine) - 1
        assert all(one in mine for one in held)
        assert not plant.holds({})


def test_sides_differ() -> None:
    assert len({plant.sides for plant in plants("object size")}) == 3
    assert {plant.sides for plant in plants("camera")} == {(-1, 1)}


def test_a_turn_reaches_the_middle_or_does_not() -> None:
    plant = plants("camera")[0]
    middle = np.deg2rad((plant.bar + plant.most) / 2)
    edit = {"op": "camera_pose", "camera": "static"}
    assert diagnosed.reached([{**edit, "turn": middle + 0.01}], plant)
    assert not diagnosed.reached([{**edit, "turn": middle - 0.01}], plant)


def test_a_look_alike_is_reached_by_a_look_alike_alone() -> None:
    alike, any_ = (
        Plant([{"distractor": kind}], "distractor", np.random.default_rng(0)) for kind in (2.0, 1.0)
    )
    plain, like = {"op": "distractors"}, {"op": "distractors", "like": "color"}
    assert not diagnosed.reached([plain], alike)
    assert diagnosed.reached([like], alike)
    assert diagnosed.reached([plain], any_)


@pytest.mark.parametrize("factor", PLAIN)
def test_a_surface_is_reached_by_its_own_edit(factor: str) -> None:
    plant = Plant([{factor: 1.0}], factor, np.random.default_rng(0))
    assert diagnosed.reached([{"one_of": [{"op": PLAIN[factor]}, {"op": "remove"}]}], plant)
    assert not diagnosed.reached([{"op": "remove"}], plant)


def test_every_factor_but_a_place_has_an_edit() -> None:
    assert set(diagnosed.REACHES) == set(FACTORS) - {diagnosed.NO_EDIT}
