"""Reads HDF5 files whose paths come line by line, and answers each: a process that may crash in the place of ours."""

import resource
import sys

import h5py

MOST = 2**28  # values of a dataset; what is larger is refused without being read
ROWS = 2**22  # values read at a time
MEMORY = 2**33  # bytes


def read(path: str) -> None:
    """Everything that a reader may ask for: objects, their attributes, and the values in the file itself."""
    with h5py.File(path, "r") as file:
        names: list[str] = []
        file.visit(names.append)  # hard links alone are visited
        for name in names:
            try:
                _read(file[name])
            except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError):
                continue  # the reader will find the same, and say it in its own words


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
            read(line.rstrip("\n").encode().decode("unicode_escape"))
            answer = "read"
        except MemoryError:
            answer = "memory"
        except Exception:
            answer = "refused"  # by a reader too
        sys.stdout.write(answer + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
