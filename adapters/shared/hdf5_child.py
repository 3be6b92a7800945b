"""Reads HDF5 files whose paths come line by line, and answers each: a process that may crash in the place of ours.

A line is a path, or a path, an empty word and the groups of the file that are to be read, between tabs.
"""

import resource
import sys
from typing import Any

import h5py

MOST = 2**28  # values of a dataset; what is larger is refused without being read
ROWS = 2**22  # values read at a time
MEMORY = 2**33  # bytes


def read(path: str, within: list[str] | None = None) -> None:
    """Everything that a reader may ask for: objects, their attributes, and the values in the file itself.

    Of a file with `within` only those groups and the attributes of those above; with none the names in it and in its
    groups, and their attributes.
    """
    with h5py.File(path, "r") as file:
        names: list[str] = []
        if within is None:
            file.visit(names.append)  # hard links alone are visited
        elif not within:
            for name in file:
                if isinstance(held := _hard(file, name), h5py.Group):
                    list(held)
                    list(held.attrs.values())
        for group in within or ():
            above = [group.rsplit("/", n)[0] for n in range(group.count("/") + 1)]
            names += above[::-1]
            below: list[str] = []
            if isinstance(held := _hard(file, group), h5py.Group):
                held.visit(below.append)
            names += [f"{group}/{name}" for name in below]
        for name in ["", *names]:
            try:
                _read(_hard(file, name) if name else file)
            except (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError):
                continue  # the reader will find the same, and say it in its own words


def _hard(file: h5py.File, name: str) -> Any:
    """What lies at a place, followed by hard links alone."""
    held: Any = file
    for part in name.split("/"):
        link = held.get(part, getlink=True) if isinstance(held, h5py.Group) else None
        if not isinstance(link, h5py.HardLink):
            return None
        held = held[part]
    return held


def _read(held: h5py.Group | h5py.Dataset) -> None:
    for key in held.attrs:
        held.attrs[key]
    if not isinstance(held, h5py.Dataset) or held.external or held.is_virtual:
        return
    if not held.shape or not held.size or held.size > MOST:
        return
    rows = max(1, ROWS * len(held) // held.size)
    for first in range(0, len(held), rows):
        held[first : first + rows]


def main() -> None:
    """Answer until there are no more lines."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    if soft == resource.RLIM_INFINITY or soft > MEMORY:
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, hard))
    for line in sys.stdin:
        try:
            path, *within = (
                part.encode().decode("unicode_escape") for part in line.rstrip("\n").split("\t")
            )
            read(path, within[1:] if within else None)
            answer = "read"
        except MemoryError:
            answer = "memory"
        except Exception:
            answer = "refused"  # by a reader too
        sys.stdout.write(answer + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
