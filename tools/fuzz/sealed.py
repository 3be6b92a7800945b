"""Parts of an HDF5 file of the latest format, each sealed by a checksum, changed and sealed again.

Superblocks, object headers, heaps, trees and chunk indices of that format end with Jenkins's lookup3 hash of all that
stands before it (HDF5 File Format Specification 3.0, "Disk Format: Level 0A" and following): bytes changed without it
are refused before a parser sees them.
"""

import struct
from functools import lru_cache

import numpy as np
from trees import bytes_bent

MARKS = (b"\x89HDF", b"OHDR", b"OCHK", b"FRHP", b"FHDB", b"FHIB", b"BTHD", b"BTLF", b"BTIN", b"FAHD", b"FADB",
         b"EAHD", b"EAIB", b"EASB", b"EADB")  # fmt: skip
LONGEST = 700  # bytes of a part
WORD = 2**32 - 1


def _turned(value: int, by: int) -> int:
    return (value << by | value >> (32 - by)) & WORD


def lookup3(data: bytes) -> int:
    """Bob Jenkins's hashlittle of bytes, from 0 (public domain, 2006)."""
    a = b = c = (0xDEADBEEF + len(data)) & WORD
    blocks = max(0, (len(data) - 1) // 12)
    for at in range(0, 12 * blocks, 12):
        x, y, z = struct.unpack_from("<3I", data, at)
        a, b, c = (a + x) & WORD, (b + y) & WORD, (c + z) & WORD
        for by in (4, 6, 8, 16, 19, 4):
            a = (a - c & WORD) ^ _turned(c, by)
            c = (c + b) & WORD
            a, b, c = b, c, a
    if not data:
        return c
    x, y, z = struct.unpack("<3I", data[12 * blocks :].ljust(12, b"\0"))
    a, b, c = (a + x) & WORD, (b + y) & WORD, (c + z) & WORD
    for by in (14, 11, 25, 16, 4, 14, 24):
        c = (c ^ b) - _turned(b, by) & WORD
        a, b, c = b, c, a
    return b


@lru_cache(4)
def parts(data: bytes) -> list[tuple[int, int]]:
    """Where each sealed part begins, and its length without its seal."""
    found = []
    for mark in MARKS:
        at = data.find(mark)
        while at >= 0:
            for length in range(8, min(LONGEST, len(data) - at - 4)):
                (seal,) = struct.unpack_from("<I", data, at + length)
                if seal and seal == lookup3(data[at : at + length]):
                    found.append((at, length))
                    break
            at = data.find(mark, at + 1)
    return sorted(found)


def spoilt(data: bytes, rng: np.random.Generator) -> bytes:
    """One part bent, as long as before, and sealed."""
    at, length = parts(data)[int(rng.integers(len(parts(data))))]
    head = data[at : at + 4]
    body = bytes_bent(data[at + 4 : at + length], rng)[: length - 4].ljust(length - 4, b"\0")
    return (
        data[:at] + head + body + struct.pack("<I", lookup3(head + body)) + data[at + length + 4 :]
    )
