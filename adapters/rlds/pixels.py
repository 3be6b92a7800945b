"""Depth and handles in RLDS: PNG of one channel, float images, and tensors plain or packed, one value a pixel."""

import zlib
from collections.abc import Callable, Sequence
from functools import cache

import cv2
import numpy as np
from rpaug_adapters.rlds.example import Example
from rpaug_adapters.rlds.features import Leaf

from rpaug import BadInput, CameraView, files

NUMERIC = frozenset(
    ["", "bool", *(f"{kind}{bits}" for kind in ("int", "uint") for bits in (8, 16, 32, 64))]
) | {"float16", "float32", "float64"}
PACKED = ("zlib", "bytes")  # encodings of TFDS tensors that are one byte string a step


def decoder(
    example: Example, leaf: Leaf, shape: tuple[int, int], length: int
) -> Callable[[int], np.ndarray]:
    """A function from a step to its values, (h, w) of the feature's type. Raises BadInput."""
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
        if len(values) != length * shape[0] * shape[1]:
            expected = f"{length} times {shape[0]}x{shape[1]}"
            found = f"{len(values)} numbers"
            raise BadInput(example.where, leaf.key, found=found, expected=expected)
        return values.reshape(length, *shape)

    return lambda t: frames()[t]


def _image(where: str, leaf: Leaf, shape: tuple[int, int], data: bytes) -> np.ndarray:
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


def _unpacked(where: str, leaf: Leaf, shape: tuple[int, int], data: bytes) -> np.ndarray:
    wanted = shape[0] * shape[1] * np.dtype(leaf.dtype).itemsize
    try:
        raw = zlib.decompressobj().decompress(data, wanted + 1) if leaf.encoding == "zlib" else data
    except zlib.error:
        raw = b""
    if len(raw) != wanted:
        raise BadInput(where, "data", found="another size, or damage", expected=f"{wanted} bytes")
    return np.frombuffer(raw, leaf.dtype).reshape(shape)


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
