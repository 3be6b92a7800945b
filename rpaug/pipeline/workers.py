"""Runs jobs on this machine: in this process, or in others with one thread each, each within its budget."""

import errno
import gc
import os
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkContext, SpawnContext
from pathlib import Path, PurePosixPath

from rpaug.core import jit, owner, progress
from rpaug.core.errors import Missing, RpaugError, of_the_machine
from rpaug.pipeline.job import Job, augment, left
from rpaug.pipeline.output_folder import sweep
from rpaug.pipeline.run import Budget

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
)
FORBIDDEN = {errno.EACCES, errno.EPERM}  # of an output, for any episode
DIED = "a worker died (out of memory?); fewer workers need less"
LOOK = 0.2  # seconds between two looks at what workers take
SHARE = 0.9  # of the machine's memory, for all workers
THREADS = Path("/proc/self/task")
OWN_GROUPS = Path("/proc/self/cgroup")
GROUPS = {
    "": (Path("/sys/fs/cgroup"), "memory.max"),
    "memory": (Path("/sys/fs/cgroup/memory"), "memory.limit_in_bytes"),
}


@dataclass(frozen=True)
class Outcome:
    """What came of one job: how many copies it wrote, and what stopped it if anything did.

    After a `fatal` error it is no use going on: the machine's fault (a full disk), or `missing` what an edit is made of
    where the recipe says `on_missing: fail`.
    """

    job: Job
    copies: int
    error: str | None = None
    fatal: bool = False
    missing: bool = False


@dataclass(frozen=True)
class Lost:
    """A job whose worker ended before it was done; `late` where it took too long."""

    job: Job
    why: str
    late: bool = False


Pool = Callable[[Iterable[Job], list[Lost], bool], Iterator[Outcome]]
"""Does jobs, each within its budget, and adds those whose worker was lost to a list. The last argument is true for a
job that is tried once more, alone."""


def run(jobs: Iterable[Job], workers: int, budget: Budget | None = None) -> Iterator[Outcome]:
    """Outcomes as they come; after a fatal one no job is started. Output does not depend on `workers`.

    With one worker and no budget jobs run in this process, without bounds; else in fresh ones, which end with this
    process, however that ends.
    """
    if workers <= 1 and budget is None:
        for job in jobs:
            yield (outcome := attempt(job))
            if outcome.fatal:
                return
        return
    given = budget or Budget()

    def pool(todo: Iterable[Job], lost: list[Lost], alone: bool) -> Iterator[Outcome]:
        most = 1 if alone else workers
        return pooled(todo, lost, among(given, most), most)

    with one_thread_each() if workers > 1 else nullcontext():
        yield from with_second_tries(jobs, pool)


def with_second_tries(jobs: Iterable[Job], pool: Pool) -> Iterator[Outcome]:
    """Outcomes of jobs that a pool does.

    A job whose worker died, or took more memory than its budget, is tried once more, alone, with the memory of all
    workers unless the budget states some; one that fails again, or took too long, is left out.
    """
    fatal, lost = False, list[Lost]()
    for outcome in pool(jobs, lost, False):
        fatal |= outcome.fatal
        yield outcome
    for one in lost:
        sweep(one.job.target)
        again = [one] if one.late else list[Lost]()
        rest = one.job if one.late else left(one.job)
        if not (fatal or one.late) and (rest.copies or not one.job.copies):
            for outcome in pool([rest], again, True):
                fatal |= outcome.fatal
                yield outcome
            sweep(one.job.target)
        for left_out in again:
            yield Outcome(one.job, 0, f"{one.job.key}: {left_out.why}")


def among(budget: Budget, workers: int) -> Budget:
    """With the memory in numbers. Where none is stated, who works alone gets what all would have."""
    return replace(budget, memory=budget.memory or SHARE * _machine_memory() / workers)


def _machine_memory() -> float:
    """Bytes that this machine has, or that a container or a Slurm job is given of them."""
    found = float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    for limit in _limits():
        with suppress(OSError, ValueError):  # none there, or "max"
            found = min(found, float(limit.read_text()))
    return found


def _limits() -> Iterator[Path]:
    """Files that may state a limit: of this process's control groups, of both versions, and of what those lie in."""
    lines = ["0::/"]
    with suppress(OSError):
        lines += OWN_GROUPS.read_text().splitlines()
    for line in lines:
        _, kinds, path = line.split(":", 2)
        if kinds in GROUPS:
            top, name = GROUPS[kinds]
            group = PurePosixPath(path.strip("/"))
            yield from (top / one / name for one in (group, *group.parents))


