"""Images of made worlds, cast once for all tests that ask for the same ones."""

import pickle
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Any

import numpy as np

KEPT = 2048  # of a world's images in one process, some 50 kB each


def cast_once(cast: Callable[..., tuple[np.ndarray, ...]]) -> Callable[..., tuple[np.ndarray, ...]]:
    """Remember what a function made of arguments of the same content. Whoever asks gets arrays of their own."""

    @lru_cache(KEPT)
    def known(packed: bytes) -> tuple[np.ndarray, ...]:
        given, named = pickle.loads(packed)  # noqa: S301 - packed below
        return cast(*given, **named)

    @wraps(cast)
    def remembered(*given: Any, **named: Any) -> tuple[np.ndarray, ...]:
        return tuple(image.copy() for image in known(pickle.dumps((given, named))))

    return remembered
