"""Things on a support that have its color: an empty glass, through which it is seen.

A segment that the support surrounds, at one place of it in several frames, is a thing or a mark of the surface. A mark
looks the same from everywhere, and what stands on the surface does not; a lamp's reflection wanders with the camera.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Int32, Int64

from rpaug.core.pixels import grown
from rpaug.scene.video.frame import PosedFrame
from rpaug.scene.video.linked import joined
from rpaug.scene.video.support_look import SupportLook

SMALLEST, LARGEST = 0.001, 0.02  # of an image: a segment that may be one
RIM = 2  # pixels around a segment that are what surrounds it
ROUND = 0.75  # of these are the support
OWN = 0.7  # of a segment is called support, if it is mistaken for it
UNLIKE = 2.5  # times what the support is off its places' colors: a quarter of the segment and its rim is more
LEAST = 0.7  # weighted Lab: of that at least, by what outlines in places leave
SAME = 0.4  # of the smaller of two segments' places are the other's, if they are one thing
FEWEST, OFTEN = 4, 1 / 3  # frames that outline one, and of those that show its place
WHOLE = 0.9  # of a place is in a frame that shows it
MOST = 0.5  # of the frames that outline it have a place that it covers; of a segment's places, if it is a part of it


@dataclass(frozen=True, eq=False)
class ClearThing:
    """One of them: the places of the support that it covers, `codes` in rising order. Of the frames `shown` that show
    these, the number `outlined` shows its outline."""

    instance_id: int
    codes: Int64[np.ndarray, "n"]
    outlined: int
    shown: int


def find(
    looks: Sequence[PosedFrame],
    masks: Sequence[Bool[np.ndarray, "h w"]],
    look_of: SupportLook,
    first: int,
) -> tuple[ClearThing, ...]:
    """The things among what the looks show of a support, which `masks` mark; ids from `first`."""
    places = [look_of.places(look) for look in looks]
    seen = [np.unique(one) for one in places]
    found = [
        (k, codes)
        for k, (look, mask) in enumerate(zip(looks, masks, strict=True))
        for codes in _islands(look, mask, places[k], look_of)
    ]
    having, shared = defaultdict[int, list[int]](list), Counter[tuple[int, int]]()
    for i, (_, codes) in enumerate(found):
        for code in codes.tolist():
            shared.update((i, j) for j in having[code])
            having[code].append(i)
    alike = [
        (i, j)
        for (i, j), count in shared.items()
        if count > SAME * min(len(found[i][1]), len(found[j][1]))
    ]
    group = joined(len(found), np.array(alike, np.int64).reshape(-1, 2))
    out = list[ClearThing]()
    for number in np.unique(group).tolist():
        mine = [found[i] for i in np.flatnonzero(group == number)]
        frames = {k for k, _ in mine}
        each = [np.unique(np.concatenate([c for k, c in mine if k == frame])) for frame in frames]
        codes, count = np.unique(np.concatenate(each), return_counts=True)
        codes = codes[count >= MOST * len(frames)]
        shown = sum(bool(np.isin(codes, one).mean() > WHOLE) for one in seen) if len(codes) else 0
        if len(frames) >= max(FEWEST, OFTEN * shown) and len(codes):
            out.append(ClearThing(first + len(out), codes, len(frames), max(shown, len(frames))))
    return tuple(out)


def marked(
    look: PosedFrame,
    named: Int32[np.ndarray, "h w"],
    held: Bool[np.ndarray, "h w"],
    look_of: SupportLook,
    things: Sequence[ClearThing],
) -> Int32[np.ndarray, "h w"]:
    """Instance ids with these things' own at their places and in the segments there, where the support is `held`."""
    if not things:
        return named
    out, places = named.copy(), look_of.places(look)
    patch = look.segments
    size = np.bincount(patch.ravel())
    for thing in things:
        there = np.isin(places, thing.codes) & held
        parts = np.bincount(patch.ravel(), there.ravel()) > MOST * size
        parts &= size < LARGEST * patch.size
        out[_hull(there | (parts[patch] & held)) & held] = thing.instance_id
    return out


def _hull(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """The convex hull of what is marked: of a glass the rim is told, and not what is seen through it."""
    rows, columns = np.nonzero(mask)
    if not len(rows):
        return mask
    outline = cv2.convexHull(np.stack([columns, rows], 1).astype(np.int32))
    return cv2.fillConvexPoly(np.zeros(mask.shape, np.uint8), outline, 1) > 0


def _islands(
    look: PosedFrame,
    mask: Bool[np.ndarray, "h w"],
    places: Int64[np.ndarray, "h w"],
    look_of: SupportLook,
) -> Iterator[Int64[np.ndarray, "n"]]:
    """The places of each segment that the support surrounds and that does not look like it everywhere."""
    patch, off = look.segments, look_of.off(look, mask, around=1)
    if not (known := mask & np.isfinite(off)).any():
        return
    noise = max(LEAST, float(np.median(off[known])))
    size = np.bincount(patch.ravel())
    own = np.bincount(patch.ravel(), mask.ravel()) > OWN * size
    own &= (size > SMALLEST * patch.size) & (size < LARGEST * patch.size)
    for number in np.flatnonzero(own).tolist():
        mine = patch == number
        about = grown(mine, RIM)
        edge = any(side.any() for side in (about[0], about[-1], about[:, 0], about[:, -1]))
        if edge or mask[about & ~mine].mean() < ROUND:
            continue
        told = off[about & np.isfinite(off)]
        if len(told) and np.percentile(told, 75) > UNLIKE * noise:
            yield np.unique(places[mine & (places >= 0)])
