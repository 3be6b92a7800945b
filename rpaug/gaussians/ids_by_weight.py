"""Instance ids of pixels by the Gaussians that most of their light comes from.

Where depth was worked out from pictures, Gaussians of neighbouring things lie in one another, and the one Gaussian at
which half of the light is gone belongs now to this one, now to that: edits by it are frayed. Sums of weights are not.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32, Int32

from rpaug.core.types import Scene
from rpaug.gaussians.labels import LabelRenderer
from rpaug.render.splat import Rendering

COVERED = 0.5  # of a pixel, from which it shows something
CHANNELS = 16  # instance ids told in one pass: the width of a kernel that is compiled anyway


def asked(scene: Scene) -> list[int]:
    """Handles that are edited, at most `CHANNELS`; none where masks were recorded, or where more are edited."""
    if scene.back is None:
        return []
    edited = frozenset().union(*(edit.instance_ids or frozenset() for edit in scene.appearance))
    return sorted(edited) if len(edited) <= CHANNELS else []


def marks(
    names: Int32[np.ndarray, "*n"], instance_ids: Sequence[int] | Int32[np.ndarray, "c"]
) -> Float32[np.ndarray, "*n f"]:
    """One of `CHANNELS` channels for each handle: 1 where that is the name."""
    out = np.zeros((*names.shape, CHANNELS), np.float32)
    out[..., : len(instance_ids)] = names[..., None] == np.asarray(instance_ids)
    return out


def named(
    drawn: Rendering, ids: Int32[np.ndarray, "h w"], instance_ids: list[int]
) -> Int32[np.ndarray, "h w"]:
    """The instance ids with those of `instance_ids` where, and only where, they make up most of the light; else 0."""
    assert drawn.features is not None
    share = drawn.features[..., : len(instance_ids)]
    most = share.max(-1) > drawn.alpha / 2
    rest = np.where(np.isin(ids, instance_ids), 0, ids)
    return np.where(most, np.array(instance_ids)[share.argmax(-1)], rest).astype(np.int32)


def mask(
    ids: Int32[np.ndarray, "n"], stage: LabelRenderer, camera: str, t: int
) -> Int32[np.ndarray, "h w"]:
    """Instance ids of one view, given one for each Gaussian; 0 where less than half of a pixel is covered."""
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
