"""Spoilt PNG, JPEG and TIFF: chunks and segments changed one by one, with right checksums and right zlib streams."""

import struct
import zlib

import numpy as np
from trees import bytes_bent

EXTREMES = (0, 1, 2, 3, 7, 8, 16, 255, 16384, 16385, 65535, 2**31 - 1, 2**31, 2**32 - 1)
KINDS = (
    b"PLTE",
    b"tRNS",
    b"gAMA",
    b"iCCP",
    b"zTXt",
    b"iTXt",
    b"tEXt",
    b"acTL",
    b"fdAT",
    b"IDAT",
    b"eXIf",
)
BOMB = zlib.compress(bytes(2**24), 9)  # sixteen MiB of nothing in sixteen KiB


def chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    """Kind and payload of each."""
    found, at = [], 8
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        found.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    return found


def joined(parts: list[tuple[bytes, bytes]]) -> bytes:
    """A PNG of chunks, each with its right length and checksum."""
    out = [b"\x89PNG\r\n\x1a\n"]
    for kind, data in parts:
        out += [
            struct.pack(">I", len(data)),
            kind,
            data,
            struct.pack(">I", zlib.crc32(kind + data)),
        ]
    return b"".join(out)


def spoilt_png(data: bytes, rng: np.random.Generator) -> bytes:
    """A PNG in which one thing is wrong and all checksums are right; one in eight is bent blindly."""
    parts = chunks(data)
    if not parts:
        return bytes_bent(data, rng)
    at = int(rng.integers(len(parts)))
    head = bytearray(parts[0][1])
    match rng.integers(8):
        case 0:
            return bytes_bent(data, rng)
        case 1 if len(head) == 13:
            struct.pack_into(">I", head, int(rng.choice([0, 4])), int(rng.choice(EXTREMES)))
            parts[0] = (b"IHDR", bytes(head))
        case 2 if len(head) == 13:
            head[int(rng.integers(8, 13))] = (
                int(rng.integers(256)) if rng.random() < 0.5 else int(rng.integers(18))
            )
            parts[0] = (b"IHDR", bytes(head))
        case 3:
            rows = b"".join(body for kind, body in parts if kind == b"IDAT")
            try:
                raw = bytes_bent(zlib.decompress(rows), rng)
            except zlib.error:
                raw = b""
            parts = [(k, b) for k, b in parts if k != b"IDAT"]
            parts.insert(1, (b"IDAT", BOMB if rng.random() < 0.2 else zlib.compress(raw)))
        case 4:
            del parts[at]
        case 5:
            parts.insert(at, parts[int(rng.integers(len(parts)))])
        case 6:
            body = b"x\0\0" + BOMB if rng.random() < 0.3 else rng.bytes(int(rng.integers(40)))
            parts.insert(at, (KINDS[int(rng.integers(len(KINDS)))], body))
        case _:
            parts[at] = (parts[at][0], bytes_bent(parts[at][1], rng))
    return joined(parts)


def spoilt_jpeg(data: bytes, rng: np.random.Generator) -> bytes:
    """A JPEG with a segment changed: sizes, components, tables, lengths; or bent blindly."""
    marks = [
        at for at in range(2, len(data) - 4) if data[at] == 0xFF and 0xC0 <= data[at + 1] <= 0xFE
    ]
    if not marks or rng.random() < 0.2:
        return bytes_bent(data, rng)
    raw = bytearray(data)
    at = marks[int(rng.integers(len(marks)))]
    match rng.integers(5):
        case 0:
            raw[at + 1] = int(rng.integers(0xC0, 0xFF))
        case 1:
            struct.pack_into(">H", raw, at + 2, int(rng.choice([0, 1, 2, 3, 255, 65535])))
        case 2:
            for mark in marks:
                if data[mark + 1] in (0xC0, 0xC2):
                    place = mark + int(rng.integers(4, 18))
                    raw[place] = int(rng.choice([0, 1, 2, 3, 8, 12, 17, 34, 68, 255]))
        case 3:
            length = int.from_bytes(raw[at + 2 : at + 4], "big")
            raw[at:at] = raw[at : at + 2 + length]
        case _:
            span = slice(at + 4, at + 4 + int(rng.integers(1, 12)))
            raw[span] = rng.bytes(len(raw[span]))
    return bytes(raw)


def spoilt_tiff(data: bytes, rng: np.random.Generator) -> bytes:
    """A TIFF with an entry of its directory changed; or bent blindly."""
    raw = bytearray(data)
    try:
        (at,) = struct.unpack_from("<I", raw, 4)
        (count,) = struct.unpack_from("<H", raw, at)
        place = at + 2 + 12 * int(rng.integers(count))
        if rng.random() < 0.2:
            return bytes_bent(data, rng)
        offset, kind = ((0, "<H"), (2, "<H"), (4, "<I"), (8, "<I"))[int(rng.integers(4))]
        most = 2 ** (16 if kind == "<H" else 32) - 1
        struct.pack_into(kind, raw, place + offset, min(int(rng.choice(EXTREMES)), most))
    except (struct.error, ValueError):
        return bytes_bent(data, rng)
    return bytes(raw)


def spoilt_image(data: bytes, rng: np.random.Generator) -> bytes:
    """Whatever kind of image it is."""
    if data[:2] == b"\xff\xd8":
        return spoilt_jpeg(data, rng)
    return spoilt_png(data, rng) if data[:4] == b"\x89PNG" else spoilt_tiff(data, rng)
