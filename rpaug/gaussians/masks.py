"""Masks drawn from the Gaussians' instance ids: at each pixel the one that most of its light comes from."""

import numpy as np
from jaxtyping import Int32

from rpaug.gaussians.ids_by_weight import CHANNELS
from rpaug.gaussians.labels import LabelRenderer

COVERED = 0.5  # of a pixel, from which it shows something


def mask(
    ids: Int32[np.ndarray, "n"], stage: LabelRenderer, camera: str, t: int
) -> Int32[np.ndarray, "h w"]:
    """Handles of one view, given one for each Gaussian; 0 where less than half of a pixel is covered."""
    labels, which = np.unique(ids, return_inverse=True)
    best = share = alpha = None
    for start in range(0, len(labels), CHANNELS):
        member = (which >= start) & (which < start + CHANNELS)
        features = np.zeros((len(ids), CHANNELS), np.float32)
        features[member, which[member] - start] = 1.0
        drawn = stage.draw(camera, t, features)
        assert drawn.features is not None
        named = labels[np.minimum(drawn.features.argmax(-1) + start, len(labels) - 1)]
        weight = drawn.features.max(-1)
        if best is None or share is None:
            best, share, alpha = named, weight, drawn.alpha
        else:
            best, share = np.where(weight > share, named, best), np.maximum(weight, share)
    if best is None or alpha is None:
        return np.zeros(stage.size(camera), np.int32)
    return np.where(alpha >= COVERED, best, 0).astype(np.int32)
