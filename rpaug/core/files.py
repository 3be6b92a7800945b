"""Files that are either whole or absent, and images that are checked before they are decoded.

`rpaug.files` to whoever writes an adapter, who may rely on the names in `__all__`: `read_bytes` and `write_atomic` for
whole files, `atomic_folder` for an episode that appears by one rename, `natural` for the order of keys, `check_*` for
the size of an image before anything is allocated for it, `decode_*` and `encode_*` for its pixels. What cannot be read
raises `BadInput`.
"""

import os
import re
import shutil
import stat
import struct
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from rpaug.core.errors import BadInput

__all__ = [
    "MAX_SIDE",
    "PART",
    "REJECTED",
    "Png",
    "atomic_folder",
    "check_image",
    "check_jpeg",
    "check_png",
    "decode_image",
    "decode_png",
    "encode_jpeg",
    "encode_png",
    "flush",
    "natural",
    "read_bytes",
    "write_atomic",
]

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PART = ".part"  # ending of the hidden folders in which output grows
REJECTED = "rejected"  # folder beside the episodes: copies that failed their gates
CHANNELS = {
    0: (1, 1),
    2: (3, 3),
    3: (3, 1),
    4: (1, 2),
    6: (3, 4),
}  # by color type: decoded, stored
SEGMENT = struct.Struct(">BBH")  # of a JPEG: 0xFF, its kind, its length
MAX_SIDE = 16384  # pixels: a larger header is taken for damage, before anything is allocated
MAX_PIXELS = 2**26  # of an image: twice what 8K video has; an episode keeps some as 64-bit numbers


def read_bytes(path: Path) -> bytes:
    """The whole file. Raises BadInput if it cannot be read, or is none (a pipe would never end)."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            found = "a folder" if path.is_dir() else "a pipe, a socket or a device"
            raise BadInput(path, "file", found=found, expected="a regular file")
        return path.read_bytes()
    except FileNotFoundError:
        raise BadInput(path, "file", found="nothing", expected="a file") from None
    except OSError as error:
        raise BadInput(
            path, "file", found=error.strerror or "an I/O error", expected="a readable file"
        ) from None


@dataclass(frozen=True)
class Png:
    """A PNG's header: size in pixels, bits a channel, channels as they decode (palettes have 3)."""

    width: int
    height: int
    bits: int
    channels: int
    stored: int  # samples a pixel in the file: a palette's index is one
    interlaced: bool


def check_png(path: Path | str, data: bytes) -> Png:
    """The header of a PNG whose chunks are all there and whole (PNG spec, section 5).

    OpenCV decodes a cut-off file into a half-grey picture without a word, so lengths and CRCs are checked here.
    Raises BadInput.
    """
    if data[:8] != PNG_SIGNATURE:
        raise BadInput(path, "signature", found=repr(data[:8]), expected="a PNG file")
    header = None
    for kind, at, length in _chunks(path, data):
        if header is None:
            if kind != b"IHDR" or length != 13:
                raise BadInput(path, "first chunk", found=repr(kind), expected="IHDR")
            header = _header(path, data, at)
    assert header is not None
    return header


def _chunks(path: Path | str, data: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Kind, place and length of each chunk's data, up to IEND. Raises BadInput for a damaged one."""
    at, kind = 8, b""
    while kind != b"IEND":
        if at + 12 > len(data):
            raise BadInput(
                path,
                "length",
                found=f"{len(data)} bytes, cut off",
                expected="a whole PNG, up to its IEND chunk",
            )
        (length,) = struct.unpack_from(">I", data, at)
        kind = data[at + 4 : at + 8]
        end = at + 12 + length
        if end > len(data):
            raise BadInput(
                path,
                f"chunk {kind!r}",
                found=f"{len(data)} bytes, cut off",
                expected=f"{end} bytes or more",
            )
        (crc,) = struct.unpack_from(">I", data, end - 4)
        if zlib.crc32(data[at + 4 : end - 4]) != crc:
            raise BadInput(
                path, f"chunk {kind!r}", found="a wrong checksum", expected="an undamaged PNG"
            )
        yield kind, at + 8, length
        at = end


def _check_size(path: Path | str, width: int, height: int) -> None:
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE and width * height <= MAX_PIXELS):
        expected = f"1 to {MAX_SIDE} pixels a side, at most {MAX_PIXELS} in all"
        raise BadInput(path, "size", found=f"{width}x{height}", expected=expected)


