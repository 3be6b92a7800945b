"""PNG files: checked whole, inflated once, their rows unfiltered here; written with what costs least for its bytes.

Kinds, chunks and filters are those of the PNG specification (W3C, third edition), sections 5, 9 and 11.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8, UInt16

from rpaug.core.errors import BadInput
from rpaug.core.jit import inlined, kernel

try:  # of the extra `fast`: the same bytes in half the time or less
    from zlib_ng import zlib_ng as zlib
except ImportError:
    import zlib  # type: ignore[no-redef]

SIGNATURE = b"\x89PNG\r\n\x1a\n"
CHANNELS = {
    0: (1, 1),
    2: (3, 3),
    3: (3, 1),
    4: (1, 2),
    6: (3, 4),
}  # by color type: decoded, stored
COLORS = {1: 0, 3: 2}  # color type by channels, of what is written
MAX_SIDE = 16384  # pixels: a larger header is taken for damage, before anything is allocated
MAX_PIXELS = 2**26  # of an image: twice what 8K video has; an episode keeps some as 64-bit numbers
NONE, SUB, UP, AVERAGE, PAETH = range(5)  # filters of rows
WINDOW, MEMORY = 15, 8  # of deflate, zlib's own


@dataclass(frozen=True)
class Png:
    """A PNG's header: size in pixels, bits a channel, channels as they decode (palettes have 3)."""

    width: int
    height: int
    bits: int
    channels: int
    stored: int  # samples a pixel in the file: a palette's index is one
    interlaced: bool

    @property
    def plain(self) -> bool:
        """Whether rows are bytes of samples, one after the other."""
        return self.bits == 8 and not self.interlaced


def check(path: Path | str, data: bytes) -> Png:
    """The header of a PNG whose chunks are all there and whole (section 5).

    OpenCV decodes a cut-off file into a half-grey picture without a word, so lengths and CRCs are checked here.
    Raises BadInput.
    """
    return _whole(path, data)[0]


def _whole(path: Path | str, data: bytes) -> tuple[Png, bytes]:
    """The header and the packed pixels, each chunk looked at once. Raises BadInput."""
    if data[:8] != SIGNATURE:
        raise BadInput(path, "signature", found=repr(data[:8]), expected="a PNG file")
    header, packed = None, []
    for kind, at, length in _chunks(path, data):
        if header is None:
            if kind != b"IHDR" or length != 13:
                raise BadInput(path, "first chunk", found=repr(kind), expected="IHDR")
            header = _header(path, data, at)
        elif kind == b"IDAT":
            packed.append(data[at : at + length])
    assert header is not None
    return header, b"".join(packed)


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


def check_size(path: Path | str, width: int, height: int) -> None:
    """That an image is of a size that is taken for one, before anything is allocated for it. Raises BadInput."""
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE and width * height <= MAX_PIXELS):
        expected = f"1 to {MAX_SIDE} pixels a side, at most {MAX_PIXELS} in all"
        raise BadInput(path, "size", found=f"{width}x{height}", expected=expected)


def _header(path: Path | str, data: bytes, at: int) -> Png:
    width, height, bits, color, _, _, interlaced = struct.unpack_from(">IIBBBBB", data, at)
    check_size(path, width, height)
    if color not in CHANNELS:
        raise BadInput(path, "color type", found=str(color), expected="one that PNG knows")
    decoded, stored = CHANNELS[color]
    return Png(width, height, bits, decoded, stored, bool(interlaced))


def decode(where: Path | str, data: bytes) -> UInt8[np.ndarray, "h w ..."]:
    """The checked image as stored: (h, w, 3) RGB or (h, w) grey, uint8; transparency is dropped. Raises BadInput."""
    header, packed = _whole(where, data)
    if header.bits > 8:
        raise BadInput(where, "bit depth", found=f"{header.bits} bits", expected="8 bits a channel")
    rows = _inflated(where, packed, header) if header.plain else b""
    image = (
        _unfiltered(where, rows, header) if header.plain and header.channels <= header.stored else
        _by_opencv(where, data)
    )  # fmt: skip
    if header.channels == 1:
        return image if image.ndim == 2 else np.ascontiguousarray(image[..., 0])
    return image if image.shape[2] == 3 else np.ascontiguousarray(image[..., :3])


def check_pixels(where: Path | str, data: bytes) -> None:
    """That a PNG decodes, without undoing its filters where rows are bytes. Raises BadInput."""
    header, packed = _whole(where, data)
    if not header.plain or header.channels > header.stored:
        decode(where, data)
        return
    rows = np.frombuffer(_inflated(where, packed, header), np.uint8)
    if rows[:: 1 + header.width * header.stored].max(initial=0) > PAETH:
        raise _unknown(where)


def _unknown(where: Path | str) -> BadInput:
    expected = "rows of filters 0 to 4"
    return BadInput(where, "image data", found="undecodable data", expected=expected)


def _inflated(path: Path | str, packed: bytes, header: Png) -> bytes:
    """The filtered rows, as many as the header says. Raises BadInput."""
    wanted = header.height * (1 + header.width * header.stored)
    try:
        rows = zlib.decompressobj().decompress(packed, wanted + 1)
    except zlib.error:  # type: ignore[misc]  # as zlib-ng types it
        raise BadInput(
            path, "image data", found="damaged pixels", expected=f"{wanted} bytes"
        ) from None
    if len(rows) != wanted:
        found = f"{len(rows)} bytes of pixels"
        raise BadInput(path, "image data", found=found, expected=f"{wanted} bytes")
    return rows


