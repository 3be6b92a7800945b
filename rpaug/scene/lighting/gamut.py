"""The display color that paint of some color shows in a photograph.

No surface returns all light of one channel and none of another, and none is brighter than white in the same light.
"""

import numpy as np
from jaxtyping import Float64

from rpaug.core import color_space, white
from rpaug.core.types import Episode
from rpaug.core.white import Triple

DARKEST, BRIGHTEST = 0.04, 0.85  # share of the light that black and white paints return
STEPS = 9  # from paint to the pure color, until it goes by the pure color's name


def painted(episode: Episode, color: Triple) -> Triple:
    """What paint of this color shows at its best-lit part, in the light and exposure of the clip.

    In dim light it may look like another color; then it is as much purer as it takes to go by its name.
    """
    pure = np.array(color)
    returned = DARKEST + (BRIGHTEST - DARKEST) * color_space.to_linear(pure)
    lit = color_space.to_linear(white.shown(episode))
    shown = np.clip(color_space.from_linear(returned * lit), 0, 1)
    steps = [shown + share * (pure - shown) for share in np.linspace(0, 1, STEPS)]
    red, green, blue = next(one for one in steps if _alike(pure, one)).tolist()
    return red, green, blue


def _alike(one: Float64[np.ndarray, "3"], other: Float64[np.ndarray, "3"]) -> bool:
    """Would a person call one of two colors by the other's name?"""
    names = color_space.nearest(one), color_space.nearest(other)
    return color_space.means(*names) or color_space.means(*reversed(names))