def _header(path: Path | str, data: bytes, at: int) -> Png:
    width, height, bits, color, _, _, interlaced = struct.unpack_from(">IIBBBBB", data, at)
    _check_size(path, width, height)
    if color not in CHANNELS:
        raise BadInput(path, "color type", found=str(color), expected="one that PNG knows")
    decoded, stored = CHANNELS[color]
    return Png(width, height, bits, decoded, stored, bool(interlaced))


def decode_png(path: Path) -> UInt8[np.ndarray, "h w ..."]:
    """The checked image as stored: (h, w, 3) RGB or (h, w) grey, uint8; transparency is dropped. Raises BadInput."""
    return _png_pixels(path, read_bytes(path))


def _png_pixels(where: Path | str, data: bytes) -> UInt8[np.ndarray, "h w ..."]:
    header = check_png(where, data)
    if header.bits > 8:
        raise BadInput(where, "bit depth", found=f"{header.bits} bits", expected="8 bits a channel")
    _check_pixels(where, data, header)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise BadInput(where, "image data", found="undecodable data", expected="a PNG image")
    if image.ndim == 2:
        return image
    return np.ascontiguousarray(image[..., 2::-1] if image.shape[2] >= 3 else image[..., 0])


def _check_pixels(path: Path | str, data: bytes, header: Png) -> None:
    """That the compressed pixels are as many as the header says, before a decoder complains in its own words."""
    if header.interlaced or header.bits != 8:
        return  # rows are packed otherwise; the decoder judges
    wanted = header.height * (1 + header.width * header.stored)
    packed = b"".join(data[at : at + n] for kind, at, n in _chunks(path, data) if kind == b"IDAT")
    try:
        found = len(zlib.decompressobj().decompress(packed, wanted + 1))
    except zlib.error:
        found = -1
    if found != wanted:
        count = "damaged pixels" if found < 0 else f"{found} bytes of pixels"
        raise BadInput(path, "image data", found=count, expected=f"{wanted} bytes")


def check_jpeg(path: Path | str, data: bytes) -> tuple[int, int]:
    """Width and height of a JPEG that runs from its start to its end marker (ITU T.81, annex B). Raises BadInput."""
    if data[:2] != b"\xff\xd8":
        raise BadInput(path, "signature", found=repr(data[:2]), expected="a JPEG file")
    if data.rfind(b"\xff\xd9", -64) < 0:  # some writers pad the end
        raise BadInput(path, "end", found="no end marker", expected="a whole JPEG")
    at = 2
    while at + 9 <= len(data):
        mark, kind, length = SEGMENT.unpack_from(data, at)
        if mark != 0xFF:
            break
        if kind == 0xFF:  # a fill byte
            at += 1
            continue
        if 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", data, at + 5)
            _check_size(path, width, height)
            return width, height
        at += 2 + length
    raise BadInput(path, "frame header", found="none", expected="a JPEG with a size")


def decode_image(where: Path | str, data: bytes | None = None) -> UInt8[np.ndarray, "h w ..."]:
    """A checked PNG or JPEG: (h, w, 3) RGB or (h, w) single-channel, uint8. Raises BadInput.

    `where` is the file, or, with `data` given, what to call the place that the bytes came from.
    """
    data = read_bytes(Path(where)) if data is None else data
    if data[:2] != b"\xff\xd8":
        return _png_pixels(where, data)
    check_jpeg(where, data)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise BadInput(where, "image data", found="undecodable data", expected="a JPEG image")
    return np.ascontiguousarray(image[..., ::-1])


