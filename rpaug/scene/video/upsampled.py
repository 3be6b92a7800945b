"""Instance ids of a small image at full size, along the edges that the full image shows.

Joint bilateral upsampling (Kopf et al. 2007) of labels: near an outline a pixel takes the id whose inside is near and
of its color. The small outlines themselves do not vote: they are off by some pixels, and mixed.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Int, Int32, UInt8, UInt16

from rpaug.core.jit import kernel
from rpaug.core.pixels import grown

REACH = 5  # small pixels around a full one that are asked
RIM = 2  # small pixels along an outline that are not asked
NEAR = 2.5  # small pixels: standard deviation of their weight
ALIKE = 10.0  # levels of color: the same
MOST = 12  # ids that are told apart around one pixel


def upsampled(
    ids: UInt16[np.ndarray, "a b"], rgb: UInt8[np.ndarray, "h w 3"]
) -> Int32[np.ndarray, "h w"]:
    """The ids of a small image for `rgb`, the same image at full size."""
    size = rgb.shape[1], rgb.shape[0]
    out = cv2.resize(ids, size, interpolation=cv2.INTER_NEAREST).astype(np.int32)
    if out.shape == ids.shape:
        return out
    small = cv2.resize(rgb, ids.shape[::-1], interpolation=cv2.INTER_AREA)
    ends = _outlines(ids)
    near = cv2.resize(grown(ends, RIM + 1).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    told = np.zeros(ids.shape, bool)
    for rim in range(RIM, -1, -1):  # of thin things less is left out
        told |= ~grown(ends, rim) & ~np.isin(ids, np.unique(ids[told]))
    told |= ~np.isin(ids, np.unique(ids[told]))
    far = np.arange(256, dtype=np.float32)
    _vote(ids.astype(np.int32), told, small, rgb, near > 0, np.exp(-((far / ALIKE) ** 2) / 2), out)
    return out


def _outlines(ids: UInt16[np.ndarray, "a b"]) -> Bool[np.ndarray, "a b"]:
    """Pixels beside one of another id."""
    flat = ids.astype(np.float32)
    return np.asarray(cv2.dilate(flat, np.ones((3, 3))) != cv2.erode(flat, np.ones((3, 3))))


@kernel
def _vote(
    ids: Int32[np.ndarray, "a b"],
    told: Bool[np.ndarray, "a b"],
    small: UInt8[np.ndarray, "a b 3"],
    rgb: UInt8[np.ndarray, "h w 3"],
    near: Bool[np.ndarray, "h w"],
    alike: np.ndarray,
    out: Int32[np.ndarray, "h w"],
) -> None:
    """The id of most weight for each pixel that is near an outline; what none is like keeps its own."""
    height, width = near.shape
    rows, columns = ids.shape
    across = (2 * REACH + 1) ** 2
    names, weights = np.empty(MOST, np.int32), np.empty(MOST, np.float32)
    place, slots = np.empty((across, 2), np.int64), np.empty(across, np.int64)
    colors = np.empty((across, 3), np.int64)
    down, over = np.empty(2 * REACH + 1, np.float32), np.empty(2 * REACH + 1, np.float32)
    for r in range(height):
        y = (r + 0.5) * rows / height - 0.5
        j = int(np.rint(y))
        for k in range(2 * REACH + 1):
            down[k] = np.exp(-((j - REACH + k - y) ** 2) / (2 * NEAR * NEAR))
        asked, count, voters = -1, 0, 0  # full pixels of one small one are asked about the same
        for c in range(width):
            if not near[r, c]:
                continue
            x = (c + 0.5) * columns / width - 0.5
            i = int(np.rint(x))
            if i != asked:
                asked = i
                count, voters = _around(ids, told, small, j, i, names, place, slots, colors)
            if count == 0 or (count == 1 and names[0] == out[r, c]):
                continue
            for k in range(2 * REACH + 1):
                over[k] = np.exp(-((i - REACH + k - x) ** 2) / (2 * NEAR * NEAR))
            weights[:count] = 0
            red, green, blue = (
                np.int64(rgb[r, c, 0]),
                np.int64(rgb[r, c, 1]),
                np.int64(rgb[r, c, 2]),
            )
            for n in range(voters):
                off = max(
                    abs(red - colors[n, 0]), abs(green - colors[n, 1]), abs(blue - colors[n, 2])
                )
                weights[slots[n]] += alike[off] * down[place[n, 0]] * over[place[n, 1]]
            best, most = out[r, c], np.float32(1e-3)
            for slot in range(count):
                if weights[slot] > most:
                    best, most = names[slot], weights[slot]
            out[r, c] = best


@kernel
def _around(
    ids: Int32[np.ndarray, "a b"],
    told: Bool[np.ndarray, "a b"],
    small: UInt8[np.ndarray, "a b 3"],
    j: int,
    i: int,
    names: Int32[np.ndarray, "m"],
    place: Int[np.ndarray, "n 2"],
    slots: Int[np.ndarray, "n"],
    colors: Int[np.ndarray, "n 3"],
) -> tuple[int, int]:
    """How many ids the small pixels around (j, i) have that vote, and how many do: fills the ids, and of each voter
    its place in the window, its id's number and its color."""
    rows, columns = ids.shape
    count, voters = 0, 0
    for v in range(max(j - REACH, 0), min(j + REACH + 1, rows)):
        for u in range(max(i - REACH, 0), min(i + REACH + 1, columns)):
            if not told[v, u]:
                continue
            slot = 0
            while slot < count and names[slot] != ids[v, u]:
                slot += 1
            if slot == count:
                if count == MOST:
                    continue
                names[slot], count = ids[v, u], count + 1
            place[voters, 0], place[voters, 1] = v - j + REACH, u - i + REACH
            slots[voters] = slot
            for k in range(3):
                colors[voters, k] = small[v, u, k]
            voters += 1
    return count, voters
