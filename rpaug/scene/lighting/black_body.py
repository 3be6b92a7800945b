"""The colors that lamps and daylight have: a black body's, by its temperature."""

import numpy as np
from jaxtyping import Float64

from rpaug.core import color_space

COLDEST, HOTTEST = 1667.0, 25_000.0  # kelvin that the splines hold for
# Kim et al. (2002), "Design of Advanced Color Temperature Control System for HDTV Applications": x by powers of
# 1000 / T below and from 4000 K, y by powers of x below 2222, below 4000 and from 4000 K; highest power first.
X_WARM, X_COOL = (
    (-0.2661239, -0.2343589, 0.8776956, 0.179910),
    (-3.0258469, 2.1070379, 0.2226347, 0.240390),
)
Y_WARMEST = -1.1063814, -1.34811020, 2.18555832, -0.20219683
Y_WARM = -0.9549476, -1.37418593, 2.09137015, -0.16748867
Y_COOL = 3.0817580, -5.87338670, 3.75112997, -0.37001483
# CIE XYZ to linear sRGB (IEC 61966-2-1).
TO_RGB = np.array(
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
)


def hue(kelvin: float) -> Float64[np.ndarray, "3"]:
    """What white shows under a black body of 1667 to 25,000 K, in display sRGB of mean 1; about grey at 6500."""
    x = float(np.polyval(X_WARM if kelvin < 4000 else X_COOL, 1000 / kelvin))
    y = float(np.polyval(Y_WARMEST if kelvin < 2222 else Y_WARM if kelvin < 4000 else Y_COOL, x))
    linear = np.maximum(TO_RGB @ np.array([x / y, 1.0, (1 - x - y) / y]), 0.0)
    shown = color_space.from_linear(linear / linear.max())
    return np.asarray(shown / shown.mean())
