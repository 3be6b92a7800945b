"""Which pixels of a video's Gaussians show an edited thing: those that get most of their light from it.

Where depth was worked out from pictures, Gaussians of neighbouring things lie in one another, and the one Gaussian at
which half of the light is gone belongs now to this one, now to that: edits by it are frayed. Sums of weights are not.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32, Int32

from rpaug.core.types import Scene
from rpaug.render.splat import Rendering

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
