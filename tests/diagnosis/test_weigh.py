"""What explains failures comes first, what goes along with it does not, and chance is told from cause."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from rpaug.diagnosis import weigh
from rpaug.diagnosis.measure import Table
from rpaug.diagnosis.messages import FACTORS, KEPT, Factor
from rpaug.diagnosis.sight import NUMBERS

COUNT = 60


def table(failed: np.ndarray, away: Mapping[Factor, np.ndarray], usual: float = 0.5) -> Table:
    numbers = {name: np.tile(far[:, None], (1, len(NUMBERS[name]))) for name, far in away.items()}
    near = {name: np.full(10, usual) for name in away}
    return Table(tuple(map(str, range(len(failed)))), failed, away, numbers, near)


def drawn(rng: np.random.Generator, share: float = 0.3) -> dict[Factor, np.ndarray]:
    """Distances: each factor is far off in a share of the rollouts."""
    return {
        name: np.where(
            rng.random(COUNT) < share, rng.uniform(5, 20, COUNT), rng.uniform(0, 1.5, COUNT)
        )
        for name in FACTORS[:-1]
    }


@pytest.mark.parametrize("cause", FACTORS[:-1])
def test_the_cause_comes_first(cause: Factor) -> None:
    rng = np.random.default_rng(FACTORS.index(cause))
    away = drawn(rng)
    failed = (away[cause] > 4) & (rng.random(COUNT) < 0.9)
    first = weigh.ranked(table(failed, away))[0]
    assert first.factor == cause
    assert first.confidence > KEPT
    assert first.exposed > 0.7 > first.spared
    assert first.effect > 0.5


def test_two_causes_come_first_and_what_goes_along_does_not() -> None:
    rng = np.random.default_rng(3)
    away = drawn(rng)
    away["object color"] = away["table"] * 0.5 + rng.normal(0, 2.0, COUNT)  # goes along
    failed = (away["table"] > 4) | (away["camera"] > 4)
    found = weigh.ranked(table(failed, away))
    assert {found[0].factor, found[1].factor} == {"table", "camera"}
    assert found[2].confidence <= KEPT


def test_chance_is_no_cause() -> None:
    kept = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        found = weigh.ranked(table(rng.random(COUNT) < 0.3, drawn(rng)), seed)
        kept += found[0].confidence > KEPT
    assert kept <= 3  # p < 0.026: a half is expected; 4 or more would happen once in 600 times


def test_confidence_is_what_a_p_value_says_at_most() -> None:
    """Sellke, Bayarri and Berger (2001), table 1: p = 0.05 leaves 0.289, 0.01 0.111, 0.001 0.0184 for chance."""
    for p, chance in ((0.05, 0.289), (0.01, 0.111), (0.001, 0.0184)):
        assert 1 - weigh.surely(p) == pytest.approx(chance, abs=0.001)
    assert weigh.surely(0.026) == pytest.approx(KEPT, abs=0.01)
    assert weigh.surely(0.4) == weigh.surely(1.0) == 0


def test_recordings_stand_in_where_nothing_succeeded() -> None:
    away = {name: np.full(COUNT, 0.5) for name in FACTORS[:-1]}
    away["lighting"] = np.full(COUNT, 12.0)
    found = weigh.ranked(table(np.ones(COUNT, bool), away))
    assert (found[0].factor, found[0].confidence > KEPT) == ("lighting", True)


def test_a_factor_that_protects_is_no_cause() -> None:
    rng = np.random.default_rng(0)
    away = {"table": np.where(np.arange(COUNT) % 2, 10.0, 0.5)}
    failed = (np.arange(COUNT) % 2 == 0) | (rng.random(COUNT) < 0.1)
    assert weigh.ranked(table(failed, away))[0].confidence < KEPT  # type: ignore[arg-type]


def test_what_was_not_measured_is_within() -> None:
    away = {"table": np.where(np.arange(COUNT) < 30, np.nan, 0.3)}
    found = weigh.ranked(table(np.arange(COUNT) < 30, away))  # type: ignore[arg-type]
    assert found[0].confidence < KEPT


def test_delta_is_a_chance_less_its_opposite() -> None:
    assert weigh.delta([3, 4], [1, 2]) == 1
    assert weigh.delta([1, 2], [1, 2]) == 0
    assert weigh.delta([1.0, np.nan], [2.0]) == -1
    assert weigh.delta([], [1]) == 0


def test_spans_are_of_the_failures_that_the_cause_explains() -> None:
    rng = np.random.default_rng(5)
    away = drawn(rng)
    failed = away["camera"] > 4
    plain = {name: np.where(far > 4, 0.2, 0.0)[:, None] for name, far in away.items()}
    made = replace(table(failed, away), plain=plain)
    first = weigh.ranked(made)[0]
    ((low, high),) = weigh.spans(first, made)
    assert low == high == 0.2
    assert weigh.spans(first, table(failed, away)) == ()
