"""Runs jobs on this machine: in this process, or on a pool of fresh ones with one thread each."""

import errno
import os
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context, parent_process
from typing import Any

from rpaug.core.errors import Missing, RpaugError
from rpaug.pipeline.job import Job, augment, left
from rpaug.pipeline.output_folder import sweep

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
)
MACHINE = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EMFILE}
DIED = "a worker died (out of memory?); fewer workers need less"


@dataclass(frozen=True)
class Outcome:
    """What came of one job: the reports of the copies it wrote, and what stopped it if anything did.

    After a `fatal` error it is no use going on: the machine's fault (a full disk), or `missing` what an edit is made of
    where the recipe says `on_missing: fail`.
    """

    job: Job
    reports: list[dict[str, Any]]
    error: str | None = None
    fatal: bool = False
    missing: bool = False


def run(jobs: Sequence[Job], workers: int) -> Iterator[Outcome]:
    """Outcomes as they come; after a fatal one no job is started. Output does not depend on `workers`.

    What was under way when a worker died is tried once more, job by job; one whose worker dies again is left out.
    Workers end with this process, however that ends.
    """
    if workers <= 1:
        for job in jobs:
            yield (outcome := attempt(job))
            if outcome.fatal:
                return
        return
    todo, fatal = list(jobs), False
    with _one_thread_each():
        while todo and not fatal:
            lost: list[Job] = []
            for outcome in _pooled(todo, workers, lost):
                fatal |= outcome.fatal
                yield outcome
            if lost:
                sweep(lost[0].target)
            for job in lost:
                again: list[Job] = []
                rest = left(job)
                if not fatal and (rest.copies or not job.copies):
                    for outcome in _pooled([rest], 1, again):
                        fatal |= outcome.fatal
                        yield outcome
                if again:
                    sweep(job.target)
                    yield Outcome(job, [], f"{job.key}: {DIED}")


def _pooled(todo: list[Job], workers: int, lost: list[Job]) -> Iterator[Outcome]:
    """Outcomes of a pool of fresh processes, until one dies: `lost` gets what was under way, `todo` keeps the rest."""
    running: dict[Future[Outcome], Job] = {}
    # spawn: a forked child would inherit the parent's thread pools in whatever state they are
    context = get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        while (todo and not lost) or running:
            while todo and not lost and len(running) < 2 * workers:
                job = todo.pop(0)
                try:
                    running[pool.submit(_watched, job)] = job
                except BrokenProcessPool:
                    lost.append(job)
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                job = running.pop(future)
                try:
                    outcome = future.result()
                except BrokenProcessPool:
                    lost.append(job)
                    continue
                if outcome.fatal:
                    todo.clear()
                yield outcome


def _watched(job: Job) -> Outcome:
    """One job in a worker that ends as soon as the process that began it does, be it killed."""
    _watch()
    return attempt(job)


@cache
def _watch() -> None:
    parent = parent_process()
    assert parent is not None

    def end() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()


def attempt(job: Job) -> Outcome:
    """One job, its failures turned into words."""
    reports: list[dict[str, Any]] = []
    try:
        for described in augment(job):
            reports.append(described)  # noqa: PERF402  # what was written before a failure counts
    except Missing as error:
        return Outcome(job, reports, str(error), fatal=True, missing=True)
    except RpaugError as error:
        return Outcome(job, reports, str(error))
    except MemoryError:
        return Outcome(job, reports, f"{job.key}: out of memory", fatal=True)
    except OSError as error:
        fatal = error.errno in MACHINE
        place = job.target if fatal else error.filename or job.key
        return Outcome(job, reports, f"{place}: {error.strerror or error}", fatal)
    except Exception as error:
        if os.environ.get("RPAUG_DEBUG"):
            raise
        name = type(error).__name__
        return Outcome(
            job,
            reports,
            f"{job.key}: a fault in rpaug ({name}: {error}); RPAUG_DEBUG=1 shows where",
        )
    return Outcome(job, reports)


@contextmanager
def _one_thread_each() -> Iterator[None]:
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
