"""A fit ends when its rule says so, and no earlier."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpaug.gaussians.stops import Stop, StopCheck

DECIBELS = st.lists(st.floats(10, 50), min_size=1, max_size=12)


def checks(recorded: list[float], held_out: list[float]) -> list[StopCheck]:
    return [
        StopCheck(100 * (i + 1), a, b)
        for i, (a, b) in enumerate(zip(recorded, held_out, strict=True))
    ]


def test_heldout_ends_when_unseen_views_stop_improving() -> None:
    seen, unseen = [20.0, 25, 28, 30, 32, 34], [20.0, 25, 27, 27.02, 26.5, 26.0]
    stop = Stop(patience=3, gain=0.05)
    ends = [stop.reached(checks(seen[:k], unseen[:k])) for k in range(7)]
    assert ends == [False] * 6 + [True]
    assert stop.best(checks(seen, unseen)) == 3


def test_slow_gains_are_gains() -> None:
    rising = [20 + 0.03 * k for k in range(20)]
    stop = Stop(patience=3, gain=0.05)
    assert not any(stop.reached(checks(rising[:k], rising[:k])) for k in range(20))


@given(DECIBELS, st.floats(10, 50))
def test_fidelity_looks_at_the_last_recorded_views_only(found: list[float], target: float) -> None:
    stop = Stop(kind="fidelity", target=target)
    assert stop.reached(checks(found, [0.0] * len(found))) == (found[-1] >= target)


@given(DECIBELS)
def test_the_best_check_is_never_beaten(found: list[float]) -> None:
    past = checks(found, found)
    for kind in ("heldout", "fidelity"):
        assert found[Stop(kind=kind).best(past)] == max(found)


def test_checks_are_due_after_steps_were_made() -> None:
    assert [step for step in range(301) if Stop(every=100).due(step)] == [100, 200, 300]


def test_nothing_checked_has_no_best() -> None:
    assert not Stop(kind="fidelity").reached([])
    with pytest.raises(ValueError, match=r"empty|iterable"):
        Stop().best([])
