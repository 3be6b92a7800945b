"""Connected patches of one color name in an image."""

from functools import cache

import cv2
import numpy as np
from jaxtyping import Int32, UInt8

from rpaug.core import color_space
from rpaug.core.pixels import filled

LEVELS = 16  # of each color channel, in the table of names
LEAST = 0.002  # share of an image: smaller patches belong to what is around them
BLUR = 5  # pixels: a median that noise does not outlive


@cache
def _palette() -> np.ndarray:
    """The number of the name of each coarse color."""
    steps = (np.arange(LEVELS) + 0.5) / LEVELS
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
    named = [color_space.nearest(color) for color in grid]
    order = sorted(set(named))
    return np.array([order.index(name) for name in named]).reshape((LEVELS,) * 3)


def named(rgb: UInt8[np.ndarray, "h w 3"]) -> np.ndarray:
    coarse = cv2.medianBlur(rgb, BLUR) // (256 // LEVELS)
    return _palette()[coarse[..., 0], coarse[..., 1], coarse[..., 2]]


def patches(rgb: UInt8[np.ndarray, "h w 3"]) -> Int32[np.ndarray, "h w"]:
    """Connected patches of one color name, numbered; small ones go to what surrounds them."""
    called = named(rgb)
    out, count = np.zeros(called.shape, np.int32), 0
    for name in np.unique(called):
        number, parts = cv2.connectedComponents((called == name).astype(np.uint8), connectivity=4)
        out[parts > 0] = parts[parts > 0] + count
        count += number - 1
    sizes = np.bincount(out.ravel(), minlength=count + 1)
    small = sizes[out] < LEAST * out.size
    if small.any() and not small.all():
        out = filled(out, ~small, window=3)  # by the nearest pixel of a patch that is large enough
    return np.unique(out, return_inverse=True)[1].reshape(out.shape).astype(np.int32)
