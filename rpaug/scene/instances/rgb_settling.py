"""The instance ids of one frame of a still camera: the backdrop's, and what is told of each pixel that changed."""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Int, Int32, UInt8

from rpaug.core import pixels
from rpaug.scene.instances import color_clusters
from rpaug.scene.instances.backdrop import Backdrop
from rpaug.scene.instances.grouping import MOVING
from rpaug.scene.instances.lasting import Lasting
from rpaug.scene.instances.named import Small

REACH = 0.05  # of the image's width: an uncovered pixel is not farther from the patch it belongs to
SHADOW = 2.0  # times darker or brighter that a pixel may become and be the same thing
NAMED = 99_999  # instance id of a small thing of the color that the instruction names
LOCAL = 10.0  # weighted Lab: an uncovered pixel looks like the nearest pixel of its patch


@dataclass(frozen=True)
class CameraInstances:
    """One camera's part: `resting` are the instance ids of its backdrop, `moved` those that leave their place.

    `mobile` are the tints of what moves, `mine` the instance id of each tint in a camera that moves itself. `came` is
    where a thing without a tint of its own went, `small` the place of a small one that the instruction names.
    """

    backdrop: Backdrop
    resting: Int32[np.ndarray, "h w"]
    cluster: Int[np.ndarray, "h w"]
    mobile: frozenset[int]
    moved: Mapping[int, int]
    mine: Mapping[int, int]
    came: Lasting | None = None
    small: Small | None = None


def instance_ids(
    part: CameraInstances, label: Int[np.ndarray, "h w"], image: UInt8[np.ndarray, "h w 3"]
) -> Int32[np.ndarray, "h w"]:
    """Where the backdrop changed: a thing that was moved, what was uncovered, or the robot."""
    changed = part.backdrop.changed(image)
    out = _tidied(_settled(part, label, changed, image), changed)
    free = ~np.isin(label, [*part.mobile, *part.moved])
    if part.came is not None:
        out[part.came.shown(image) & free] = MOVING  # where it rests nothing tells its outline
    if part.small is not None:
        out[part.small.shown(label) & free] = NAMED
    return out


def _settled(
    part: CameraInstances,
    label: Int[np.ndarray, "h w"],
    changed: Bool[np.ndarray, "h w"],
    image: UInt8[np.ndarray, "h w 3"],
) -> Int32[np.ndarray, "h w"]:
    shown = color_clusters.weighted(image)
    behind = color_clusters.weighted(part.backdrop.image)
    # What is there still is so in a shadow or another exposure; only of the robot's tints nothing follows.
    there = (label == part.cluster) | color_clusters.shaded(shown, behind, SHADOW)
    there &= ~np.isin(label, [*part.mobile, *part.moved]) & (part.resting != MOVING)
    changed = changed & ~there
    out = np.where(changed, MOVING, part.resting).astype(np.int32)
    open_ = changed & ~np.isin(label, list(part.mobile))
    for cluster, instance_id in part.moved.items():
        out[open_ & (label == cluster)] = instance_id
    still_open = open_ & ~np.isin(label, list(part.moved))
    reach = max(2.0, REACH * label.shape[1])
    for cluster in np.unique(label[still_open]):
        source = ~changed & (part.cluster == cluster) & (part.resting != MOVING)
        if not source.any():
            continue
        nearest, off = pixels.nearest(source)
        here = still_open & (label == cluster) & (off <= reach)
        place = nearest[here]
        alike = np.linalg.norm(shown[here] - behind.reshape(-1, 3)[place], axis=-1) < LOCAL
        rows = np.flatnonzero(here)[alike]
        out.reshape(-1)[rows] = part.resting.reshape(-1)[place[alike]]
    return out


def _tidied(
    ids: Int32[np.ndarray, "h w"], changed: Bool[np.ndarray, "h w"]
) -> Int32[np.ndarray, "h w"]:
    """Where something changed, lone pixels go with their neighbours."""
    names, flat = np.unique(ids, return_inverse=True)
    if not changed.any() or len(names) > 255:
        return ids
    smooth = np.zeros(ids.shape, np.float32)
    best = np.full(ids.shape, -1, np.int64)
    flat = flat.reshape(ids.shape)
    for k in range(len(names)):
        votes = cv2.blur((flat == k).astype(np.float32), (3, 3), borderType=cv2.BORDER_REPLICATE)
        votes += np.float32(0.12) * (flat == k)
        best = np.where(votes > smooth, k, best)
        smooth = np.maximum(votes, smooth)
    return np.where(changed, names[best], ids).astype(np.int32)
