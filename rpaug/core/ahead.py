"""Calls made ahead by threads: images are decoded beside the work on those before them."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from typing import TypeVar

Made = TypeVar("Made")
MOST = 8  # threads; more wait for memory


def in_order(calls: Iterable[Callable[[], Made]], threads: int | None = None) -> Iterator[Made]:
    """What the calls return, in their order. As many are under way as there are threads (by default the cores, up to
    `MOST`), so that few results wait in memory."""
    count = threads or min(MOST, os.cpu_count() or 1)
    left = iter(calls)
    with ThreadPoolExecutor(count) as pool:
        under_way: deque[Future[Made]] = deque(pool.submit(call) for call in islice(left, count))
        while under_way:
            made = under_way.popleft().result()
            under_way.extend(pool.submit(call) for call in islice(left, 1))
            yield made
