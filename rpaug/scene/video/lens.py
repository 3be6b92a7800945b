"""Through a lens and back: scenes are pinhole images, recordings bend at their borders."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, UInt8

from rpaug.core import geometry
from rpaug.core.pixels import differing
from rpaug.scene.video.model import Reconstruction

WHOLE = 0.9  # share of changed pixels from which on the image was rendered anew
ROUNDS = 20  # of the fixed-point iteration that undoes the bend


@dataclass(frozen=True)
class Lens:
    """How a recorded image of `width` x `height` lies in a pinhole image of `size`, which is a little larger: all
    recorded pixels are in it. `K` is the pinhole's."""

    model: Reconstruction

    @cached_property
    def margin(self) -> tuple[int, int]:
        """Columns and rows that the pinhole image has more on each side."""
        x, y = self._straight(*self._border())
        over = max(-x.min(), x.max() - (self.model.width - 1), 0.0)
        under = max(-y.min(), y.max() - (self.model.height - 1), 0.0)
        # Even, so that halved images keep their centres.
        return 2 * int(np.ceil(over / 2)), 2 * int(np.ceil(under / 2))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pinhole image."""
        return self.model.width + 2 * self.margin[0], self.model.height + 2 * self.margin[1]

    @property
    def K(self) -> Float64[np.ndarray, "3 3"]:
        """Of the pinhole image."""
        K = self.model.K.copy()
        K[:2, 2] += self.margin
        return K

    @cached_property
    def shown(self) -> Bool[np.ndarray, "h w"]:
        """Which pinhole pixels were recorded."""
        x, y = self._forward
        return (x >= 0) & (y >= 0) & (x <= self.model.width - 1) & (y <= self.model.height - 1)

    @cached_property
    def _forward(self) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
        """Where each pinhole pixel lies in the recorded image."""
        rows, columns = np.mgrid[: self.size[1], : self.size[0]].astype(np.float64)
        u, v = geometry.slopes(columns, rows, self.K)
        bend = 1 + self.model.radial * (u * u + v * v)
        x = self.model.focal * u * bend + self.model.middle[0]
        y = self.model.focal * v * bend + self.model.middle[1]
        return x.astype(np.float32), y.astype(np.float32)

    @cached_property
    def _backward(self) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
        """Where each recorded pixel lies in the pinhole image."""
        rows, columns = np.mgrid[: self.model.height, : self.model.width].astype(np.float64)
        x, y = self._straight(columns, rows)
        return (x + self.margin[0]).astype(np.float32), (y + self.margin[1]).astype(np.float32)

    def straight(self, x: float, y: float) -> tuple[float, float]:
        """Where a recorded pixel lies in the pinhole image."""
        column, row = self._straight(np.array([x]), np.array([y]))
        return float(column[0]) + self.margin[0], float(row[0]) + self.margin[1]

    def _straight(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Recorded pixels without the bend, in pixels of the same origin."""
        focal, (cx, cy) = self.model.focal, self.model.middle
        bent_u, bent_v = (x - cx) / focal, (y - cy) / focal
        u, v = bent_u, bent_v
        for _ in range(ROUNDS):
            bend = 1 + self.model.radial * (u * u + v * v)
            u, v = bent_u / bend, bent_v / bend
        return focal * u + cx, focal * v + cy

    def _border(self) -> tuple[np.ndarray, np.ndarray]:
        width, height = self.model.width - 1, self.model.height - 1
        along, down = np.arange(width + 1.0), np.arange(height + 1.0)
        x = np.concatenate([along, along, 0 * down, 0 * down + width])
        y = np.concatenate([0 * along, 0 * along + height, down, down])
        return x, y

    def flat(self, image: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h2 w2 3"]:
        """The pinhole image of a recorded one; what was not recorded continues its border."""
        return cv2.remap(image, *self._forward, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)

    def bent(
        self,
        recorded: UInt8[np.ndarray, "h w 3"],
        before: UInt8[np.ndarray, "h2 w2 3"],
        after: UInt8[np.ndarray, "h2 w2 3"],
    ) -> UInt8[np.ndarray, "h w 3"]:
        """The recorded image as an edit left it: pixels are new where one that they are blended from changed."""
        changed = differing(before, after).astype(np.uint8)
        if not changed.any():
            return recorded
        near = cv2.remap(
            cv2.dilate(changed, np.ones((3, 3), np.uint8)), *self._backward, cv2.INTER_NEAREST
        )
        if changed.mean() > WHOLE:
            return cv2.remap(
                after, *self._backward, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
            )
        # The difference is carried over, not the image: what the lens softens is softened once.
        way = after.astype(np.float32) - before.astype(np.float32)
        bent = cv2.remap(way, *self._backward, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        shown = np.clip(np.rint(recorded + bent), 0, 255).astype(np.uint8)
        return np.where(near[..., None] > 0, shown, recorded)
