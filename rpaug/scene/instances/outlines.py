"""Outlines of things, cut anew by GrabCut: tints find a thing's middle, its own colors find where it ends."""

import cv2
import numpy as np
from jaxtyping import Bool, Int32, UInt8

from rpaug.providers import grabcut
from rpaug.scene.instances.grouping import AROUND, MOVING, SUPPORT

MARGIN = 0.35  # of a thing's size: how far beyond its tint it is looked for
AROUND_IT = 1.0  # of its size: how far what is behind it is learned from
ROUNDS = 2
ACROSS = 48  # pixels that a small thing is enlarged to, at most twice
LESS, MORE = 0.6, 2.0  # times its pixels that a thing may come to, or it is left as it was
FEWEST = 12  # pixels: of smaller things no colors are learned


def cut(
    image: UInt8[np.ndarray, "h w 3"],
    ids: Int32[np.ndarray, "h w"],
    only: frozenset[int] | None = None,
    rim: float = 0.0,
) -> Int32[np.ndarray, "h w"]:
    """The instance ids of an image with every thing, or `only` these, ended where its colors do.

    A thing grows over support, walls and floor, and gives back to whatever lies beside it. `rim` is how deep into a
    thing its colors may not be its own, as a share of its size; a pixel at least.
    """
    out = ids.copy()
    for instance_id in np.unique(ids):
        if instance_id <= AROUND or (only is not None and instance_id not in only):
            continue
        count, pieces = cv2.connectedComponents((ids == instance_id).astype(np.uint8))
        for number in range(1, count):
            piece = pieces == number
            if piece.sum() >= FEWEST:
                _cut_one(image, out, piece, int(instance_id), rim)
    return out


def _cut_one(
    image: UInt8[np.ndarray, "h w 3"],
    out: Int32[np.ndarray, "h w"],
    piece: Bool[np.ndarray, "h w"],
    instance_id: int,
    rim: float,
) -> None:
    size = float(np.sqrt(piece.sum()))
    near, far = (max(2, round(share * size)) for share in (MARGIN, AROUND_IT))
    rows, columns = _window(piece, far)
    mine = piece[rows, columns]
    here = out[rows, columns]
    free = np.isin(here, (SUPPORT, AROUND))
    known = np.full(mine.shape, grabcut.BEHIND, np.uint8)
    known[_grown(mine, near) & free] = grabcut.MAYBE_BEHIND
    known[mine] = grabcut.MAYBE_THING
    deep = 2 * max(1, round(rim * size)) + 1
    core = cv2.erode(mine.astype(np.uint8), np.ones((deep, deep), np.uint8)) > 0
    known[core] = grabcut.THING
    grown = int(np.clip(ACROSS // max(size, 1.0), 1, 2))
    found = grabcut.cut(image[rows, columns], known, grown, ROUNDS)
    if not LESS * mine.sum() < found.sum() < MORE * mine.sum():
        return
    here[found & (free | mine)] = instance_id
    lost = mine & ~found
    if lost.any():
        # What is given back goes to what most of the surroundings are.
        beside = here[_grown(mine, 1) & ~mine]
        beside = beside[beside != instance_id]
        here[lost] = np.bincount(beside).argmax() if len(beside) else MOVING


def _window(mask: Bool[np.ndarray, "h w"], margin: int) -> tuple[slice, slice]:
    down, right = np.nonzero(mask)
    h, w = mask.shape
    return (
        slice(max(0, int(down.min()) - margin), min(h, int(down.max()) + margin + 1)),
        slice(max(0, int(right.min()) - margin), min(w, int(right.max()) + margin + 1)),
    )


def _grown(mask: Bool[np.ndarray, "h w"], by: int) -> Bool[np.ndarray, "h w"]:
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * by + 1,) * 2)
    return cv2.dilate(mask.astype(np.uint8), disc) > 0
