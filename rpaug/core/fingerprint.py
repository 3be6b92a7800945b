"""What tells whether a folder holds what it held, wherever it lies now, without reading all of it."""

import hashlib
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

LARGE = 2**16  # bytes: of larger files some blocks are read as well
BLOCK, BLOCKS = 2**12, 8  # bytes of each, and how many, evenly spread from first to last


def contents(root: Path) -> str:
    """A digest of where files lie below a folder and of their sizes, and of blocks of large ones; hidden ones are none.

    A file that was changed in place keeps its size only if it is no compressed image, and those are large.
    """
    digest = hashlib.sha256()
    for path in _files(root):
        size = path.stat().st_size
        digest.update(f"{path.relative_to(root).as_posix()}\0{size}\0".encode(errors="replace"))
        if size > LARGE:
            with path.open("rb") as stream:
                for number in range(BLOCKS):
                    stream.seek(number * (size - BLOCK) // (BLOCKS - 1))
                    digest.update(stream.read(BLOCK))
    return digest.hexdigest()[:32]


def of(data: bytes) -> str:
    """A digest of some bytes."""
    return hashlib.sha256(data).hexdigest()[:32]


def of_all(first: bytes, more: Iterable[bytes]) -> str:
    """A digest of bytes that need not be held at once."""
    digest = hashlib.sha256(first)
    for data in more:
        digest.update(data)
    return digest.hexdigest()[:32]


def _files(root: Path) -> Iterator[Path]:
    for folder, subfolders, names in os.walk(root):
        subfolders[:] = sorted(name for name in subfolders if not name.startswith("."))
        for name in sorted(names):
            path = Path(folder, name)
            if not name.startswith(".") and path.is_file():
                yield path
