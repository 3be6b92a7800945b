"""Runs jobs on this machine: in this process, or on a pool of fresh ones with one thread each."""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

from rpaug.errors import RpaugError
from rpaug.pipeline import Job, augment

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
)


@dataclass(frozen=True)
class Outcome:
    """What came of one job: the reports of its copies, or the reason why there are none."""

    job: Job
    reports: list[dict[str, Any]]
    error: str | None = None
    fatal: bool = False  # the machine's fault (a full disk): no use going on


def run(jobs: Sequence[Job], workers: int) -> Iterator[Outcome]:
    """Outcomes as they come. Output does not depend on `workers`: every draw has its own seed."""
    if workers <= 1:
        for job in jobs:
            yield attempt(job)
        return
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(
        dict.fromkeys(THREAD_VARIABLES, "1")
    )  # read when a child imports its libraries
    try:
        # spawn: a forked child would inherit the parent's thread pools in whatever state they are
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            futures = {pool.submit(attempt, job): job for job in jobs}
            for future in as_completed(futures):
                try:
                    yield future.result()
                except BrokenProcessPool:
                    reason = "a worker died (out of memory?); fewer workers need less"
                    yield Outcome(futures[future], [], reason, fatal=True)
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def attempt(job: Job) -> Outcome:
    """One job, its expected failures turned into words."""
    try:
        return Outcome(job, augment(job))
    except RpaugError as error:
        return Outcome(job, [], str(error))
    except OSError as error:
        return Outcome(
            job, [], f"{error.filename or job.target}: {error.strerror or error}", fatal=True
        )
    except MemoryError:
        return Outcome(job, [], f"{job.key}: out of memory", fatal=True)
