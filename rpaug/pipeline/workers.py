"""Runs jobs on this machine: in this process, or on a pool of fresh ones with one thread each."""

import errno
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

from rpaug.core.errors import Missing, RpaugError
from rpaug.pipeline.job import Job, augment

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
    """Outcomes as they come; after a fatal one no job is started. Output does not depend on `workers`."""
    if workers <= 1:
        for job in jobs:
            yield (outcome := attempt(job))
            if outcome.fatal:
                return
        return
    # spawn: a forked child would inherit the parent's thread pools in whatever state they are
    with _one_thread_each(), ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        waiting = list(reversed(jobs))
        running: dict[Future[Outcome], Job] = {}
        while waiting or running:
            while waiting and len(running) < 2 * workers:
                job = waiting.pop()
                running[pool.submit(attempt, job)] = job
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                outcome = _result(future, running.pop(future))
                if outcome.fatal:
                    waiting.clear()
                yield outcome


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


def _result(future: Future[Outcome], job: Job) -> Outcome:
    try:
        return future.result()
    except BrokenProcessPool:
        return Outcome(job, [], DIED, fatal=True)


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
