"""Light beyond white: what it came to before it was cut off, and where edits that scale it bring it.

A display ends at white. Lamps that give more than that are cut off before a surface's picture is laid under them, as
OpenGL does it: a red of 0.9 under twice the light was recorded as 1, and would be 0.9 again under half of it, where the
recorded pixel gives 0.5. Where a simulator told the radiance, edits that scale light or albedo scale that.
"""

import numpy as np
from jaxtyping import Float32, Int

from rpaug.core.types import Appearance, Surface


class Headroom:
    """The radiance of an image over its color, and how bright each channel can get, by flat index of the pixels.

    What was cut off gets no brighter than it was recorded: there the surface's picture was seen under full light.
    """

    def __init__(
        self, color: Float32[np.ndarray, "h w 3"], radiance: Float32[np.ndarray, "h w 3"]
    ) -> None:
        color, radiance = color.reshape(-1, 3), radiance.reshape(-1, 3)
        self.over = np.maximum(radiance / np.maximum(color, np.float32(1 / 255)), np.float32(1))
        self.most = np.where(self.over > 1, color, np.float32(1))

    def edited(
        self,
        edit: Appearance,
        color: Float32[np.ndarray, "n 3"],
        surface: Surface,
        at: Int[np.ndarray, "n"],
        keep: bool,
    ) -> Float32[np.ndarray, "n 3"]:
        """The edited colors of surfaces that have the headroom of the pixels `at`; `keep`: those show them from now on.

        An edit that does not scale sees what was recorded, and its pixels have no headroom any more.
        """
        if not getattr(edit, "scales", False):
            out = edit(color, surface)
            if keep:
                self.over[at], self.most[at] = 1, 1
            return out
        bright = color * self.over[at]
        exposure = np.maximum(bright.max(1, keepdims=True), np.float32(1))
        lit = edit(bright / exposure, surface) * exposure
        out = np.minimum(lit, self.most[at])
        if keep:
            self.over[at] = np.maximum(lit / np.maximum(out, np.float32(1 / 255)), np.float32(1))
        return out
