"""One frame of a video with its pose, and its segments: parts of even color, cut where colors change."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, UInt8

from rpaug.core import geometry

SCALE = 150.0  # larger segments for larger values
LOOK_WIDTH = 480  # pixels, at most, in which instance ids are told
LEAST = 2.3e-4  # share of the image of the smallest segment
BLUR = 0.6  # pixels
TINT, LIGHT = 1.6, 0.6  # of chroma and lightness: shade divides a thing less than another color


def reduced_size(width: int, height: int, most: int) -> tuple[int, int]:
    """Width and height of an image that is made at most `most` pixels wide."""
    factor = min(1.0, most / width)
    return round(width * factor), round(height * factor)


def reduced(image: UInt8[np.ndarray, "h w 3"], most: int) -> UInt8[np.ndarray, "h2 w2 3"]:
    """An image made at most `most` pixels wide."""
    size = reduced_size(image.shape[1], image.shape[0], most)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def reduced_lens(
    K: Float64[np.ndarray, "3 3"], width: int, height: int, most: int
) -> Float64[np.ndarray, "3 3"]:
    """The lens of such an image, from that of the full one: edges of pixels scale, centers lie half a pixel inside."""
    size = reduced_size(width, height, most)
    sx, sy = size[0] / width, size[1] / height
    return np.array([[sx, 0, (sx - 1) / 2], [0, sy, (sy - 1) / 2], [0, 0, 1]]) @ K


def segments(rgb: UInt8[np.ndarray, "h w 3"]) -> Int32[np.ndarray, "h w"]:
    """Segments by minimum spanning forests (Felzenszwalb and Huttenlocher 2004) in CIELAB, numbered from 0."""
    lab = cv2.cvtColor(cv2.bilateralFilter(rgb, 5, 25, 5), cv2.COLOR_RGB2LAB).astype(np.float32)
    weighed = np.stack(
        [LIGHT * lab[..., 0], *(128 + TINT * (lab[..., k] - 128) for k in (1, 2))], -1
    )
    least = max(2, round(LEAST * rgb.shape[0] * rgb.shape[1]))
    made = cv2.ximgproc.segmentation.createGraphSegmentation(BLUR, SCALE, least)
    found = made.processImage(np.clip(np.rint(weighed), 0, 255).astype(np.uint8))
    return np.asarray(found, np.int32)


class SmallFrames:
    """A video's frames at the size of `PosedFrame` and their segments, each made once for all who ask; segments are
    held packed."""

    def __init__(self) -> None:
        self._images: dict[int, UInt8[np.ndarray, "h w 3"]] = {}
        self._packed: dict[int, bytes] = {}

    def image(
        self, t: int, full: Callable[[], UInt8[np.ndarray, "h2 w2 3"]]
    ) -> UInt8[np.ndarray, "h w 3"]:
        """The recorded frame `t`, which `full` gives as a pinhole image of full size."""
        if t not in self._images:
            self._images[t] = reduced(full(), LOOK_WIDTH)
        return self._images[t]

    def segments(self, t: int, rgb: UInt8[np.ndarray, "h w 3"]) -> Int32[np.ndarray, "h w"]:
        """The segments of the recorded frame `t`, which shows `rgb`."""
        if t not in self._packed:
            found = segments(rgb)
            self._packed[t] = zlib.compress(found.tobytes(), 1)
            return found
        held = np.frombuffer(zlib.decompress(self._packed[t]), np.int32)
        return held.reshape(rgb.shape[:2])


@dataclass(frozen=True, eq=False)
class PosedFrame:
    """One frame: its image made small, depth, lens and pose, in a world whose z is up.

    `piece` is the piece of the video's model that it belongs to, `sighted` are that model's points which it saw itself:
    of them alone the depth was measured.
    """

    rgb: UInt8[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]
    K: Float64[np.ndarray, "3 3"]
    cam_to_world: Float64[np.ndarray, "4 4"]
    hidden: Bool[np.ndarray, "h w"] | None = (
        None  # what moves by itself, and is no thing of the world
    )
    segmented: Callable[[UInt8[np.ndarray, "h w 3"]], Int32[np.ndarray, "h w"]] = segments
    piece: int = 0
    sighted: Float64[np.ndarray, "n 3"] = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def moves(self) -> Bool[np.ndarray, "h w"]:
        """What is `hidden`, pixel by pixel."""
        return np.zeros(self.depth.shape, bool) if self.hidden is None else self.hidden

    @cached_property
    def segments(self) -> Int32[np.ndarray, "h w"]:
        """Its segments, numbered from 0."""
        return self.segmented(self.rgb)

    @cached_property
    def points(self) -> Float64[np.ndarray, "h w 3"]:
        """Where its pixels lie in the world."""
        return geometry.transform(
            self.cam_to_world, geometry.unproject(self.depth.astype(np.float64), self.K)
        )

    def sees(
        self, points: Float64[np.ndarray, "*n 3"]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Row and column of points in this frame, and their depth; -1 for what is outside of it."""
        local = geometry.transform(geometry.inverse(self.cam_to_world), points)
        z = local[..., 2]
        ahead = np.maximum(z, 1e-9)
        column, row = geometry.to_image(local, ahead, self.K)
        height, width = self.depth.shape
        inside = (z > 0) & (row > -0.5) & (column > -0.5)
        inside &= (row < height - 0.5) & (column < width - 0.5)
        whole = [np.where(inside, np.rint(np.where(inside, v, 0)), -1) for v in (row, column)]
        return whole[0].astype(np.int64), whole[1].astype(np.int64), z
