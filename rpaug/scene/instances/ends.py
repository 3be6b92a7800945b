"""How a still camera's place looks before and after the robot worked there, wherever the robot left it to be seen."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, UInt8

from rpaug.scene.instances.watched import Watched

PART = 0.4  # share of the frames, from the first or from the last, that count as one end
SEEN = 3  # frames of an end, the outermost that show a pixel, that its color is the median of
LEAST = 2  # of them that a pixel must be seen in to be known


@dataclass(frozen=True)
class End:
    """The colors at one end of a recording, and where they are known."""

    image: UInt8[np.ndarray, "h w 3"]
    known: Bool[np.ndarray, "h w"]


def of(watched: Watched, mobile: frozenset[int]) -> tuple[End, End]:
    """The first and the last look of a camera's place, the robot's tints left out."""
    count = len(watched.shown)
    part = max(SEEN, round(PART * count))
    free = ~np.isin(watched.labels, list(mobile))
    first = _end(watched.shown[:part], free[:part])
    return first, _end(watched.shown[count - part :][::-1], free[count - part :][::-1])


def _end(shown: UInt8[np.ndarray, "t h w 3"], free: Bool[np.ndarray, "t h w"]) -> End:
    taken = free & (np.cumsum(free, 0) <= SEEN)
    colors = np.ma.masked_array(shown, ~np.repeat(taken[..., None], 3, -1))
    image = np.ma.median(colors, axis=0).filled(0).astype(np.uint8)
    return End(image, taken.sum(0) >= LEAST)
