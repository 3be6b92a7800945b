"""Where what a video shows of an instance grows or shrinks at once: things do that by and by, unless they were told
wrongly, or not at all, in one of two frames."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

MUCH, LEAST = 0.25, 0.0005  # of the most that any frame shows, and of a frame's pixels
AT_ONCE = 1.6  # times as large or as small as in the frame before
APART = 2  # frames between neighbours, at most: some have no camera pose


@dataclass(frozen=True)
class Jump:
    """Pixels that show something in frame `t`, and in the one `after` it."""

    t: int
    after: int
    before_pixels: int
    after_pixels: int

    @property
    def change(self) -> int:
        """Pixels."""
        return abs(self.after_pixels - self.before_pixels)


def jumps(areas: Mapping[int, int], pixels: int) -> tuple[int, list[Jump]]:
    """Of the `areas` in pixels that frames of so many `pixels` show, by recorded frame: how many pairs of neighbours
    show any, and those between which it jumps, the largest first."""
    frames, pairs = sorted(areas), list[Jump]()
    for t, after in pairwise(frames):
        if after - t <= APART and (areas[t] or areas[after]):
            pairs.append(Jump(t, after, areas[t], areas[after]))
    least = max(MUCH * max(areas.values(), default=0), LEAST * pixels)
    found = [
        one
        for one in pairs
        if max(one.before_pixels, one.after_pixels) > least
        and max(one.before_pixels, one.after_pixels)
        > AT_ONCE * min(one.before_pixels, one.after_pixels)
    ]
    return len(pairs), sorted(found, key=lambda one: -one.change)
