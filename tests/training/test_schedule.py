"""How much of an epoch is augmented: chances, exact ratios, curricula; the same in any process."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpaug import Unsupported
from rpaug.pipeline import recipe
from rpaug.training import Schedule

RECIPE = recipe.build({"version": 1, "seed": 3, "edits": []})


def share(schedule: Schedule, keys: list[str], epoch: int) -> int:
    return sum(schedule.augmented(RECIPE, keys, epoch, i) for i in range(len(keys)))


@given(real=st.integers(0, 5), synthetic=st.integers(0, 5), count=st.integers(1, 40))
def test_a_ratio_is_kept_to_the_item(real: int, synthetic: int, count: int) -> None:
    if real + synthetic == 0:
        return
    keys = [f"episode{n}" for n in range(count)]
    exact = Fraction(synthetic * count, real + synthetic)
    for epoch in range(3):
        found = share(Schedule(ratio=(real, synthetic)), keys, epoch)
        assert abs(found - exact) < 1


def test_a_ratio_takes_other_episodes_each_epoch() -> None:
    keys = [f"episode{n}" for n in range(20)]
    schedule = Schedule(ratio=(1, 1))
    taken = {
        tuple(schedule.augmented(RECIPE, keys, epoch, i) for i in range(20)) for epoch in range(6)
    }
    assert len(taken) == 6


def test_a_chance_takes_other_episodes_each_epoch() -> None:
    keys, schedule = [f"episode{n}" for n in range(20)], Schedule(probability=0.5)
    taken = {
        tuple(schedule.augmented(RECIPE, keys, epoch, i) for i in range(20)) for epoch in range(6)
    }
    assert len(taken) == 6


def test_chances_hold_on_average_and_come_back() -> None:
    keys = [f"episode{n}" for n in range(500)]
    assert 100 < share(Schedule(probability=0.3), keys, 1) < 200
    assert share(Schedule(probability=0.3), keys, 1) == share(Schedule(probability=0.3), keys, 1)
    assert share(Schedule(probability=1.0), keys, 0) == 500
    assert share(Schedule(probability=0.0), keys, 0) == 0


def test_a_curriculum_is_linear_between_its_epochs() -> None:
    schedule = Schedule(probability={10: 0.2, 20: 1.0})
    assert [schedule.chance(e) for e in (0, 10, 15, 20, 99)] == pytest.approx([0.2, 0.2, 0.6, 1, 1])


@pytest.mark.parametrize(
    "given", [{"probability": 1.2}, {"probability": {}}, {"ratio": (0, 0)}, {"ratio": (-1, 2)},
              {"probability": 0.5, "ratio": (1, 1)}],
)  # fmt: skip
def test_impossible_schedules_are_refused(given: dict) -> None:
    with pytest.raises(Unsupported):
        Schedule(**given)
