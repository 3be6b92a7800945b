"""Files of a recording that a copy carries on as they are: cloned or copied, or by choice hard links to them."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rpaug.core.errors import RpaugError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

CLONE = 0x40049409  # FICLONE of linux/fs.h: two files share their blocks until one is written to
BINARY = getattr(os, "O_BINARY", 0)  # Windows would turn line ends
CHUNK = 1 << 18  # bytes that are copied at once
NO_CLONES = {errno.EOPNOTSUPP, errno.EXDEV, errno.EINVAL, errno.ENOTTY, errno.ENOSYS, errno.EPERM}

_linked = False  # whether `pass_on` makes links in this process: adapters call it from threads


@contextmanager
def hard_links(wanted: bool) -> Iterator[None]:
    """Within it files are passed on as hard links where that is `wanted`."""
    global _linked
    before, _linked = _linked, wanted
    try:
        yield
    finally:
        _linked = before


def pass_on(source: Path | str, target: Path | str) -> None:
    """Make the file `target` with the bytes of `source`: a clone that takes no room where the file system has them
    (Btrfs, XFS), else a copy; or, within `hard_links`, the same file under a second name.

    A file that has as many names as it may have is copied. Raises RpaugError where no link can be made, and OSError.
    """
    if _linked and _link(source, target):
        return
    # By descriptors: a copy has thousands of small files, and open() asks the system five more times of each.
    recorded = os.open(source, os.O_RDONLY | BINARY)
    try:
        made = os.open(target, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | BINARY, 0o666)
        try:
            if not _cloned(recorded, made):
                _copy(recorded, made)
        finally:
            os.close(made)
    finally:
        os.close(recorded)


def _copy(recorded: int, made: int) -> None:
    while chunk := os.read(recorded, CHUNK):
        left = memoryview(chunk)
        while left:
            left = left[os.write(made, left) :]


def _link(source: Path | str, target: Path | str) -> bool:
    try:
        os.link(os.path.realpath(source), target)
    except OSError as error:
        if error.errno == errno.EMLINK:
            return False
        if error.errno in (errno.EXDEV, errno.EPERM, errno.EOPNOTSUPP):
            reason = f"no hard link to {source} can be made ({error.strerror})"
            raise RpaugError(f"{target}: {reason}; --untouched copy copies it") from None
        raise
    return True


def _cloned(recorded: int, made: int) -> bool:
    if fcntl is None:
        return False
    try:
        fcntl.ioctl(made, CLONE, recorded)
    except OSError as error:
        if error.errno in NO_CLONES:
            return False
        raise
    return True
