"""How far long work is: the stage of an episode, and how much of the stage is done, told to whoever listens.

Work tells a log and need not know who shows it. Workers send what they are told to the run that began them.
"""

import logging
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

Told = Mapping[str, Any]
"""`key` of an episode, `stage` in words, and `done` of `total` parts (frames, mostly); a total of 0 is unknown."""

COPY = "copy written"
"""The stage whose `done` are copies of the episode that are there, of `total`."""
FRAMES = "making frames"
"""The stage whose parts are frames of a copy."""
WRITING = "writing, and reading back"
"""The stage after the last frame of a copy."""
FINISHED = "finished"
"""The stage after which nothing more comes of an episode."""

EVERY = 0.2  # seconds
LOG = logging.getLogger("rpaug.progress")
LOG.propagate = False  # thousands of lines: for those alone who listen here
_last: list[Told] = []  # what was told last


def told(key: str, stage: str, done: int = 0, total: int = 0) -> None:
    """Tell how far an episode is. Costs next to nothing while nobody listens."""
    retold({"key": key, "stage": stage, "done": done, "total": total})


def retold(given: Told) -> None:
    """Pass on what a worker told."""
    _last[:] = [given]
    LOG.info("%(key)s: %(stage)s", given)


def again() -> None:
    """Tell once more what was told last: whoever listens sees that work goes on, though it says nothing for minutes."""
    for given in _last:
        retold(given)


@contextmanager
def heard(listen: Callable[[Told], None]) -> Iterator[None]:
    """Listen to what is told meanwhile, in this process and by its workers."""
    _last.clear()  # it was said to others
    handler, level = _Listener(listen), LOG.level
    LOG.addHandler(handler)
    LOG.setLevel(logging.INFO)
    try:
        yield
    finally:
        LOG.removeHandler(handler)
        LOG.setLevel(level)


def deafen() -> None:
    """Forget who listens: a forked worker has its parent's listeners, which are that one's alone."""
    LOG.handlers.clear()


def seldom(listen: Callable[[Told], None]) -> Callable[[Told], None]:
    """Listens as `listen` does, but to a stage that goes on only a few times a second: frames are many."""
    last: tuple[Any, float] = None, 0.0

    def hear(told: Told) -> None:
        nonlocal last
        about, now = (told["key"], told["stage"]), time.monotonic()
        if about != last[0] or told["done"] == told["total"] or now - last[1] >= EVERY:
            last = about, now
            listen(told)

    return hear


class _Listener(logging.Handler):
    def __init__(self, listen: Callable[[Told], None]) -> None:
        super().__init__(logging.INFO)
        self._listen = listen

    def emit(self, record: logging.LogRecord) -> None:
        if isinstance(record.args, Mapping):
            self._listen(dict(record.args))
