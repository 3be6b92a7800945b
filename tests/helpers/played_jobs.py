"""A worker whose jobs do what their keys say, in place of augmenting."""

import os
import time
from multiprocessing import current_process
from multiprocessing.connection import Connection
from types import SimpleNamespace
from typing import Any

from rpaug.pipeline.workers import THREAD_VARIABLES, Outcome

MEGABYTES = 800


def job(key: str, target: Any) -> Any:
    """Of two copies."""
    return SimpleNamespace(key=key, copies=((0, "a"), (1, "b")), target=target)


def serve(connection: Connection) -> None:
    """`dies` ends its process, `dies once` the first time, `grows` takes memory, `hangs` time, `full` has no space.
    `threads` tells as its error how many its libraries start, `kind` how it was begun itself."""
    while True:
        given = connection.recv()
        connection.send({"key": given.key, "stage": "has begun", "done": 0, "total": 0})
        if given.key == "dies":
            os._exit(3)
        if given.key == "dies once" and not (given.target / "tried").exists():
            (given.target / "tried").touch()
            os._exit(3)
        held = b"x" * (MEGABYTES * 2**20) if given.key == "grows" else b""
        if given.key in ("grows", "hangs"):
            time.sleep(600)
        full = given.key == "full"
        error = "No space left" if full else None
        if given.key == "threads":
            error = " ".join(os.environ.get(name, "unset") for name in THREAD_VARIABLES)
        if given.key == "kind":
            error = type(current_process()).__name__
        connection.send(Outcome(given, 0, error, fatal=full))
        del held
