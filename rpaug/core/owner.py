"""What ends with its process, however that ends: a lock beside what it writes, so that this has one owner, and its
children.

Light: a child loads this alone before it has an eye on its parent.
"""

import errno
import fcntl
import getpass
import json
import os
import signal
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from multiprocessing import parent_process
from pathlib import Path
from typing import Any

from rpaug.core.errors import BadInput

_locks: set[int] = set()  # descriptors of what this process owns


@contextmanager
def owned(target: Path) -> Iterator[bool]:
    """Hold `target`, which need not exist; False where the file system knows no locks, and nothing is held.

    Raises BadInput that names who holds it already. The system drops the lock (flock) with the process, so what a
    killed run left is no lock.
    """
    path = target.parent / f".{target.name}.lock"
    missing = [folder for folder in path.parents if not folder.exists()]
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor, held = _held(path, target)
    _locks.add(descriptor)
    try:
        yield held
    finally:
        _locks.discard(descriptor)
        path.unlink(missing_ok=True)
        os.close(descriptor)
        for folder in missing:  # innermost first
            try:
                folder.rmdir()
            except OSError:
                break


def writer(target: Path) -> str:
    """Who holds `target`, in words; empty where nobody does, or the file system knows no locks."""
    try:
        descriptor = os.open(target.parent / f".{target.name}.lock", os.O_RDONLY)
    except OSError:
        return ""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:
        held = error.errno in (errno.EWOULDBLOCK, errno.EACCES)
        return _who(descriptor).rstrip(",") if held else ""
    finally:
        os.close(descriptor)
    return ""


def _held(path: Path, target: Path) -> tuple[int, bool]:
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
                return descriptor, False
            who = _who(descriptor)
            os.close(descriptor)
            raise BadInput(
                target, "--out", found=f"{who} writing there", expected="one run at a time"
            ) from None
        try:
            same = os.path.samestat(os.fstat(descriptor), path.stat())
        except FileNotFoundError:
            same = False
        if same:  # else its owner has just gone, and the file with it
            facts = {"user": _user(), "host": socket.gethostname(), "pid": os.getpid()}
            facts["since"] = time.time()
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, json.dumps(facts).encode(), 0)
            return descriptor, True
        os.close(descriptor)


def _who(descriptor: int) -> str:
    """Who holds a lock, in words."""
    try:
        facts = json.loads(os.pread(descriptor, 4096, 0))
        minutes = max(0.0, time.time() - facts["since"]) / 60  # a clock may have been set back
        where = f"process {facts['pid']} of {facts['user']} on {facts['host']}"
        return f"{where}, for {minutes:.0f} minutes,"
    except (OSError, ValueError, TypeError, KeyError):
        return "another process"


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # a number without a name, as containers have
        return str(os.getuid())


@contextmanager
def ends_like_ctrl_c() -> Iterator[None]:
    """SIGTERM, by which Slurm and containers end a run, does what Ctrl-C does: here, not in children."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def child(module: str, function: str, *given: Any) -> None:
    """What a process of a run does: a module's function, and the end of it all as soon as the parent is gone, also
    while the module still loads. That takes a second, or many where there is other work. What the parent owns a forked
    one lets go."""
    parent = parent_process()
    assert parent is not None
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    while _locks:
        os.close(_locks.pop())

    def end() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()
    getattr(import_module(module), function)(*given)
