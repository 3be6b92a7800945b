"""Pixels in RLDS that are no encoded color: depth and instance ids as PNG of one channel, float images, tensors plain
or packed; and color stored as a tensor, of bytes or of floats in 0..1 or 0..255."""

import math
import zlib
from collections.abc import Callable, Sequence
from functools import cache

import cv2
import numpy as np
from jaxtyping import UInt8
from rpaug_adapters.rlds.example import Example
from rpaug_adapters.rlds.features import Leaf
from rpaug_adapters.shared.images import luma, three_channels

from rpaug import BadInput, CameraView, files

NUMERIC = frozenset(
    ["", "bool", *(f"{kind}{bits}" for kind in ("int", "uint") for bits in (8, 16, 32, 64))]
) | {"float16", "float32", "float64"}
PACKED = ("zlib", "bytes")  # encodings of TFDS tensors that are one byte string a step


def decoder(
    example: Example, leaf: Leaf, shape: tuple[int, ...], length: int
) -> Callable[[int], np.ndarray]:
    """A function from a step to its values, (h, w), or (h, w, channels) of a tensor, of the feature's type. Raises
    BadInput."""
    if leaf.dtype not in NUMERIC or (leaf.dtype == "" and leaf.kind != "Image"):
        expected = f"one of {', '.join(sorted(NUMERIC))}"
        raise BadInput(example.where, f"{leaf.key}, dtype", found=leaf.dtype, expected=expected)
    if leaf.kind == "Image" or leaf.encoding in PACKED:
        blobs = example.blobs(leaf.key)
        if len(blobs) != length:
            found = f"{len(blobs)} images"
            raise BadInput(example.where, leaf.key, found=found, expected=str(length))
        one = _image if leaf.kind == "Image" else _unpacked
        return lambda t: one(f"{example.where}, {leaf.key}, step {t}", leaf, shape, blobs[t])

    @cache
    def frames() -> np.ndarray:
        values = example.numbers(leaf.key)
        if len(values) != length * math.prod(shape):
            expected = f"{length} times {'x'.join(map(str, shape))}"
            found = f"{len(values)} numbers"
            raise BadInput(example.where, leaf.key, found=found, expected=expected)
        return values.reshape(length, *shape)

    return lambda t: frames()[t]


def _image(where: str, leaf: Leaf, shape: tuple[int, ...], data: bytes) -> np.ndarray:
    header = files.check_png(where, data)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is not None and leaf.dtype == "float32" and image.ndim == 3 and image.shape[2] == 4:
        # TFDS stores float images as the four bytes of each number, in RGBA.
        image = np.ascontiguousarray(image[..., [2, 1, 0, 3]]).view("<f4")[..., 0]
    if image is None or image.shape != shape:
        found = f"{header.width}x{header.height}, {header.channels} channel(s)"
        expected = f"{shape[1]}x{shape[0]}, one value a pixel"
        raise BadInput(where, "image", found=found, expected=expected)
    return image


def _unpacked(where: str, leaf: Leaf, shape: tuple[int, ...], data: bytes) -> np.ndarray:
    wanted = math.prod(shape) * np.dtype(leaf.dtype).itemsize
    try:
        raw = zlib.decompressobj().decompress(data, wanted + 1) if leaf.encoding == "zlib" else data
    except zlib.error:
        raw = b""
    if len(raw) != wanted:
        raise BadInput(where, "data", found="another size, or damage", expected=f"{wanted} bytes")
    return np.frombuffer(raw, leaf.dtype).reshape(shape)


class TensorColors:
    """Color that a tensor of the steps holds: bytes, or floats in 0..1 or in 0..255; gray, RGB or RGBA.

    Raises BadInput for any other numbers.
    """

    def __init__(self, example: Example, leaf: Leaf, length: int) -> None:
        shape = tuple(side or 0 for side in leaf.shape)
        if len(shape) not in (2, 3) or min(shape) < 1 or shape[2:] not in ((), (1,), (3,), (4,)):
            expected = "height x width, and 1, 3 or 4 channels"
            raise BadInput(example.where, leaf.key, found=str(leaf.shape), expected=expected)
        self.size = shape[1], shape[0]
        self.length = length
        self.stored = decoder(example, leaf, shape, length)
        self.scale = 1.0
        if np.dtype(leaf.dtype) != np.uint8:
            low, high = (
                float(extreme([extreme(self.stored(t)) for t in range(length)]))
                for extreme in (np.min, np.max)
            )
            if not 0 <= low <= high <= 255:
                found = f"{low:.3g} to {high:.3g}"
                raise BadInput(example.where, leaf.key, found=found, expected="0 to 1, or to 255")
            self.scale = 255.0 if high <= 1 else 1.0

    def __call__(self, t: int) -> UInt8[np.ndarray, "h w 3"]:
        """The image of step t."""
        image = np.rint(self.stored(t).astype(np.float64) * self.scale).astype(np.uint8)
        if image.ndim == 2 or image.shape[2] == 1:
            return three_channels(image.reshape(image.shape[:2]))
        return image[..., :3]

    def edited(self, view: CameraView) -> list[np.ndarray | None]:
        """What the tensor holds of a view's images, None where one is as recorded. Values that show the same stay."""
        frames: list[np.ndarray | None] = []
        for t in range(self.length):
            image, before = view.rgb(t), self(t)
            frame = None
            if not np.array_equal(image, before):
                frame = self.stored(t).copy()
                channels = frame.reshape(*frame.shape[:2], -1)[..., :3]
                if channels.shape[2] == 1:
                    image, before = luma(image)[..., None], before[..., :1]
                changed = image != before
                channels[changed] = (image / self.scale)[changed].astype(frame.dtype)
            frames.append(frame)
        return frames


def most_id(leaf: Leaf) -> int:
    """The largest whole number that a feature holds exactly, of those that masks have."""
    kind = np.dtype(leaf.dtype or "uint16")
    if kind.kind == "b":
        return 1
    most = 2 ** (np.finfo(kind).nmant + 1) if kind.kind == "f" else int(np.iinfo(kind).max)
    return min(most, CameraView.most_id)


def encoded(
    example: Example, leaf: Leaf, frames: Sequence[np.ndarray | None], before: Sequence[np.ndarray]
) -> Sequence[bytes] | np.ndarray:
    """The feature with new frames, None where one stays as it was, in the encoding it had."""
    if leaf.kind != "Image" and leaf.encoding not in PACKED:
        whole = [old if new is None else new for new, old in zip(frames, before, strict=True)]
        kind = example.features[leaf.key].kind
        return np.stack(whole).astype(np.float32 if kind == "float" else np.int64).ravel()
    blobs = example.blobs(leaf.key)
    return [
        data if frame is None else packed(leaf, frame)
        for data, frame in zip(blobs, frames, strict=True)
    ]


def packed(leaf: Leaf, frame: np.ndarray) -> bytes:
    """One frame as a byte string."""
    kind = np.dtype(leaf.dtype or "uint16")
    if kind.kind in "iu":
        frame = np.clip(np.rint(frame), np.iinfo(kind).min, np.iinfo(kind).max)
    values = np.ascontiguousarray(frame.astype(kind))
    if leaf.kind != "Image":
        raw = values.tobytes()
        return zlib.compress(raw) if leaf.encoding == "zlib" else raw
    if kind == np.float32:
        rgba = values[..., None].view(np.uint8)
        values = np.ascontiguousarray(rgba[..., [2, 1, 0, 3]])
    return cv2.imencode(".png", values)[1].tobytes()
