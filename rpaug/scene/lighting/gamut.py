"""The display color that paint of some color shows in a photograph.

No surface returns all light of one channel and none of another, and none is brighter than white in the same light.
"""

import numpy as np
from jaxtyping import Float64

from rpaug.core import color_space, memo, sampling
from rpaug.core.types import Episode
from rpaug.scene.lighting import light

DARKEST, BRIGHTEST = 0.04, 0.85  # share of the light that black and white paints return
WHITE = 0.99  # quantile of pixels' brightness that shows white in this light
DIMMEST = 0.2  # linear: a clip without anything white is not taken to be darker lit
STEPS = 9  # from paint to the pure color, until it goes by the pure color's name

Triple = tuple[float, float, float]


def painted(episode: Episode, color: Triple) -> Triple:
    """What paint of this color shows at its best-lit part, in the light and exposure of the clip.

    In dim light it may look like another color; then it is as much purer as it takes to go by its name.
    """
    pure = np.array(color)
    returned = DARKEST + (BRIGHTEST - DARKEST) * color_space.to_linear(pure)
    shown = np.clip(color_space.from_linear(returned * _white(episode)), 0, 1)
    steps = [shown + share * (pure - shown) for share in np.linspace(0, 1, STEPS)]
    red, green, blue = next(one for one in steps if _alike(pure, one)).tolist()
    return red, green, blue


def _alike(one: Float64[np.ndarray, "3"], other: Float64[np.ndarray, "3"]) -> bool:
    """Would a person call one of two colors by the other's name?"""
    names = color_space.nearest(one), color_space.nearest(other)
    return color_space.means(*names) or color_space.means(*reversed(names))


@memo.of_episode
def _white(episode: Episode, count: int = 3) -> Float64[np.ndarray, "3"]:
    """Linear color of white in the clip's light: how bright by its brightest pixels, of what hue by gray surfaces."""
    bright = [
        np.quantile(rgb.max(-1), WHITE) / 255 for _, _, rgb, _ in sampling.images(episode, count)
    ]
    level = max(float(color_space.to_linear(np.array(max(bright)))), DIMMEST)
    hue = color_space.to_linear(light.estimate(episode))
    return level * hue / max(float(hue.mean()), 1e-6)
