"""An image laid on surfaces: which texels each point shows, averaged over what a pixel covers.

Coordinates are those of the texture's own frame, in metres. Each axis has a picture seen from outside along it, upright
where z points up; on the two z faces y points up. Pixels that cover several texels read a smaller copy of the image
(mip mapping, Williams 1983), so that a fine pattern neither glitters nor swims.
"""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float32, Int64, UInt8

from rpaug.core.jit import kernel

Mapping = Literal["triplanar", "box", "planar"]

MOST_TEXELS = 2048  # a side: larger images are scaled down first
SHARPNESS = 6.0  # power of a normal's component with which its axis counts in triplanar mapping
WIDTH = 0.75  # of a pixel's width, that is averaged over: reading between texels blurs by itself
FAINT = 0.03  # share of one axis below which it is left out


@dataclass(frozen=True)
class Texture:
    """An image with its smaller copies, each half the size of the one before, one after the other in `texels`.

    `mirror`: every other repeat is turned over, so that an image that was not made to repeat shows no seam.
    """

    texels: UInt8[np.ndarray, "n 3"]
    sizes: Int64[np.ndarray, "levels 3"]  # first texel, rows, columns
    mirror: bool = False

    @classmethod
    def of(cls, image: UInt8[np.ndarray, "h w 3"], mirror: bool = False) -> "Texture":
        """The pyramid of an image, which is scaled down first if a side has more than `MOST_TEXELS`."""
        longest = max(image.shape[:2])
        if longest > MOST_TEXELS:
            image = _shrunk(image, MOST_TEXELS / longest)
        copies, sizes, start = [image], [(0, *image.shape[:2])], 0
        while max(image.shape[:2]) > 1:
            start += image.shape[0] * image.shape[1]
            image = _shrunk(image, 0.5)
            copies.append(image)
            sizes.append((start, *image.shape[:2]))
        return cls(
            np.concatenate([copy.reshape(-1, 3) for copy in copies]), np.array(sizes), mirror
        )

    def on(
        self,
        points: Float32[np.ndarray, "n 3"],
        normals: Float32[np.ndarray, "n 3"],
        footprint: Float32[np.ndarray, "n"],
        scale: float,
        mapping: Mapping,
    ) -> Float32[np.ndarray, "n 3"]:
        """Colors 0..1 at points of the texture's frame; `scale` is the metres that the image is wide.

        `triplanar` blends the three axes' pictures by the normal, `box` takes the one the normal is nearest to,
        `planar` always the one along z.
        """
        sharpness = {"triplanar": SHARPNESS, "box": 0.0, "planar": -1.0}[mapping]
        return _on(
            self.texels, self.sizes, self.mirror, points, normals, footprint, scale, sharpness
        )


def _shrunk(image: UInt8[np.ndarray, "h w 3"], factor: float) -> UInt8[np.ndarray, "h w 3"]:
    size = [max(1, round(side * factor)) for side in image.shape[1::-1]]
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


@kernel
def _on(
    texels: UInt8[np.ndarray, "n 3"],
    sizes: Int64[np.ndarray, "levels 3"],
    mirror: bool,
    points: Float32[np.ndarray, "n 3"],
    normals: Float32[np.ndarray, "n 3"],
    footprint: Float32[np.ndarray, "n"],
    scale: float,
    sharpness: float,
) -> Float32[np.ndarray, "n 3"]:
    out = np.zeros((len(points), 3), np.float32)
    share, found = np.zeros(3), np.zeros(3)
    per_metre = sizes[0, 2] / scale
    tall = sizes[0, 2] / sizes[0, 1]
    for n in range(len(points)):
        _shares(normals[n], sharpness, share)
        level = np.log2(max(WIDTH * footprint[n] * per_metre, 1.0))
        level = min(level, len(sizes) - 1.0)
        for axis in range(3):
            if share[axis] == 0:
                continue
            u, v = _plane(points[n], normals[n], axis, sharpness < 0)
            _sample(texels, sizes, mirror, u / scale, -v / scale * tall, level, found)
            for k in range(3):
                out[n, k] += share[axis] * found[k]
    return out


@kernel
def _shares(normal: np.ndarray, sharpness: float, share: np.ndarray) -> None:
    """How much each axis' picture counts."""
    share[:] = 0.0
    if sharpness < 0:
        share[2] = 1.0
        return
    if sharpness == 0:
        share[np.argmax(np.abs(normal))] = 1.0
        return
    total = 0.0
    for axis in range(3):
        share[axis] = abs(normal[axis]) ** sharpness
        total += share[axis]
    rest = 0.0
    for axis in range(3):
        share[axis] /= total
        if share[axis] < FAINT:
            share[axis] = 0.0
        rest += share[axis]
    for axis in range(3):
        share[axis] /= rest


@kernel
def _plane(point: np.ndarray, normal: np.ndarray, axis: int, along: bool) -> tuple[float, float]:
    """Right and up, in metres, on the picture that is seen along one axis from outside (`along`: from above)."""
    turned = normal[axis] < 0 and not along
    if axis == 0:
        return (-point[1] if turned else point[1]), point[2]
    if axis == 1:
        return (point[0] if turned else -point[0]), point[2]
    return (-point[0] if turned else point[0]), point[1]


@kernel
def _sample(
    texels: np.ndarray,
    sizes: np.ndarray,
    mirror: bool,
    u: float,
    v: float,
    level: float,
    out: np.ndarray,
) -> None:
    """Trilinear: u right and v down, in repeats of the image; `level` halvings, blended between whole ones."""
    out[:] = 0.0
    low = int(level)
    u, v = _repeat(u, mirror), _repeat(v, mirror)
    for step in range(2):
        weight = level - low if step else 1.0 - (level - low)
        if weight == 0:
            continue
        start, rows, columns = sizes[low + step]
        x, y = u * columns - 0.5, v * rows - 0.5
        left, top = int(np.floor(x)), int(np.floor(y))
        right_part, lower_part = x - left, y - top
        for j in range(2):
            row = start + _inside(top + j, rows, mirror) * columns
            down = weight * (lower_part if j else 1 - lower_part)
            for i in range(2):
                part = down * (right_part if i else 1 - right_part)
                texel = row + _inside(left + i, columns, mirror)
                for k in range(3):
                    out[k] += part * texels[texel, k]
    for k in range(3):
        out[k] /= 255.0


@kernel
def _repeat(value: float, mirror: bool) -> float:
    """Where in the image, 0..1, a coordinate of its endless repeats lies."""
    if not mirror:
        return value - np.floor(value)
    value -= 2 * np.floor(value / 2)
    return 2 - value if value > 1 else value


@kernel
def _inside(index: int, size: int, mirror: bool) -> int:
    """The texel one step outside the image: of the next repeat, or of the same edge if that one is turned over."""
    if index < 0:
        return 0 if mirror else size - 1
    if index >= size:
        return size - 1 if mirror else 0
    return index
