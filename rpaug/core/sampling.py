"""A few frames that stand for an episode: looked at once, by whatever needs statistics of its pixels."""

from collections.abc import Iterator

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
