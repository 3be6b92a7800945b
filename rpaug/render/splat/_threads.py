"""Share one kernel's work between threads that hold no GIL."""

import functools
import itertools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from rpaug.core.ahead import cores

SMALL_IMAGE = 400 * 400  # pixels: up to here a view is one thread's work


@functools.cache
def _pool(process: int) -> ThreadPoolExecutor:
    """One pool for each process: a forked child inherits the object but not its threads."""
    return ThreadPoolExecutor(cores(), thread_name_prefix="rpaug-splat")


def together(job: Callable[..., Any], arguments: list[tuple[Any, ...]]) -> list[Any]:
    """Call `job` once for each tuple of arguments at the same time; results in order."""
    if len(arguments) == 1:
        return [job(*arguments[0])]
    pool = _pool(os.getpid())
    others = [pool.submit(job, *given) for given in arguments[1:]]
    first = job(*arguments[0])
    return [first, *(other.result() for other in others)]


def shared(threads: int, views: int, pixels: int) -> tuple[int, int]:
    """How many views to work on side by side, and threads for each, for images of so many pixels.

    Tile threads wait for each other a few times an image: 2 of them cost 36 % more processor time at 64x64 and
    9 % at 128x128, so small images get a thread each. On large ones they cost nothing, keep to one
    view's arrays in the cache (7 % less at 640x480 with 200 000 Gaussians), and need the memory once.
    """
    if pixels > SMALL_IMAGE:
        return 1, threads
    side_by_side = max(1, min(threads, views))
    return side_by_side, max(1, threads // side_by_side)


def ranges(count: int, parts: int) -> list[tuple[int, int]]:
    """0..count cut into `parts` runs of nearly equal length."""
    cuts = [count * part // parts for part in range(parts + 1)]
    return list(itertools.pairwise(cuts))
