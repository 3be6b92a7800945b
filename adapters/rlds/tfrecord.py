"""TFRecord files: records framed by their length and two checksums, read one at a time.

Framing (TensorFlow's `core/lib/io/record_writer.h`): uint64 length, masked CRC32C of those eight bytes, data, masked
CRC32C of the data; all little-endian.
"""

import os
import struct
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import google_crc32c

from rpaug import BadInput

HEAD = struct.Struct("<QI")
FOOT = struct.Struct("<I")
FRAME = HEAD.size + FOOT.size  # bytes around a record
MASK = 0xA282EAD8
INDEXED = 64  # files whose record places are remembered


def frame(data: bytes) -> bytes:
    """A record as it stands in a file."""
    length = struct.pack("<Q", len(data))
    return b"".join([length, FOOT.pack(_masked(length)), data, FOOT.pack(_masked(data))])


def places(path: Path) -> Sequence[tuple[int, int]]:
    """Start and length of every record's data. Lengths are checked against the file before they are believed.

    Raises BadInput, with the number of the record that is wrong.
    """
    try:
        status = path.stat()
        return _places(path, status.st_mtime_ns, status.st_size)
    except OSError as error:
        raise BadInput(path, "file", found=error.strerror, expected="a TFRecord file") from None


@lru_cache(INDEXED)
def _places(path: Path, _: int, size: int) -> Sequence[tuple[int, int]]:
    found, at = [], 0
    with path.open("rb") as stream:
        while at < size:
            where = f"record {len(found)}"
            head = os.pread(stream.fileno(), HEAD.size, at)
            if len(head) < HEAD.size:
                raise BadInput(path, where, found="a cut-off header", expected="12 bytes")
            length, crc = HEAD.unpack(head)
            if crc != _masked(head[:8]):
                raise BadInput(
                    path, f"{where}, length", found="a wrong checksum", expected="a TFRecord file"
                )
            if length > size - at - FRAME:
                raise BadInput(
                    path,
                    f"{where}, length",
                    found=f"{length} bytes",
                    expected=f"at most {max(size - at - FRAME, 0)}, what the file still holds",
                )
            found.append((at + HEAD.size, length))
            at += FRAME + length
    return found


def read(path: Path, number: int) -> bytes:
    """The data of one record. Raises BadInput if it is not there or damaged."""
    known = places(path)
    if not 0 <= number < len(known):
        raise BadInput(
            path, f"record {number}", found=f"{len(known)} records", expected="one more at least"
        )
    start, length = known[number]
    with path.open("rb") as stream:
        stream.seek(start)
        data, foot = stream.read(length), stream.read(FOOT.size)
    if len(data) < length or FOOT.unpack(foot)[0] != _masked(data):
        raise BadInput(
            path, f"record {number}, data", found="a wrong checksum", expected="an undamaged record"
        )
    return data


def _masked(data: bytes) -> int:
    crc = google_crc32c.value(data)
    return ((crc >> 15 | crc << 17) + MASK) & 0xFFFFFFFF
