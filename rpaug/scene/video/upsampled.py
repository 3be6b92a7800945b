"""Instance ids of a small image at full size, along the edges that the full image shows.

Joint bilateral upsampling (Kopf et al. 2007) of labels: near an outline a pixel takes the id whose inside is near and
of its color. The small outlines themselves do not vote: they are off by some pixels, and mixed.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Int32, UInt8, UInt16

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
    names, weights = np.empty(MOST, np.int32), np.empty(MOST, np.float32)
    for r in range(height):
        for c in range(width):
            if not near[r, c]:
                continue
            y, x = (r + 0.5) * rows / height - 0.5, (c + 0.5) * columns / width - 0.5
            j, i = int(np.rint(y)), int(np.rint(x))
            count, best, most = 0, out[r, c], np.float32(1e-3)
            for v in range(max(j - REACH, 0), min(j + REACH + 1, rows)):
                for u in range(max(i - REACH, 0), min(i + REACH + 1, columns)):
                    if not told[v, u]:
                        continue
                    off = np.int64(0)
                    for k in range(3):
                        off = np.maximum(
                            off, abs(np.int64(rgb[r, c, k]) - np.int64(small[v, u, k]))
                        )
                    apart = ((v - y) ** 2 + (u - x) ** 2) / (2 * NEAR * NEAR)
                    weight = alike[off] * np.exp(np.float32(-apart))
                    slot = 0
                    while slot < count and names[slot] != ids[v, u]:
                        slot += 1
                    if slot == count:
                        if count == MOST:
                            continue
                        names[slot], weights[slot], count = ids[v, u], 0, count + 1
                    weights[slot] += weight
            for slot in range(count):
                if weights[slot] > most:
                    best, most = names[slot], weights[slot]
            out[r, c] = best
