"""What was worked out once and can be worked out again: one folder, `<root>/<kind>/<name>`, kept below one size.

An entry is a file or a folder, named by its content or by what it was made from, and written whole or not at all
(`rpaug.core.files`). What was used longest ago goes first when there is too much. A folder that the user names (a store
of scenes, an output) is the user's own and no part of the cache.
"""

import os
import shutil
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rpaug.core.errors import RpaugError

PART = ".part"  # ending of hidden files and folders that grow, or go
FOLDER = "RPAUG_CACHE"  # environment variable: the root
LIMIT = "RPAUG_CACHE_GB"  # environment variable: gigabytes (1e9 bytes) that it may hold
GIGABYTES = 20.0
FETCHED = frozenset({"weights"})  # kinds that were fetched on request: they never go by themselves


@dataclass(frozen=True)
class Entry:
    """One thing kept: where, its size in bytes, and when it was last used, in seconds since 1970."""

    kind: str
    name: str
    path: Path
    bytes: int
    used: float

    @property
    def days(self) -> float:
        """Since it was last used."""
        return max(0.0, time.time() - self.used) / 86400


def root() -> Path:
    """The cache's folder: `RPAUG_CACHE` if set, else `rpaug` in the user's cache folder. It may not exist yet."""
    named = os.environ.get(FOLDER)
    if named:
        return Path(named)
    from numba.misc.appdirs import AppDirs  # only here: it brings numba

    return Path(AppDirs(appname="rpaug", appauthor=False).user_cache_dir)


def limit() -> int:
    """Bytes that the cache may hold. Raises RpaugError if the environment variable is no such number."""
    stated = os.environ.get(LIMIT, str(GIGABYTES))
    try:
        size = float(stated)
    except ValueError:
        size = -1.0
    if not 0 <= size < float("inf"):
        raise RpaugError(f"{LIMIT} is {stated!r}; expected gigabytes, as 20")
    return int(1e9 * size)


def place(kind: str, name: str) -> Path:
    """Where an entry lies, whether it is there or not. To ask for one that is there is to use it."""
    path = root() / kind / name
    if path.exists():
        with suppress(OSError):  # a cache that may only be read
            os.utime(path)
    return path


def entries() -> list[Entry]:
    """All there are, what was used last first."""
    found = list[Entry]()
    for path in root().glob("*/[!.]*"):
        with suppress(FileNotFoundError):  # another process took it out
            found.append(
                Entry(path.parent.name, path.name, path, _size(path), path.stat().st_mtime)
            )
    return sorted(found, key=lambda entry: (-entry.used, entry.kind, entry.name))


def remove(entry: Entry) -> None:
    """Take an entry out: gone at once, by one rename, before its files are deleted."""
    doomed = entry.path.with_name(f".{entry.name}-{os.getpid()}{PART}")
    os.replace(entry.path, doomed)
    if doomed.is_dir():
        shutil.rmtree(doomed, ignore_errors=True)
    else:
        doomed.unlink(missing_ok=True)


def trim(keep: Iterable[Path] = ()) -> list[Entry]:
    """Remove what was used longest ago until the cache is within its limit, and say what went.

    `keep` stays, and so does what was fetched on request. Call it after an entry was written.
    """
    most, spared, gone = limit(), set(keep), list[Entry]()
    found = entries()
    total = sum(entry.bytes for entry in found)
    for entry in reversed(found):
        if total <= most:
            break
        if entry.kind not in FETCHED and entry.path not in spared:
            with suppress(OSError):  # it is gone already, or is not ours to remove
                remove(entry)
                gone.append(entry)
            total -= entry.bytes
    return gone


def _size(path: Path) -> int:
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())
