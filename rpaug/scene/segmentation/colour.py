"""What changes in a fixed camera without depth, told from what does not: by colour against its median."""

from dataclasses import replace
from functools import lru_cache, partial

import cv2
import numpy as np
from jaxtyping import Int32, UInt8

from rpaug.scene.sampling import frames
from rpaug.types import CameraView, Episode

REST, MOVING = 1, 2
SAMPLED = 21  # frames that the median is taken over
NOISES = 6.0  # spreads of a pixel's colour over time beyond which it shows something else
LEAST = 18.0  # 8-bit steps that count as a change at any rate
SPECK = np.ones((3, 3), np.uint8)


def masked(episode: Episode) -> Episode:
    """The episode with handles for fixed cameras that have neither masks nor depth: MOVING or REST.

    Others, and an episode of fewer than three frames, are left as they are. The handles are `inferred`.
    """
    views = dict(episode.views)
    for name, view in episode.views.items():
        bare = view.ids is None and view.depth is None
        if bare and view.camera.fixed and episode.length > 2:
            usual, spread = background(view, episode.length)
            ids = lru_cache(None)(partial(changed, view, usual, spread))
            views[name] = replace(view, ids=ids, inferred=True)
    return replace(episode, views=views)


def background(view: CameraView, length: int) -> tuple[np.ndarray, np.ndarray]:
    """Median colour of each pixel over time, and its median absolute deviation."""
    images = np.stack([view.rgb(t) for t in frames(length, SAMPLED)]).astype(np.float32)
    usual = np.median(images, 0)
    return usual, np.median(np.abs(images - usual), 0).max(-1)


def changed(
    view: CameraView, usual: np.ndarray, spread: np.ndarray, t: int
) -> Int32[np.ndarray, "h w"]:
    """Handles of one image: MOVING where its colour is far from the usual one."""
    image: UInt8[np.ndarray, "h w 3"] = view.rgb(t)
    off = np.abs(image - usual).max(-1) > np.maximum(LEAST, NOISES * spread)
    whole = cv2.morphologyEx(off.astype(np.uint8), cv2.MORPH_OPEN, SPECK)
    whole = cv2.morphologyEx(whole, cv2.MORPH_CLOSE, SPECK)
    return np.where(whole > 0, MOVING, REST).astype(np.int32)
