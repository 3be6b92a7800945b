"""What a new thing would be to a policy's cameras: whether they show it, and how much of the target it would hide.

The thing is taken by the convex outline of its picture, at the depth of its nearest point where it may hide something
and of its middle where something may hide it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float64, Int

from rpaug.core import geometry
from rpaug.core.errors import TargetError
from rpaug.core.memo import once
from rpaug.core.types import Episode
from rpaug.render.mesh import NEAREST
from rpaug.scene.sampled_frames import SampledFrames, look

SHOWN = 0.5  # of a thing's picture that is inside an image and before all else, in as many of the frames
COVERED = (
    0.05  # of the target's pixels in an image: with more than these hidden it is partly hidden
)


@dataclass(frozen=True)
class PolicyViews:
    """Sampled frames of the policy's cameras `chosen`; `target` are the pixels that show the target, `covered` how
    many of these the things that were put in so far hide."""

    sampled: SampledFrames
    chosen: tuple[int, ...]
    target: Bool[np.ndarray, "s c h w"]
    covered: Int[np.ndarray, "s c"]

    def with_thing(self, points: Float[np.ndarray, "n 3"], hides: float) -> "PolicyViews | None":
        """The views once a thing with these world points stands there, None if it may not.

        That is where in most frames no camera shows most of it, or some camera would see the target partly hidden in
        more than a share `hides` of the frames that show it.
        """
        if not self.chosen:
            return self
        covered = self.covered.copy()
        shown = np.zeros(len(self.sampled.frames), bool)
        for s, c, share, hidden in self._pictures(points):
            shown[s] |= share >= SHOWN
            covered[s, c] += hidden
        pixels = self.target.sum((2, 3))
        partly = (covered > COVERED * pixels) & (pixels > 0)
        often = partly.sum(0) > hides * (pixels > 0).sum(0)
        if shown.mean() < SHOWN or often.any():
            return None
        return replace(self, covered=covered)

    def _pictures(self, points: Float[np.ndarray, "n 3"]) -> Iterator[tuple[int, int, float, int]]:
        """Frame, camera, the share of the thing that shows, and how many pixels of the target it hides."""
        sampled = self.sampled
        for c in self.chosen:
            outline = None
            for s in range(len(sampled.frames)):
                if outline is None or not sampled.fixed[c]:
                    outline = _outline(points, sampled.K[c], sampled.cam_to_world[s, c])
                if outline is None:
                    continue
                corners, nearest, middle = outline
                low = np.maximum(np.floor(corners.min(0)).astype(int), 0)
                high = np.minimum(
                    np.ceil(corners.max(0)).astype(int) + 1, sampled.depth.shape[:1:-1]
                )
                if (low >= high).any():
                    continue
                window = np.s_[s, c, low[1] : high[1], low[0] : high[0]]
                mask = np.zeros(high[::-1] - low[::-1], np.uint8)
                cv2.fillConvexPoly(mask, np.rint(corners - low).astype(np.int32), 1)
                depth, inside = (
                    sampled.depth[window],
                    mask.astype(bool) & (sampled.ids[window] >= 0),
                )
                shows = inside & ((depth <= 0) | (depth > middle))
                hides = inside & self.target[window] & (depth > nearest)
                whole = max(cv2.contourArea(corners.astype(np.float32)), 1.0)
                yield s, c, float(shows.sum() / whole), int(hides.sum())


@once
def find(episode: Episode, target: frozenset[int], cameras: tuple[str, ...] | None) -> PolicyViews:
    """The views of `cameras`, None for all that recorded depth and masks. Raises TargetError for an unknown one."""
    for name in cameras or ():
        if name not in episode.views:
            raise TargetError(
                f"no camera is called {name!r}; there are: {', '.join(episode.views)}"
            )
    sampled = look(episode)
    chosen = tuple(
        c for c, name in enumerate(sampled.cameras) if cameras is None or name in cameras
    )
    shows = np.isin(sampled.ids, list(target))
    return PolicyViews(sampled, chosen, shows, np.zeros(shows.shape[:2], int))


def _outline(
    points: Float[np.ndarray, "n 3"],
    K: Float64[np.ndarray, "3 3"],
    pose: Float64[np.ndarray, "4 4"],
) -> tuple[Float64[np.ndarray, "k 2"], float, float] | None:
    """The convex outline of a thing's picture in pixels, the depth of its nearest point and of its middle; None where
    part of it is behind the camera."""
    local = geometry.transform(geometry.inverse(pose), points)
    if local[:, 2].min() <= NEAREST:
        return None
    pixels = (local @ K.T)[:, :2] / local[:, 2:]
    outline = cv2.convexHull(pixels.astype(np.float32))[:, 0].astype(np.float64)
    return outline, float(local[:, 2].min()), float(np.median(local[:, 2]))
