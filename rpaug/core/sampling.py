"""A few frames that stand for an episode: looked at once, by whatever needs statistics of its pixels."""

from collections.abc import Collection, Iterator

import numpy as np
from jaxtyping import Int32, UInt8

from rpaug.core.types import Episode


def frames(length: int, count: int) -> list[int]:
    """At most `count` frame numbers, evenly spread, first and last among them."""
    return sorted({int(t) for t in np.linspace(0, length - 1, min(count, length)).round()})


def images(
    episode: Episode, count: int
) -> Iterator[tuple[str, int, UInt8[np.ndarray, "h w 3"], Int32[np.ndarray, "h w"] | None]]:
    """Camera name, frame, rgb and ids of `count` frames of every camera."""
    for name, view in episode.views.items():
        for t in frames(episode.length, count):
            yield name, t, view.rgb(t), view.ids(t) if view.ids else None


def spans(numbers: Collection[int]) -> str:
    """Ascending numbers in words, those in a row as one: "3 to 5, 9"."""
    first = [one for one in numbers if one - 1 not in numbers]
    last = [one for one in numbers if one + 1 not in numbers]
    return ", ".join(f"{a} to {b}" if a < b else str(a) for a, b in zip(first, last, strict=True))
