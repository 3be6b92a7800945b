"""Were the images anti-aliased? Measured on object outlines, since no dataset says."""

import numpy as np

from rpaug.core import sampling
from rpaug.core.types import Episode

STRONG = 0.04  # squared color step of an edge worth judging
FLAT = 0.003  # squared color step within one side that still counts as flat
MIXED_SHARE = 0.25  # 4x multisampling mixes three edges in four; textures alone mix few
LEAST_EDGES = 30


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
            hits, edges = _judge(image.astype(np.float32) / 255, label)
            mixed, judged = mixed + hits, judged + edges
    return judged >= LEAST_EDGES and mixed > MIXED_SHARE * judged


def _judge(image: np.ndarray, label: np.ndarray) -> tuple[int, int]:
    """Mixed and judged edges along rows."""
    if label.shape[1] < 6:
        return 0, 0
    c = [image[:, i : image.shape[1] - 5 + i] for i in range(6)]
    k = [label[:, i : label.shape[1] - 5 + i] for i in range(6)]
    step = c[4] - c[1]
    size = (step**2).sum(-1)
    edge = (k[0] == k[1]) & (k[1] == k[2]) & (k[2] != k[3]) & (k[3] == k[4]) & (k[4] == k[5])
    flat = (((c[1] - c[0]) ** 2).sum(-1) < FLAT) & (((c[5] - c[4]) ** 2).sum(-1) < FLAT)
    good = edge & flat & (size > STRONG)
    inner, outer = (((c[i] - c[1]) * step).sum(-1)[good] / size[good] for i in (2, 3))
    between = ((inner > 0.15) & (inner < 0.85)) | ((outer > 0.15) & (outer < 0.85))
    return int(between.sum()), int(good.sum())
