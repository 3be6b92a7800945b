"""What white looks like in a clip, and what its colors would look like in white light: people name colors by that."""

import numpy as np
from jaxtyping import Float64

from rpaug.core import color_space, memo, sampling
from rpaug.core.types import Episode

COUNT = 3  # frames of each camera that are looked at
GREY = 0.12  # saturation up to which a surface may be taken for grey under colored light
LEAST_SHARE = 0.02  # of the pixels: fewer grey ones tell no hue
WHITE = 0.99  # quantile of pixels' brightness that shows white in this light
DIMMEST = 0.2  # linear: a clip without anything white is not taken to be darker lit

Triple = tuple[float, float, float]


@memo.last
def hue(episode: Episode) -> Float64[np.ndarray, "3"]:
    """The hue of white in the clip's light, in display sRGB of mean 1.

    The median chromaticity of near-grey pixels of middling brightness; robots and walls mostly are. White where
    too few of them are seen.
    """
    chroma, total = [], 0
    for _, _, rgb, _ in sampling.images(episode, COUNT):
        color = rgb.reshape(-1, 3)[::3] / 255.0
        high, low = color.max(1), color.min(1)
        grey = (high > 0.2) & (high < 0.97) & (high - low < GREY * high)
        chroma.append(color[grey] / color[grey].mean(1, keepdims=True))
        total += len(color)
    grey_pixels = np.concatenate(chroma)
    if len(grey_pixels) < LEAST_SHARE * total:
        return np.ones(3)
    middle = np.median(grey_pixels, 0)
    return np.asarray(middle / middle.mean())


@memo.of_episode
def shown(episode: Episode) -> Float64[np.ndarray, "3"]:
    """Linear color of white in the clip's light: how bright by its brightest pixels, of what hue by gray surfaces."""
    bright = [
        np.quantile(rgb.max(-1), WHITE) / 255 for _, _, rgb, _ in sampling.images(episode, COUNT)
    ]
    level = max(float(color_space.to_linear(np.array(max(bright)))), DIMMEST)
    tint = color_space.to_linear(hue(episode) / 2)
    return level * tint / max(float(tint.mean()), 1e-6)


def in_white_light(episode: Episode, color: Triple) -> Triple:
    """What shows so in the clip, as it would in light in which white is the display's (von Kries)."""
    lit = color_space.to_linear(np.array(color)) / shown(episode)
    red, green, blue = np.clip(color_space.from_linear(lit), 0, 1).tolist()
    return red, green, blue
