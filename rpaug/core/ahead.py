"""Calls made ahead by threads: images are decoded beside the work on those before them."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from typing import TypeVar

Made = TypeVar("Made")
MOST = 8  # threads; more wait for memory
BESIDE = "OMP_NUM_THREADS"  # set: a process keeps to so few threads as its libraries do


def cores() -> int:
    """Processor cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_order(calls: Iterable[Callable[[], Made]], threads: int | None = None) -> Iterator[Made]:
    """What the calls return, in their order. As many are under way as there are threads, so that few results wait in
    memory: by default the cores, up to `MOST`, or one in a worker beside others, which the variable tells."""
    count = threads or (1 if BESIDE in os.environ else min(MOST, cores()))
    left = iter(calls)
    with ThreadPoolExecutor(count) as pool:
        under_way: deque[Future[Made]] = deque(pool.submit(call) for call in islice(left, count))
        while under_way:
            made = under_way.popleft().result()
            under_way.extend(pool.submit(call) for call in islice(left, 1))
            yield made