def check_image(where: Path | str, data: bytes) -> tuple[int, int]:
    """Width and height of a whole PNG or JPEG. Raises BadInput."""
    if data[:2] == b"\xff\xd8":
        return check_jpeg(where, data)
    if data[: len(PNG_SIGNATURE)] != PNG_SIGNATURE:
        raise BadInput(where, "signature", found=repr(data[:8]), expected="a PNG or a JPEG")
    header = check_png(where, data)
    return header.width, header.height


def encode_jpeg(image: UInt8[np.ndarray, "h w 3"]) -> bytes:
    """JPEG bytes of an RGB image at the best quality with full chroma: what was not edited comes back nearly as it was
    (docs/why/jpeg.md)."""
    options = [
        cv2.IMWRITE_JPEG_QUALITY, 100,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
    ]  # fmt: skip
    done, data = cv2.imencode(".jpg", np.ascontiguousarray(image[..., ::-1]), options)
    if not done:
        raise ValueError(f"cannot encode an image of shape {image.shape}, {image.dtype}")
    return data.tobytes()


def encode_png(image: UInt8[np.ndarray, "h w ..."], level: int = 3) -> bytes:
    """PNG bytes of an RGB or single-channel uint8 image; the same pixels give the same bytes.

    `level` of compression: 0 (none, for what is read again at once) to 9.
    """
    if image.ndim == 3:
        image = image[..., ::-1]
    done, data = cv2.imencode(
        ".png", np.ascontiguousarray(image), [cv2.IMWRITE_PNG_COMPRESSION, level]
    )
    if not done:
        raise ValueError(f"cannot encode an image of shape {image.shape}, {image.dtype}")
    return data.tobytes()


def apart(target: Path, source: Path) -> None:
    """See that an output does not lie in the dataset that it is made from. Raises BadInput."""
    if target.resolve().is_relative_to(source.resolve()):
        expected = "a path outside it: what lies in it is read as part of it"
        raise BadInput(target, "--out", found="a path inside the dataset", expected=expected)


@contextmanager
def atomic_folder(target: Path) -> Iterator[Path]:
    """A temporary folder beside `target` that becomes `target` in one rename if the block succeeds.

    On any failure (a full disk among them) the temporary folder is removed and `target` never appears. Raises
    BadInput if `target` exists already.
    """
    if target.exists():
        raise BadInput(
            target, "output", found="something there already", expected="a path that does not exist"
        )
    made = partial(tempfile.mkdtemp, PART, f".{target.name}-", target.parent)
    try:
        work = Path(made())
    except FileNotFoundError:  # the first there
        target.parent.mkdir(parents=True, exist_ok=True)
        work = Path(made())
    try:
        work.chmod(0o755)
        yield work
        os.replace(work, target)
    except BaseException:
        shutil.rmtree(work, ignore_errors=True)
        raise


def natural(key: str) -> str:
    """For sorting: numbers in a key count as numbers. One string a key, since a run sorts hundred thousands of them."""
    return "\0".join(
        part if not part.isdecimal() else f"{len(str(int(part))):04d}{int(part)}"
        for part in re.split(r"(\d+)", key)
    )


def flush(path: Path) -> None:
    """See a file's bytes onto the disk, before what they were made of is removed."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_atomic(target: Path, data: bytes, durable: bool = False) -> None:
    """Write a file so that it is either the old one or the whole new one; a `durable` one after a power cut as well."""
    target.parent.mkdir(parents=True, exist_ok=True)
    descriptor, work = tempfile.mkstemp(prefix=f".{target.name}-", suffix=PART, dir=target.parent)
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(data)
            if durable:
                stream.flush()
                os.fsync(stream.fileno())
        os.chmod(work, 0o644)
        os.replace(work, target)
    except BaseException:
        Path(work).unlink(missing_ok=True)
        raise
