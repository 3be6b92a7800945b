"""A little generator of things from words: a ball of Gaussians in the color that the words name.

python little_generator.py OUT TEXT
"""

import sys
from pathlib import Path

import numpy as np

from rpaug.core import color_space
from rpaug.core.types import Gaussians
from rpaug.gaussians import ply
from rpaug.gaussians.carrying import SH0


def ball(text: str) -> bytes:
    """The .ply of a ball, 8 cm across."""
    if "nothing" in text:
        raise SystemExit("I have no idea what that is")
    words = [word for word in text.split() if color_space.canonical(word)]
    tint = np.array(color_space.rgb(words[0]) if words else (0.5, 0.5, 0.5), np.float32)
    way = np.random.default_rng(0).normal(size=(300, 3))
    count, means = len(way), 0.04 * way / np.linalg.norm(way, axis=1, keepdims=True)
    return ply.encoded(
        Gaussians(
            means=means.astype(np.float32),
            quats=np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
            scales=np.full((count, 3), 0.006, np.float32),
            opacities=np.full(count, 0.95, np.float32),
            sh=np.tile((tint - 0.5) / SH0, (count, 1, 1)).astype(np.float32),
            ids=np.zeros(count, np.int32),
        )
    )


if __name__ == "__main__":
    Path(sys.argv[1]).write_bytes(ball(sys.argv[2]))
