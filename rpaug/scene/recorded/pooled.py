"""What lies around each pixel of a fixed camera, pooled over all frames in which the pixel shows the same place.

The pixels beside a pixel tell its surface's normal. Something that passes hides them one after the other, so a normal
told from one frame alone flickers on a surface that rests. A pixel that shows the same instance at the same depth
shows the same place of it: its neighbours then count from whichever of these frames showed them. No track is needed.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int32, UInt8

from rpaug.core import memo
from rpaug.core.jit import kernel
from rpaug.core.types import Episode
from rpaug.render import denoise

SLOTS = (
    6  # places kept of one pixel: things that pass one after the other, and what rests behind them
)
EXACT = 1e-4  # of depth: recordings without noise repeat themselves to this, things at rest that tremble among them
NOISES = 5.0  # standard deviations of depth noise within which two depths are one
AROUND = 9  # the pixel itself, and along each axis two neighbours on either side


@dataclass(frozen=True)
class Pool:
    """Up to `SLOTS` places that each pixel showed: instance ids, and depths in metres around the pixel, 0 if unknown.

    The depths stand in the order of `gather`; `tolerance` is the share of depth within which two are the same. Without
    slots nothing is pooled.
    """

    ids: Int32[np.ndarray, "h w slots"]
    depths: Float32[np.ndarray, "h w slots 9"]
    tolerance: float = 0.0


def nothing(height: int, width: int) -> Pool:
    """The pool of an image whose neighbours are known from itself alone."""
    return Pool(np.empty((height, width, 0), np.int32), np.empty((height, width, 0, AROUND), "f4"))


@memo.of_episode
def of_camera(episode: Episode, name: str) -> Pool:
    """All frames of one camera, each decoded once; of a camera that moves, or that has no depth, nothing."""
    view = episode.views[name]
    height, width = view.camera.height, view.camera.width
    if view.depth is None or not view.camera.fixed:
        return nothing(height, width)
    ids = np.zeros((height, width, SLOTS), np.int32)
    depths = np.zeros((height, width, SLOTS, AROUND), np.float32)
    count = np.zeros((height, width, SLOTS), np.int32)
    told, tolerance = np.zeros((height, width), np.uint8), 0.0
    before: tuple[np.ndarray, np.ndarray] | None = None
    for t in range(episode.length):
        depth = np.nan_to_num(view.depth(t), posinf=0.0, neginf=0.0)
        shown = view.ids(t) if view.ids else np.zeros(depth.shape, np.int32)
        if before is None:
            tolerance = max(EXACT, NOISES * denoise.noise(depth, shown))
        else:
            _forget(depth, shown, *before, told)
        _add(depth, shown, tolerance, ids, depths, count, told)
        before = depth, shown
    return Pool(ids, depths, tolerance)


@kernel
def gather(
    depth: Float32[np.ndarray, "h w"],
    ids: Int32[np.ndarray, "h w"],
    r: int,
    c: int,
    out: np.ndarray,
) -> None:
    """Depths of a pixel and of the two to its left, right, top and bottom, nearer ones first; 0 for other instances."""
    out[0] = depth[r, c]
    for axis in range(2):
        for side in range(2):
            for step in range(2):
                away = (step + 1) * (2 * side - 1)
                j, i = (r, c + away) if axis == 0 else (r + away, c)
                known = 0 <= j < depth.shape[0] and 0 <= i < depth.shape[1]
                known = known and ids[j, i] == ids[r, c] and depth[j, i] > 0
                out[1 + 4 * axis + 2 * side + step] = depth[j, i] if known else 0.0


@kernel
def find(
    ids: Int32[np.ndarray, "slots"],
    depths: Float32[np.ndarray, "slots 9"],
    instance_id: int,
    depth: float,
    tolerance: float,
) -> int:
    """The slot of a pixel that holds this place, -1 if none does."""
    for slot in range(len(ids)):
        known = depths[slot, 0]
        if known > 0 and ids[slot] == instance_id and abs(known - depth) <= tolerance * depth:
            return slot
    return -1


@kernel
def _least(count: Int32[np.ndarray, "slots"], depths: Float32[np.ndarray, "slots 9"]) -> int:
    """The slot shown in fewest frames; of those the nearest, since what passes does so in front of what rests."""
    least = 0
    for slot in range(1, len(count)):
        nearer = depths[slot, 0] < depths[least, 0]
        if count[slot] < count[least] or (count[slot] == count[least] and nearer):
            least = slot
    return least


@kernel
def _forget(
    depth: Float32[np.ndarray, "h w"],
    shown: Int32[np.ndarray, "h w"],
    depth_before: Float32[np.ndarray, "h w"],
    shown_before: Int32[np.ndarray, "h w"],
    told: UInt8[np.ndarray, "h w"],
) -> None:
    """What was `told` of the pixels around which anything differs from the frame before counts no more."""
    height, width = depth.shape
    for r in range(height):
        for c in range(width):
            if depth[r, c] == depth_before[r, c] and shown[r, c] == shown_before[r, c]:
                continue
            for away in range(-2, 3):
                if 0 <= r + away < height:
                    told[r + away, c] = 0
                if 0 <= c + away < width:
                    told[r, c + away] = 0


@kernel
def _add(
    depth: Float32[np.ndarray, "h w"],
    shown: Int32[np.ndarray, "h w"],
    tolerance: float,
    ids: Int32[np.ndarray, "h w slots"],
    depths: Float32[np.ndarray, "h w slots 9"],
    count: Int32[np.ndarray, "h w slots"],
    told: UInt8[np.ndarray, "h w"],
) -> None:
    """Take in one frame: a new place takes the slot of the one shown least. Depths are means of all frames so far.

    `told` is, by number from 1, the slot of a pixel to whose depths the same frame once more adds nothing; 0 for none.
    """
    here = np.empty(AROUND, np.float32)
    for r in range(depth.shape[0]):
        for c in range(depth.shape[1]):
            if told[r, c]:
                count[r, c, told[r, c] - 1] += 1
                continue
            if not depth[r, c] > 0:
                continue
            gather(depth, shown, r, c, here)
            slot = find(ids[r, c], depths[r, c], shown[r, c], here[0], tolerance)
            if slot < 0:
                slot = _least(count[r, c], depths[r, c])
                ids[r, c, slot], count[r, c, slot] = shown[r, c], 0
                depths[r, c, slot] = 0.0
            count[r, c, slot] += 1
            same = True
            for k in range(AROUND):
                known = depths[r, c, slot, k]
                if known == 0:
                    depths[r, c, slot, k] = here[k]
                elif here[k] > 0 and abs(here[k] - known) <= tolerance * known:
                    depths[r, c, slot, k] += (here[k] - known) / count[r, c, slot]
                same = same and depths[r, c, slot, k] == known
            told[r, c] = slot + 1 if same else 0
