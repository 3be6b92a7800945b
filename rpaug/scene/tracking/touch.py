"""Which instances touch: neighbours in an image whose surfaces are at the same depth there."""

from collections import defaultdict

import numpy as np

from rpaug.core.jit import kernel
from rpaug.scene.sampled_frames import SampledFrames

GAP = 0.005  # metres, beside what the spacing of the pixels allows
SPACING = 2.0  # pixels: how far apart two neighbours on one slanted surface may be


def touching(sampled: SampledFrames, frames: slice = slice(None)) -> dict[frozenset[int], int]:
    """Number of looked-at frames in which each pair of instance ids touches, of those in `frames`."""
    found: dict[frozenset[int], int] = defaultdict(int)
    for s in range(len(sampled.frames))[frames]:
        pairs = set()
        for c in range(len(sampled.cameras)):
            width = sampled.ids.shape[-1]
            at = _contacts(
                sampled.ids[s, c], sampled.depth[s, c], sampled.points[s, c], sampled.K[c, 0, 0]
            )
            flat = sampled.ids[s, c].ravel()
            pairs |= {
                frozenset((int(flat[i]), int(flat[i + (width if down else 1)]))) for i, down in at
            }
        for pair in pairs:
            found[pair] += 1
    return dict(found)


@kernel
def _contacts(ids, depth, points, focal):
    """Flat index of each pixel that touches its right (0) or lower (1) neighbour of another instance id."""
    height, width = ids.shape
    out = np.zeros((2 * height * width, 2), np.int64)
    n = 0
    for r in range(height):
        for c in range(width):
            for down in range(2):
                row, column = r + down, c + 1 - down
                if row >= height or column >= width:
                    continue
                if ids[r, c] == ids[row, column] or ids[r, c] <= 0 or ids[row, column] <= 0:
                    continue
                near = min(depth[r, c], depth[row, column])
                if near <= 0:
                    continue
                gap = 0.0
                for i in range(3):
                    gap += (points[r, c, i] - points[row, column, i]) ** 2
                if np.sqrt(gap) < GAP + SPACING * near / focal:
                    out[n] = r * width + c, down
                    n += 1
    return out[:n]
