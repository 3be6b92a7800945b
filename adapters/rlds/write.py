"""Writing an RLDS episode: its record with only what changed encoded anew, in the encoding it had."""

from collections.abc import Callable, Sequence

import numpy as np
from rpaug_adapters.rlds.features import Leaf
from rpaug_adapters.rlds.pixels import encoded as encoded_pixels
from rpaug_adapters.rlds.read import RLDSSource
from rpaug_adapters.shared import cameras
from rpaug_adapters.shared.images import reencoded

from rpaug import Episode, Unsupported


def encoded_episode(episode: Episode, recorded: RLDSSource) -> tuple[bytes, dict[str, bytes]]:
    """The record, and the files to lay beside it: `cameras.yaml` where a camera was moved."""
    changes: dict[str, Sequence[bytes] | np.ndarray] = {}
    for name, view in episode.views.items():
        before = recorded.views[name]
        if view.rgb is not before.rgb:
            leaf = recorded.images[name]
            changes[leaf.key] = reencoded(recorded.example.blobs(leaf.key), view, before)
        if name in recorded.depths and view.depth is not before.depth:
            leaf, metres = recorded.depths[name]
            assert view.depth
            assert before.depth
            changes[leaf.key] = _pixels(
                recorded, leaf, view.depth, before.depth, metres, episode.length
            )
        if name in recorded.ids and view.ids is not before.ids:
            assert view.ids
            assert before.ids
            leaf = recorded.ids[name]
            changes[leaf.key] = _pixels(recorded, leaf, view.ids, before.ids, 1, episode.length)
    if episode.descriptions != recorded.descriptions:
        key = recorded.language
        if key is None:
            raise Unsupported(f"{episode.key}: the words changed, and no feature holds any")
        if stale := [name for name in recorded.example.features if "embedding" in name]:
            raise Unsupported(
                f"{episode.key}: the words changed, and {stale[0]} was made of the old ones"
            )
        count = len(recorded.example.blobs(key))
        changes[key] = [episode.instruction.encode()] * count
    beside = cameras.moved(episode, recorded.views, recorded.beside, recorded.own)
    return recorded.example.replaced(changes), beside


def _pixels(
    recorded: RLDSSource,
    leaf: Leaf,
    after: Callable[[int], np.ndarray],
    before: Callable[[int], np.ndarray],
    unit: float,
    length: int,
) -> Sequence[bytes] | np.ndarray:
    """A feature of depth or handles, in its own unit."""
    old = [before(t) for t in range(length)]
    new = [after(t) for t in range(length)]
    frames = [
        None if np.array_equal(a, b) else (b / np.float32(unit) if unit != 1 else b)
        for a, b in zip(old, new, strict=True)
    ]
    stored = [a / np.float32(unit) if unit != 1 else a for a in old]
    return encoded_pixels(recorded.example, leaf, frames, stored)
