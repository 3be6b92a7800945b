"""A model from outside, of the use `inpaint`: holes filled by the pull-push algorithm (Gortler et al. 1996).

The image is halved until no hole is left, known pixels alone counting (pull); then each hole takes the color of the
level above (push): smooth, quick, without weights.
"""

import cv2
import numpy as np


def paint(rgb, hole):
    """The image (h, w, 3) uint8 with its `hole` (h, w) bool painted."""
    known = (~hole).astype(np.float32)
    return np.rint(_filled(rgb.astype(np.float32) * known[..., None], known)).astype(np.uint8)


def _filled(summed, weight):
    """Colors everywhere, of colors times weight and weight."""
    height, width = weight.shape
    color = summed / np.maximum(weight, 1e-6)[..., None]
    if (weight > 0).all() or min(height, width) < 2:
        return color
    half = ((width + 1) // 2, (height + 1) // 2)
    above = _filled(
        cv2.resize(summed, half, interpolation=cv2.INTER_AREA),
        cv2.resize(weight, half, interpolation=cv2.INTER_AREA),
    )
    pushed = cv2.resize(above, (width, height), interpolation=cv2.INTER_LINEAR)
    share = np.minimum(weight, 1)[..., None]
    return share * color + (1 - share) * pushed
