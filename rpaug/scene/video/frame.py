"""One frame of a video, ready to be looked at for things."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, UInt8

from rpaug.core import geometry
from rpaug.scene.video.segments import segments


@dataclass(frozen=True, eq=False)
class PosedFrame:
    """One frame: its image made small, depth, lens and pose, in a world whose z is up."""

    rgb: UInt8[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]
    K: Float64[np.ndarray, "3 3"]
    cam_to_world: Float64[np.ndarray, "4 4"]
    hidden: Bool[np.ndarray, "h w"] | None = (
        None  # what moves by itself, and is no thing of the world
    )

    @cached_property
    def segments(self) -> Int32[np.ndarray, "h w"]:
        """Its segments, numbered from 0."""
        return segments(self.rgb)

    @cached_property
    def points(self) -> Float64[np.ndarray, "h w 3"]:
        """Where its pixels lie in the world."""
        return geometry.transform(
            self.cam_to_world, geometry.unproject(self.depth.astype(np.float64), self.K)
        )

    def sees(
        self, points: Float64[np.ndarray, "*n 3"]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Row and column of points in this frame, and their depth; -1 for what is outside of it."""
        local = geometry.transform(geometry.inverse(self.cam_to_world), points)
        z = local[..., 2]
        ahead = np.maximum(z, 1e-9)
        column, row = geometry.to_image(local, ahead, self.K)
        height, width = self.depth.shape
        inside = (z > 0) & (row > -0.5) & (column > -0.5)
        inside &= (row < height - 0.5) & (column < width - 0.5)
        whole = [np.where(inside, np.rint(np.where(inside, v, 0)), -1) for v in (row, column)]
        return whole[0].astype(np.int64), whole[1].astype(np.int64), z