class WorkerProcess:
    """A process of its own that does jobs, one at a time."""

    def __init__(self) -> None:
        context = _context()
        self.connection, theirs = context.Pipe()
        self.process = context.Process(
            target=owner.child, args=(_serve.__module__, _serve.__name__, theirs)
        )
        # Ctrl-C reaches a terminal's whole group: it is for the run, which ends its workers. They inherit the mask.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            self.process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()
        self.job: Job | None = None
        self.begun = 0.0

    def begin(self, job: Job) -> None:
        self.job, self.begun = job, time.monotonic()
        with suppress(OSError):  # it is dead: its end of the pipe will say so
            self.connection.send(job)

    def told(self, budget: Budget) -> Outcome | Lost | None:
        """What came of its job, if anything has; how far that is, is passed on."""
        assert self.job is not None
        if not self.connection.poll():
            return self._beyond(budget, self.job)
        try:
            given = self.connection.recv()
        except (EOFError, OSError):
            return Lost(self.job, DIED)
        if isinstance(given, dict):
            progress.retold(given)
            return None
        self.job = None
        return given

    def _beyond(self, budget: Budget, job: Job) -> Lost | None:
        """What the job took beyond the budget."""
        minutes = budget.minutes * max(1, len(job.copies))
        if time.monotonic() - self.begun > 60 * minutes:
            why = f"it took more than {minutes:g} minutes; --most-minutes allows more for a copy"
            return Lost(job, why, late=True)
        held = _resident(self.process.pid)
        if budget.memory and held > budget.memory:
            most = f"{budget.memory / 1e9:.2g} allowed (--most-memory)"
            return Lost(job, f"it took {held / 1e9:.2g} GB of {most}")
        return None

    def end(self) -> None:
        self.process.kill()
        self.process.join()
        self.connection.close()


def _context() -> ForkContext | SpawnContext:
    """How a worker begins. A forked one has what is imported here, which saves it a second; of a process with threads
    or a GPU's driver it would inherit these in whatever state they are."""
    try:
        alone = len(os.listdir(THREADS)) == 1
    except OSError:  # not Linux
        alone = False
    if not alone or "torch" in sys.modules:
        return get_context("spawn")
    jit.prime()
    return get_context("fork")


def _resident(pid: int | None) -> float:
    """Bytes of memory that a process has."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0.0
    return float(pages * os.sysconf("SC_PAGE_SIZE"))


def pooled(
    jobs: Iterable[Job],
    lost: list[Lost],
    budget: Budget,
    workers: int,
    kept: list[WorkerProcess] | None = None,
) -> Iterator[Outcome]:
    """Outcomes of fresh processes; `lost` gets jobs whose worker died or was ended, and another takes its place. A job
    is asked for when somebody can do it.

    Processes of `kept` are used first and left there idle; without it all are ended."""
    pool: list[WorkerProcess] = [] if kept is None else kept
    todo = iter(jobs)
    try:
        while True:
            _keep_busy(pool, todo, workers)
            busy = [one for one in pool if one.job]
            if not busy:
                return
            if not wait([one.connection for one in busy], LOOK):
                progress.again()
            for one in busy:
                told = one.told(budget)
                if isinstance(told, Lost):
                    lost.append(told)
                    pool.remove(one)
                    one.end()
                elif told is not None:
                    if told.fatal:
                        todo = iter(())
                    yield told
    finally:
        for one in [one for one in pool if kept is None or one.job]:
            pool.remove(one)
            one.end()


def _keep_busy(pool: list[WorkerProcess], todo: Iterator[Job], workers: int) -> None:
    """Give jobs to who is idle, and to new processes while there are fewer than `workers`."""
    idle = [one for one in pool if one.job is None]
    while (idle or len(pool) < workers) and (job := next(todo, None)):
        if not idle:
            idle.append(WorkerProcess())
            pool += idle
        idle.pop(0).begin(job)


def _serve(connection: Connection) -> None:
    """Jobs as they come."""
    gc.freeze()  # what is imported stays: it need not be searched for what may go
    progress.deafen()
    with progress.heard(progress.seldom(connection.send)):
        while True:
            connection.send(attempt(connection.recv()))


def attempt(job: Job) -> Outcome:
    """One job, its failures turned into words."""
    made = 0
    try:
        for _ in augment(job):
            made += 1  # what was written before a failure counts
    except Exception as error:
        return _failed(job, made, error)
    return Outcome(job, made)


def _failed(job: Job, made: int, error: Exception) -> Outcome:
    """What stopped a job. Raises a fault of ours where it is looked for."""
    if isinstance(error, Missing):
        return Outcome(job, made, str(error), fatal=True, missing=True)
    if machine := of_the_machine(error):
        return Outcome(job, made, f"{job.target}: {machine.strerror or machine}", fatal=True)
    if isinstance(error, RpaugError):
        return Outcome(job, made, str(error))
    if isinstance(error, MemoryError):
        return Outcome(job, made, f"{job.key}: out of memory")
    if isinstance(error, OSError):
        place = Path(str(error.filename or job.key))
        closed = error.errno in FORBIDDEN and place.is_relative_to(job.target)
        return Outcome(job, made, f"{place}: {error.strerror or error}", fatal=closed)
    if os.environ.get("RPAUG_DEBUG"):
        raise error
    words = f"{type(error).__name__}: {error}"
    return Outcome(job, made, f"{job.key}: a fault in rpaug ({words}); RPAUG_DEBUG=1 shows where")


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Libraries read these variables when a child imports them."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value
