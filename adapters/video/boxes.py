"""The display matrix in an MP4's track header (ISO/IEC 14496-12, 8.3.2): how a player turns the picture.

PyAV reads it but cannot write it, and a phone's portrait video that loses it lies on its side.
"""

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

TURNS = {
    (1, 0, 0, 1): 0,
    (0, 1, -1, 0): -1,  # players turn it clockwise by a quarter
    (-1, 0, 0, -1): 2,
    (0, -1, 1, 0): 1,
}  # by the matrix's a, b, c, d: quarter turns counter-clockwise
ONE = 1 << 16
MATRIX = 36  # bytes: nine numbers
DEEPEST = 64  # boxes of one kind looked through


def quarter_turns(path: Path) -> int:
    """How often to turn a stored frame counter-clockwise to see it upright; 0 where nothing says so."""
    with path.open("rb") as file:
        at = _matrix_at(file)
        if at is None:
            return 0
        file.seek(at)
        a, b, _, c, d, _, _, _, _ = struct.unpack(">9i", file.read(MATRIX))
    return TURNS.get(tuple(round(value / ONE) for value in (a, b, c, d)), 0)


def copy_matrix(source: Path, target: Path) -> None:
    """Give the target's picture the display matrix of the source's. Files that are no MP4 are left as they are."""
    with source.open("rb") as file:
        at = _matrix_at(file)
        if at is None:
            return
        file.seek(at)
        matrix = file.read(MATRIX)
    with target.open("r+b") as file:
        at = _matrix_at(file)
        if at is not None:
            file.seek(at)
            file.write(matrix)


def _matrix_at(file: BinaryIO) -> int | None:
    """Where the matrix of the first picture track lies."""
    end = file.seek(0, os.SEEK_END)
    try:
        for kind, start, stop in _boxes(file, 0, end):
            if kind == b"moov":
                for inner, low, high in _boxes(file, start, stop):
                    if inner == b"trak" and (at := _of_track(file, low, high)) is not None:
                        return at
    except struct.error:  # cut off
        return None
    return None


def _of_track(file: BinaryIO, start: int, stop: int) -> int | None:
    """The matrix's place in a track that has a size, as pictures have and sound has not."""
    for kind, low, high in _boxes(file, start, stop):
        if kind != b"tkhd":
            continue
        file.seek(low)
        version = file.read(1)[0:1]
        at = low + (36 + 16 if version == b"\x01" else 24 + 16)
        if at + MATRIX + 8 > high:
            return None
        file.seek(at + MATRIX)
        width, height = struct.unpack(">II", file.read(8))
        return at if width and height else None
    return None


def _boxes(file: BinaryIO, start: int, stop: int) -> Iterator[tuple[bytes, int, int]]:
    """Kind, start and end of what each box holds."""
    at = start
    for _ in range(DEEPEST):
        if at + 8 > stop:
            return
        file.seek(at)
        size, kind = struct.unpack(">I4s", file.read(8))
        head = 8
        if size == 1:
            (size,) = struct.unpack(">Q", file.read(8))
            head = 16
        size = stop - at if size == 0 else size
        if size < head or at + size > stop:
            return
        yield kind, at + head, at + size
        at += size
