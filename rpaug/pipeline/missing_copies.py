"""Which copies a run still has to make, under which keys, as one job for each source episode."""

from array import array
from collections.abc import Collection, Iterator
from functools import cached_property

from rpaug.core import splits
from rpaug.core.errors import BadInput
from rpaug.core.files import REJECTED
from rpaug.pipeline.job import Job
from rpaug.pipeline.made import MadeEpisodes
from rpaug.pipeline.run import Run, group_of

NONE = -1  # instead of a number: the copy is there, or not wanted


class MissingCopies(Collection[Job]):
    """The jobs of the run's part: of each source episode its copies that are not `done` and the keys they get, numbered
    from 0 in each group of the whole. Rejected copies have numbers too.

    Numbers alone are kept; a job is made when it is asked for.
    """

    def __init__(self, run: Run, done: MadeEpisodes) -> None:
        self._run = run
        self._numbers = _numbers(run, done)
        each = len(run.copies)
        self._sources = array("q")
        for at in range(len(run.keys)):
            if run.makes(at) and any(n != NONE for n in self._numbers[at * each : (at + 1) * each]):
                self._sources.append(at)

    def __len__(self) -> int:
        return len(self._sources)

    def __iter__(self) -> Iterator[Job]:
        return (job_of(self._run, self._run.keys[at], self._copies(at)) for at in self._sources)

    def __contains__(self, job: object) -> bool:
        return any(job == one for one in self)

    @cached_property
    def copies(self) -> int:
        """Of all jobs."""
        return sum(len(self._copies(at)) for at in self._sources)

    def _copies(self, at: int) -> tuple[tuple[int, str], ...]:
        key, each = self._run.keys[at], len(self._run.copies)
        numbers = self._numbers[at * each : (at + 1) * each]
        return tuple(
            (copy, self._run.adapter.key_at(key, number))
            for copy, number in zip(self._run.copies, numbers, strict=True)
            if number != NONE
        )


def job_of(run: Run, key: str, copies: tuple[tuple[int, str], ...]) -> Job:
    """The job that makes these copies of a source episode."""
    return Job(
        run.adapter.name,
        run.source,
        key,
        run.target,
        copies,
        run.recipe.source,
        run.tier,
        run.scenes,
        keep_invalid=run.keep_invalid,
        device=run.device,
        linked=run.linked,
    )


def _numbers(run: Run, done: MadeEpisodes) -> "array[int]":
    """The number of each copy of each source episode; first copies of all come first. Raises BadInput."""
    finished, free = set(done.copies()), dict[str, int]()
    each = len(run.copies)
    numbers = array("q", [NONE]) * (len(run.keys) * each)
    for column, copy in enumerate(run.copies):
        for at, key in enumerate(run.keys):
            if (key, copy) in finished or (key, copy) in run.spared:
                continue
            group = group_of(run.adapter, key)
            while _taken(made := run.adapter.key_at(key, free.setdefault(group, 0)), done):
                free[group] += 1
            if splits.of(made) != splits.of(key):  # an adapter's mistake, and the worst of all
                found, expected = f"{made}, of another split", "a copy in its source's split"
                raise BadInput(run.source / key, "split", found=found, expected=expected)
            numbers[at * each + column] = free[group]
            free[group] += 1
    return numbers


def _taken(key: str, done: MadeEpisodes) -> bool:
    return any((within, key) in done for within in ("", REJECTED))
