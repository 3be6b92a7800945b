"""How far a command is: a bar with stage, frames and time left in a terminal, a line now and then in a log."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import PurePosixPath

from rpaug.cli.console import console, plain
from rpaug.core import progress

BAR = 16  # columns
SOON, EVERY = (
    5.0,
    60.0,
)  # seconds between two lines where there is no terminal: at first, and at most
Shown = Callable[["Position"], None]


class Position:
    """What is done of what is to be done, copies under way among it by their frames: it never goes back."""

    def __init__(self, title: str, clock: Callable[[], float] = time.monotonic) -> None:
        self.title, self.total, self.reached, self.stage = title, 0, 0.0, ""
        self._clock, self._begun, self._done = clock, clock(), 0
        self._copies: dict[str, int] = {}  # by episode under way
        self._first: tuple[float, float] | None = None  # when something was first reached, and what
        self._share: dict[str, float] = {}  # of the copy that is being made
        self._stage = ("", 0.0, 0.0, 0.0)  # its name, when it began at which share, its share

    def count(self, done: int, total: int) -> None:
        """So many of all parts are done."""
        self._done, self.total = done, total
        self._reach()

    def hear(self, told: progress.Told) -> None:
        """An episode is at a stage of its work."""
        key, share = told["key"], told["done"] / told["total"] if told["total"] else 0.0
        if told["stage"] == progress.FINISHED:
            self._copies.pop(key, None)
            self._share.pop(key, None)
            return
        self._follow(f"{key}: {told['stage']}", share)
        if told["stage"] == progress.COPY:
            self._copies[key], self._share[key] = told["done"], 0.0
        elif told["stage"] == progress.FRAMES:
            self._copies.setdefault(key, 0)
            self._share[key] = share
        of = f", {told['done']} of {told['total']}" if told["total"] else ""
        self.stage = f"{PurePosixPath(key).name}: {told['stage']}{of}"
        self._reach()

    def _follow(self, stage: str, share: float) -> None:
        name, began, first, _ = self._stage
        if stage != name:
            began, first = self._clock(), share
        self._stage = (stage, began, first, share)

    def _reach(self) -> None:
        under_way = sum(self._copies.values()) + sum(self._share.values())
        self.reached = max(self.reached, min(float(self.total), self._done + under_way))
        if self.reached and self._first is None:
            self._first = self._clock(), self.reached

    @property
    def seconds(self) -> float:
        """Since it was begun."""
        return self._clock() - self._begun

    @property
    def left(self) -> str:
        """The time left in words, of the stage alone before a frame of a copy tells; empty while too little does."""
        if self._first is None:
            _, began, first, share = self._stage
            made = share - first
            if not made:
                return ""
            left = (self._clock() - began) * (1 - share) / made
            return f"about {_span(left)} left of this stage"
        if not 0.1 <= self.reached < self.total:
            return ""
        spent, made = self.seconds, self.reached
        if self.reached < 1:  # what came before the first frame tells nothing of the next ones
            spent, made = self._clock() - self._first[0], self.reached - self._first[1]
        return f"about {_span(spent * (self.total - self.reached) / made)} left" if made else ""

    @property
    def counted(self) -> str:
        """As `2.4 of 8`; empty while the number of parts is unknown."""
        if not self.total:
            return ""
        whole = self.reached == int(self.reached)
        tenths = int(10 * self.reached) / 10
        return f"{self.reached if whole else tenths:g} of {self.total}"

    def line(self) -> str:
        """All of it in one line."""
        told = (self.counted, self.left, f"{_span(self.seconds)} so far", self.stage)
        return f"{self.title}: {'; '.join(filter(None, told))}"


def _span(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = seconds / 60
    return f"{minutes:.0f} min" if minutes < 90 else f"{minutes / 60:.1f} h"


@contextmanager
def progress_bar(title: str, quiet: bool) -> Iterator[Callable[[int, int], None]]:
    """Show how far what happens meanwhile is. What is given is called with the parts that are done, and all."""
    position = Position(title)
    if quiet:
        yield position.count
        return
    with _bar(title) if console.is_terminal else _lines() as show:

        def count(done: int, total: int) -> None:
            position.count(done, total)
            show(position)

        def hear(told: progress.Told) -> None:
            position.hear(told)
            show(position)

        with progress.heard(hear):
            yield count


@contextmanager
def _lines() -> Iterator[Shown]:
    last, wait = time.monotonic(), min(SOON, EVERY)

    def show(position: Position) -> None:
        nonlocal last, wait
        if time.monotonic() - last >= wait:
            last, wait = time.monotonic(), min(2 * wait, EVERY)
            console.print(plain(position.line()), highlight=False, soft_wrap=True)

    yield show


@contextmanager
def _bar(title: str) -> Iterator[Shown]:
    from rich.progress import (  # only here: no help and no answer in JSON needs it
        BarColumn,
        Progress,
        SpinnerColumn,
        TextColumn,
    )

    columns = (SpinnerColumn(), BarColumn(bar_width=BAR), TextColumn("{task.description}"))
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(title, total=None)

        def show(position: Position) -> None:
            words = position.line()[: max(20, console.width - BAR - 4)]
            bar.update(
                task,
                completed=position.reached,
                total=position.total or None,
                description=plain(words),
            )

        yield show