def _unfiltered(path: Path | str, rows: bytes, header: Png) -> UInt8[np.ndarray, "h w ..."]:
    width = header.width * header.stored
    image = np.empty((header.height, width), np.uint8)
    if not _unfilter(np.frombuffer(rows, np.uint8), header.stored, image):
        raise _unknown(path)
    shape = (header.height, header.width, header.stored)
    return image if header.stored == 1 else image.reshape(shape)


@kernel
def _unfilter(rows: UInt8[np.ndarray, "n"], step: int, image: UInt8[np.ndarray, "h w"]) -> bool:
    """Fill the `image`, whose rows are bytes, from `rows`, each of a filter's number and as many bytes.

    `step` is the bytes of a pixel: a filter foretells a byte from those of the pixels before, above and both. False
    if a row has a number that is no filter's.
    """
    height, width = image.shape
    nothing = np.zeros(width, np.uint8)
    for y in range(height):
        kind, packed = rows[y * (width + 1)], rows[y * (width + 1) + 1 : (y + 1) * (width + 1)]
        row, above = image[y], image[y - 1] if y else nothing
        if kind == NONE:
            row[:] = packed
        elif kind == SUB:
            row[:step] = packed[:step]
            for x in range(step, width):
                row[x] = packed[x] + row[x - step]
        elif kind == UP:
            for x in range(width):
                row[x] = packed[x] + above[x]
        elif kind == AVERAGE:
            for x in range(width):
                left = np.int64(row[x - step]) if x >= step else np.int64(0)
                row[x] = packed[x] + np.uint8((left + above[x]) >> 1)
        elif kind == PAETH:
            for x in range(min(step, width)):
                row[x] = packed[x] + above[x]
            for x in range(step, width):
                row[x] = packed[x] + _paeth(row[x - step], above[x], above[x - step])
        else:
            return False
    return True


@inlined
def _paeth(left: int, up: int, corner: int) -> int:
    """The one of three bytes that is nearest to left + up - corner (section 9.4).

    The first two cases follow from it; a processor foresees them, and need not wait for the pixel before.
    """
    if left == corner:
        return up
    if up == corner:
        return left
    over, under = np.int32(up) - np.int32(corner), np.int32(left) - np.int32(corner)
    a, b, c = abs(over), abs(under), abs(over + under)
    return left if a <= b and a <= c else up if b <= c else corner


def _by_opencv(where: Path | str, data: bytes) -> UInt8[np.ndarray, "h w ..."]:
    """Palettes, interlaced images and rows of single bits."""
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise BadInput(where, "image data", found="undecodable data", expected="a PNG image")
    return image if image.ndim == 2 else np.ascontiguousarray(image[..., 2::-1])


def encode(
    image: UInt8[np.ndarray, "h w ..."] | UInt16[np.ndarray, "h w"], level: int = 1
) -> bytes:
    """PNG bytes of an RGB or single-channel image of 8 or 16 bits; the same pixels give the same bytes.

    Rows are filtered by Paeth and packed by runs (docs/why/files.md#png). A `level` of 0 packs nothing, for what is
    read again at once. Raises ValueError for an image of another kind.
    """
    channels = 1 if image.ndim == 2 else image.shape[2]
    if image.dtype not in (np.uint8, np.uint16) or channels not in COLORS or 0 in image.shape:
        raise ValueError(f"cannot encode an image of shape {image.shape}, {image.dtype}")
    height, width = image.shape[:2]
    step = channels * image.itemsize
    stored = np.ascontiguousarray(image.astype(image.dtype.newbyteorder(">"), copy=False))
    flat = stored.view(np.uint8).reshape(height, width * step)
    packer = zlib.compressobj(level, zlib.DEFLATED, WINDOW, MEMORY, zlib.Z_RLE)
    packed = packer.compress(_filtered(flat, step, PAETH if level else NONE)) + packer.flush()
    header = struct.pack(">IIBBBBB", width, height, 8 * image.itemsize, COLORS[channels], 0, 0, 0)
    chunks = (_chunk(b"IHDR", header), _chunk(b"IDAT", packed), _chunk(b"IEND", b""))
    return SIGNATURE + b"".join(chunks)


def _chunk(kind: bytes, data: bytes) -> bytes:
    crc = zlib.crc32(data, zlib.crc32(kind))
    return b"".join((struct.pack(">I", len(data)), kind, data, struct.pack(">I", crc)))


@kernel
def _filtered(image: UInt8[np.ndarray, "h w"], step: int, kind: int) -> UInt8[np.ndarray, "n"]:
    """Each row's filter, Paeth or none, and what it leaves of the row's bytes.

    In bytes throughout, and by choices in place of branches, so that a processor does 32 of them at once: with up and
    left on the same side of the corner their sum is the farthest of the three, otherwise the third distance is the
    difference of the other two.
    """
    height, width = image.shape
    out = np.empty((height, width + 1), np.uint8)
    out[:, 0] = kind
    nothing = np.zeros(width, np.uint8)
    for y in range(height):
        row, above, kept = image[y], image[y - 1] if y else nothing, out[y, 1:]
        if kind == NONE:
            kept[:] = row
            continue
        for x in range(min(step, width)):
            kept[x] = row[x] - above[x]
        here, before, rest = row[step:], row[: width - step], kept[step:]
        over, beyond = above[step:], above[: width - step]
        for x in range(width - step):
            left, up, corner = before[x], over[x], beyond[x]
            a = np.uint8(max(up, corner) - min(up, corner))
            b = np.uint8(max(left, corner) - min(left, corner))
            least, most = min(a, b), max(a, b)
            near = left if a <= b else up
            same = (up >= corner) == (left >= corner)
            rest[x] = here[x] - (near if same or least <= np.uint8(most - least) else corner)
    return out.reshape(-1)
