"""The colour of the light an episode was recorded in, read off its grey surfaces."""

import numpy as np
from jaxtyping import Float64

from rpaug.scene import sampling
from rpaug.types import Episode

LAMP = 0.5  # COLOSSEUM's scenes: each lamp's diffuse colour is (0.5, 0.5, 0.5) before it is varied
GREY = 0.12  # saturation up to which a surface may be taken for grey under coloured light
LEAST_SHARE = 0.02


def estimate(episode: Episode, count: int = 3) -> Float64[np.ndarray, "3"]:
    """The lamps' colour, in COLOSSEUM's unit where white recorded light is (0.5, 0.5, 0.5).

    The median chromaticity of near-grey pixels of middling brightness; robots and walls mostly are. White where
    too few of them are seen. Only the chromaticity is measured: a brightness cannot be told from albedos.
    """
    chroma, total = [], 0
    for _, _, rgb, _ in sampling.images(episode, count):
        colour = rgb.reshape(-1, 3)[::3] / 255.0
        high, low = colour.max(1), colour.min(1)
        grey = (high > 0.2) & (high < 0.97) & (high - low < GREY * high)
        chroma.append(colour[grey] / colour[grey].mean(1, keepdims=True))
        total += len(colour)
    grey_pixels = np.concatenate(chroma)
    if len(grey_pixels) < LEAST_SHARE * total:
        return np.full(3, LAMP)
    middle = np.median(grey_pixels, 0)
    return LAMP * middle / middle.mean()
