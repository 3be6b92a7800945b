"""Decoded images of an episode, kept while they are drawn from: each view shows pieces of many."""

import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Protocol, TypeVar

from rpaug.core.types import Episode

MOST_BYTES = 256 << 20  # of decoded images that are kept


class Sized(Protocol):
    """What is kept of a frame: an array, or what says how much its arrays hold."""

    @property
    def nbytes(self) -> int: ...


Kept = TypeVar("Kept", bound=Sized)


def shelved(episode: Episode, most: int = MOST_BYTES) -> Episode:
    """The episode with its decoded images kept, as many of the latest as fit into so many bytes.

    For drawing views from each other's recordings; its accessors are its own, so a writer must not be given them as
    the recorded ones.
    """
    image_cache = _Shelf(most)
    views = {}
    for name, view in episode.views.items():
        views[name] = replace(
            view,
            rgb=partial(image_cache.take, (name, "rgb"), view.rgb),
            depth=view.depth and partial(image_cache.take, (name, "depth"), view.depth),
            ids=view.ids and partial(image_cache.take, (name, "ids"), view.ids),
        )
    return replace(episode, views=views)


def held(made: Callable[[str, int], Kept], most: int = MOST_BYTES) -> Callable[[str, int], Kept]:
    """What is made of a camera's frame, the latest kept that fit into so many bytes."""
    image_cache = _Shelf(most)
    return lambda name, t: image_cache.take((name, "made"), partial(made, name), t)


class _Shelf:
    """Arrays by name and frame, the least recently asked for thrown out first."""

    def __init__(self, most: int) -> None:
        self._most, self._held = most, 0
        self._arrays: OrderedDict[tuple[Any, int], Any] = OrderedDict()
        self._lock = threading.Lock()

    def take(self, name: tuple[str, str], read: Callable[[int], Kept], t: int) -> Kept:
        with self._lock:
            if (name, t) in self._arrays:
                self._arrays.move_to_end((name, t))
                kept: Kept = self._arrays[name, t]
                return kept
        array = read(t)
        with self._lock:
            if (name, t) not in self._arrays:
                self._arrays[name, t] = array
                self._held += array.nbytes
            while self._held > self._most and len(self._arrays) > 1:
                self._held -= self._arrays.popitem(last=False)[1].nbytes
        return array
