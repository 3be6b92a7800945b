"""Decoded images that stay for the next copy: all copies of an episode read the same recording."""

import threading
from collections.abc import Callable
from functools import lru_cache

import numpy as np

MOST_BYTES = 96 << 20
"""Of an episode: 125 frames of five cameras of 128x128 with depth and ids take 81 MB."""
KEPT_FRAMES = 8  # of those beyond: a writer compares an edited frame with the recorded one

Image = Callable[[int], np.ndarray]


class HeldImages:
    """The first images that fit into `most` bytes are held for good, since copies ask for all in the same order: of
    the latest none would be there when it is asked for again. What is asked for once only is not held."""

    def __init__(self, most: int = MOST_BYTES) -> None:
        self._left, self._lock = most, threading.Lock()

    def of(self, decode: Image) -> Image:
        """The accessor, which decodes an image once if it can be held."""
        held: dict[int, tuple[np.ndarray, np.dtype]] = {}
        asked: set[int] = set()
        latest = lru_cache(KEPT_FRAMES)(decode)

        def image(t: int) -> np.ndarray:
            if t in held:
                packed, dtype = held[t]
                return packed.astype(dtype, copy=False)
            found = latest(t)
            if t in asked:
                self._hold(held, t, found)
            asked.add(t)
            return found

        return image

    def _hold(
        self, held: dict[int, tuple[np.ndarray, np.dtype]], t: int, image: np.ndarray
    ) -> None:
        packed = _packed(image)
        with self._lock:
            if t not in held and packed.nbytes <= self._left:
                self._left -= packed.nbytes
                held[t] = packed, image.dtype


def _packed(image: np.ndarray) -> np.ndarray:
    """Ids in a byte each where they fit."""
    if image.dtype != np.int32 or image.min(initial=0) < 0 or image.max(initial=0) > 255:
        return image
    return image.astype(np.uint8)
