"""Calls made ahead come back in their order, and few at a time."""

import threading
import time

import pytest

from rpaug.core.ahead import in_order


@pytest.mark.parametrize("threads", [1, 3, None])
def test_results_come_in_the_order_of_the_calls(threads: int | None) -> None:
    def call(n: int) -> int:
        time.sleep(0.002 * (n % 3))
        return n

    assert list(in_order((lambda n=n: call(n) for n in range(20)), threads)) == list(range(20))
    assert list(in_order([], threads)) == []


def test_few_are_under_way_at_once() -> None:
    begun, lock = [], threading.Lock()

    def call(n: int) -> int:
        with lock:
            begun.append(n)
        return n

    results = in_order((lambda n=n: call(n) for n in range(50)), 4)
    assert [next(results) for _ in range(5)] == [0, 1, 2, 3, 4]
    time.sleep(0.05)
    assert len(begun) <= 9
    results.close()


def test_a_failure_is_raised_where_its_result_is_asked_for() -> None:
    results = in_order([lambda: 1, lambda: 1 // 0, lambda: 2], 2)
    assert next(results) == 1
    with pytest.raises(ZeroDivisionError):
        next(results)
