"""HDF5 files that may be spoilt: another process reads each first, since the HDF5 library can crash on one.

libhdf5 2.0 runs into a segmentation fault where a dataset's largest extent does not fit its index of chunks (docs/why/
spoilt.md); no check of ours could know all such places. The other process is started once and asked for each file.
"""

import atexit
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from select import select
from threading import Lock
from typing import Any

import h5py

from rpaug import BadInput

CHILD = Path(__file__).with_name("hdf5_child.py")
SLOWEST = 2**20  # bytes a second, at the least
PATIENCE = 20  # seconds beside
MOST = 2**28  # numbers in one dataset: more is taken for damage, before anything is allocated


@dataclass
class _Prover:
    """The other process, of the process that started it."""

    child: Any = None
    owner: int = 0
    lock: Any = field(default_factory=Lock)

    def ask(self, path: Path, within: tuple[str, ...] | None, seconds: float) -> str:
        """Its answer about a file, or some groups of it: how it ended if it did, or `too long`.

        A file crashes it if a fresh process crashes as well: what an earlier file broke is not this one's fault.
        """
        asked = [str(path.absolute()), *([] if within is None else ["", *within])]
        line = b"\t".join(part.encode("unicode_escape") for part in asked) + b"\n"
        with self.lock:
            answer = self._answer(line, seconds)
            if answer == "crashed":
                answer = self._answer(line, seconds)
            return answer

    def _answer(self, line: bytes, seconds: float) -> str:
        if self.child is None or self.owner != os.getpid() or self.child.poll() is not None:
            command, pipe = [sys.executable, "-I", str(CHILD)], subprocess.PIPE
            self.child = subprocess.Popen(
                command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL
            )
            self.owner = os.getpid()
        try:
            self.child.stdin.write(line)
            self.child.stdin.flush()
            if not select([self.child.stdout], [], [], seconds)[0]:
                self._end()
                return "too long"
            answer = self.child.stdout.readline().decode().strip()
        except OSError:
            answer = ""
        if not answer:
            self._end()
        return answer or "crashed"

    def _end(self) -> None:
        """See that the process is gone, not merely about to be."""
        self.child.kill()
        self.child.wait()
        for pipe in (self.child.stdout, self.child.stdin):
            with suppress(OSError):
                pipe.close()

    def close(self) -> None:
        """Let it end."""
        if self.child is not None and self.owner == os.getpid():
            self.child.stdin.close()
            self.child.wait()


_PROVER = _Prover()
atexit.register(_PROVER.close)


@lru_cache(2**16)
def _proved(path: Path, size: int, _: int, within: tuple[str, ...] | None) -> str:
    return _PROVER.ask(path, within, PATIENCE + size / SLOWEST)


@contextmanager
def opened(path: Path, within: tuple[str, ...] | None = None) -> Iterator[h5py.File]:
    """The file, for reading; if groups are named, what lies `within` them and attributes of those above alone, and if
    none is, the names in the file and in its groups alone. Raises BadInput for what is no HDF5 file or damaged."""
    try:
        about = path.stat()
        outcome = _proved(path, about.st_size, about.st_mtime_ns, within)
        if outcome not in ("read", "refused"):
            found = {
                "crashed": "what crashes the HDF5 library",
                "memory": "what fills the memory",
                "too long": "what keeps the HDF5 library busy without end",
            }[outcome]
            raise BadInput(path, "HDF5", found=found, expected="a whole file")
        with h5py.File(path, "r") as file:
            yield file
    except (OSError, RuntimeError, LookupError, ValueError, TypeError, MemoryError) as error:
        raise BadInput(path, "HDF5", found=str(error)[:120], expected="a whole file") from None


def member(path: Path, file: h5py.Group, name: str) -> h5py.Group | h5py.Dataset:
    """What lies in the file itself at a place below a group of it, followed by hard links alone. Raises BadInput."""
    at: Any = file
    for part in name.split("/"):
        link = at.get(part, getlink=True) if isinstance(at, h5py.Group) else None
        if link is None:
            where, expected = _where(file, name), "a group or dataset"
            raise BadInput(path, where, found="nothing", expected=expected)
        if not isinstance(link, h5py.HardLink):
            where, expected = _where(file, name), "data in the file itself"
            raise BadInput(path, where, found="a link", expected=expected)
        at = at[part]
    return at


def _where(file: h5py.Group, name: str) -> str:
    """A place below a group, from the file's root: names in spoilt files may be empty."""
    return f"{file.name}/{name}".lstrip("/")


def dataset(path: Path, file: h5py.Group, name: str) -> h5py.Dataset:
    """A dataset that lies in the file itself and is not absurdly large. Raises BadInput."""
    at = member(path, file, name)
    if not isinstance(at, h5py.Dataset) or at.external or at.is_virtual:
        where, expected = _where(file, name), "a dataset in the file"
        raise BadInput(path, where, found="no data of its own", expected=expected)
    if h5py.check_ref_dtype(at.dtype) is not None:
        where, expected = _where(file, name), "values"
        raise BadInput(path, where, found="references to other places", expected=expected)
    if at.size is None or at.size > MOST:
        where, expected = _where(file, name), f"at most {MOST}"
        raise BadInput(path, where, found=f"{at.size} values", expected=expected)
    return at
