"""What tells whether a folder holds what it held, wherever it lies now: without reading all of it, or to the byte."""

import hashlib
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from rpaug.core.untouched import BINARY, CHUNK

LARGE = 2**16  # bytes: of larger files some blocks are read as well
DIGITS = 32  # of a digest, in hexadecimal
BLOCK, BLOCKS = 2**12, 8  # bytes of each, and how many, evenly spread from first to last


def contents(root: Path) -> str:
    """A digest of where files lie below a folder and of their sizes, and of blocks of large ones; hidden ones are none.

    A file that was changed in place keeps its size only if it is no compressed image, and those are large.
    """
    digest = hashlib.sha256()
    for name, size in _files(os.fspath(root), ""):
        digest.update(f"{name}\0{size}\0".encode(errors="replace"))
        if size > LARGE:
            with open(os.path.join(root, name), "rb") as stream:
                for number in range(BLOCKS):
                    stream.seek(number * (size - BLOCK) // (BLOCKS - 1))
                    digest.update(stream.read(BLOCK))
    return _short(digest)


def of(data: bytes) -> str:
    """A digest of some bytes."""
    return _short(hashlib.sha256(data))


def of_all(first: bytes, more: Iterable[bytes]) -> str:
    """A digest of bytes that need not be held at once."""
    digest = hashlib.sha256(first)
    for data in more:
        digest.update(data)
    return _short(digest)


def _files(folder: str, within: str) -> Iterator[tuple[str, int]]:
    """Names of files below a folder, and sizes in bytes, files of a folder before what is in its folders."""
    entries = sorted(os.scandir(folder), key=lambda one: one.name)
    entries = [one for one in entries if not one.name.startswith(".")]
    for one in entries:
        if one.is_file():
            yield f"{within}{one.name}", one.stat().st_size
    for one in entries:
        if one.is_dir(follow_symlinks=False):
            yield from _files(one.path, f"{within}{one.name}/")


@dataclass(frozen=True, slots=True)
class Seal:
    """What a folder held: how many files, how many bytes, a digest of names and sizes, and one of all bytes ("" where
    they were not read)."""

    files: int
    size: int
    names: str
    contents: str = ""


def sealed(folder: Path, read: bool = True) -> Seal:
    """The seal of all files below a folder, hidden ones among them; sizes alone unless they are `read`. Links are not
    followed. A folder that is not there holds nothing."""
    names, contents, size = hashlib.sha256(), hashlib.sha256(), 0
    found = sorted(_sizes(os.fspath(folder), ""))
    for name, held in found:
        size += held
        line = f"{name}\0{held}\0".encode(errors="replace")
        names.update(line)
        contents.update(line)
        if read:
            for block in _blocks(os.path.join(folder, name)):
                contents.update(block)
    return Seal(len(found), size, _short(names), _short(contents) if read else "")


def _blocks(path: str) -> Iterator[bytes]:
    # By a descriptor, as `pass_on`: open() asks the system for more.
    descriptor = os.open(path, os.O_RDONLY | BINARY)
    try:
        while block := os.read(descriptor, CHUNK):
            yield block
    finally:
        os.close(descriptor)


def same_files(one: Seal, other: Seal) -> bool:
    """Whether files of the same names and sizes lay there."""
    return (one.files, one.size, one.names) == (other.files, other.size, other.names)


def of_file(path: Path) -> str:
    """A digest of a file's bytes."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()[:DIGITS]


def _short(digest: "hashlib._Hash") -> str:
    return digest.hexdigest()[:DIGITS]


def _sizes(folder: str, within: str) -> Iterator[tuple[str, int]]:
    """Names below a folder, and sizes in bytes."""
    try:
        entries = list(os.scandir(folder))
    except FileNotFoundError:
        return
    for one in entries:
        name = f"{within}{one.name}"
        if one.is_dir(follow_symlinks=False):
            yield from _sizes(one.path, f"{name}/")
        else:
            yield name, one.stat(follow_symlinks=False).st_size
