"""Were the images anti-aliased? Measured on object outlines, since no dataset says."""

import numpy as np
from jaxtyping import Int32, UInt8

from rpaug.core import sampling
from rpaug.core.jit import kernel
from rpaug.core.types import Episode

STRONG = 0.04  # squared color step of an edge worth judging
FLAT = 0.003  # squared color step within one side that still counts as flat
MIXED_SHARE = 0.25  # 4x multisampling mixes three edges in four; textures alone mix few
LEAST_EDGES = 30
BETWEEN = 0.15, 0.85  # of the way from one side's color to the other's: a mixture


def detect(episode: Episode, count: int = 4) -> bool:
    """True if outline pixels are mixtures of the colors on either side.

    Looks at runs of six pixels across an outline: two of each side away from it must be flat, and the two that
    meet are judged by where they lie between the sides.
    """
    mixed = judged = 0
    for _, _, rgb, ids in sampling.images(episode, count):
        if ids is None:
            continue
        for image, label in ((rgb, ids), (rgb.swapaxes(0, 1), ids.T)):
            hits, edges = _judge(image, label)
            mixed, judged = mixed + hits, judged + edges
    return judged >= LEAST_EDGES and mixed > MIXED_SHARE * judged


@kernel
def _judge(image: UInt8[np.ndarray, "h w 3"], label: Int32[np.ndarray, "h w"]) -> tuple[int, int]:
    """Mixed and judged edges along rows."""
    mixed = judged = 0
    for y in range(label.shape[0]):
        k = label[y]
        for x in range(label.shape[1] - 5):
            if not (k[x] == k[x + 1] == k[x + 2] != k[x + 3] == k[x + 4] == k[x + 5]):
                continue
            row = image[y, x : x + 6] / np.float32(255)
            step = row[4] - row[1]
            size = (step * step).sum()
            flat = ((row[1] - row[0]) ** 2).sum() < FLAT and ((row[5] - row[4]) ** 2).sum() < FLAT
            if flat and size > STRONG:
                inner = ((row[2] - row[1]) * step).sum() / size
                outer = ((row[3] - row[1]) * step).sum() / size
                judged += 1
                mixed += BETWEEN[0] < inner < BETWEEN[1] or BETWEEN[0] < outer < BETWEEN[1]
    return mixed, judged
