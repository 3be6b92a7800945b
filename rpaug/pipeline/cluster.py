"""Runs jobs on the machines of a Ray cluster, each in a process of its own within its budget, as on this machine.

Every job is a Ray task, called after its episode; one that fits or has models on a GPU is given one. Dataset and output
lie on a file system that all nodes see under one path; all of them append to the journal. A node that is lost costs
what it was at: its jobs are done again on others, without the copies that are there already.
"""

import logging
import os
import socket
import sys
from collections.abc import Iterable, Iterator
from contextlib import redirect_stdout
from itertools import chain
from pathlib import Path
from typing import Any

from rpaug.core.errors import MissingExtra, RpaugError
from rpaug.core.version import __version__
from rpaug.pipeline.job import Job, left
from rpaug.pipeline.output_folder import sweep
from rpaug.pipeline.run import Budget
from rpaug.pipeline.workers import (
    Lost,
    Outcome,
    WorkerProcess,
    among,
    one_thread_each,
    pooled,
    with_second_tries,
)
from rpaug.providers.models_settings import Models

TRIES = 3  # of a job whose node was lost
LOST = "its node or its Ray worker was lost"
ANSWER = 10.0  # seconds until a cluster must have answered
LOOK = 1.0  # seconds between two looks at how large the cluster is
GPU, VISIBLE = (
    "GPU",
    "CUDA_VISIBLE_DEVICES",
)  # as Ray counts them, and tells a task which one is its own
NO_GPU = "--device cuda: no node of the cluster has a GPU that Ray knows of"
_processes: dict[str, list[WorkerProcess]] = {}
"""The process that does the jobs of this Ray worker one after another, and keeps their models, by the GPU it sees."""


def run(
    jobs: Iterable[Job], workers: int, budget: Budget | None = None, address: str = "auto"
) -> Iterator[Outcome]:
    """Outcomes as they come, as `workers.run` has them; at most `workers` jobs at once on the cluster at `address`, as
    many as it has CPUs for 0. Raises MissingExtra, RpaugError.
    """
    ray = _joined(address)
    given = budget or Budget()

    def pool(todo: Iterable[Job], lost: list[Lost], alone: bool) -> Iterator[Outcome]:
        return _spread(ray, todo, lost, given, 1 if alone else workers, alone)

    with redirect_stdout(sys.stderr):  # Ray says what befalls its nodes
        try:
            yield from with_second_tries(jobs, pool)
        finally:
            ray.shutdown()  # ends what goes on


def _joined(address: str) -> Any:
    """Ray, with this process in a cluster. Raises MissingExtra, RpaugError."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        import ray
    except ImportError:
        raise MissingExtra("ray", "cluster") from None
    host, _, port = address.rpartition(":")
    try:
        if port.isdecimal():  # Ray itself would end this process where nobody answers
            socket.create_connection((host, int(port)), ANSWER).close()
        ray.init(address, log_to_driver=False, logging_level=logging.ERROR, namespace="rpaug")
    except (OSError, OverflowError, ValueError, RuntimeError) as error:
        reason = str(error).split("\n")[0]
        raise RpaugError(f"--address {address}: no Ray cluster there: {reason}") from None
    return ray


def _spread(
    ray: Any, jobs: Iterable[Job], lost: list[Lost], budget: Budget, workers: int, alone: bool
) -> Iterator[Outcome]:
    """No more tasks are with the cluster than it does at once: little is lost with a node, and memory does not grow
    with the number of jobs. Jobs of a run need the same."""
    todo, again = iter(jobs), list[Job]()
    if (first := next(todo, None)) is None:
        return
    on_gpus = _on_a_gpu(first, GPU in ray.cluster_resources())
    task = ray.remote(num_cpus=1, num_gpus=int(on_gpus), max_retries=0)(done)
    todo = chain([first], todo)
    under_way: dict[Any, Job] = {}
    tries: dict[str, int] = {}
    while True:
        there = ray.cluster_resources()
        if on_gpus and GPU not in there:
            yield Outcome(first, 0, NO_GPU, fatal=True)
            return
        most = workers or max(1, int(there.get(GPU if on_gpus else "CPU", 1)))
        while len(under_way) < most and (job := again.pop() if again else next(todo, None)):
            ref = task.options(name=job.key).remote(job, budget, alone, Path.cwd(), __version__)
            under_way[ref] = job
        if not under_way:
            break
        for ref in ray.wait([*under_way], timeout=LOOK)[0]:
            one = under_way.pop(ref)
            for told in _told(ray, ref, one):
                if isinstance(told, Outcome):
                    if told.fatal:
                        todo, again = iter(()), []
                    yield told
                elif told.why != LOST:
                    lost.append(told)
                elif tries.setdefault(one.key, 1) < TRIES:
                    tries[one.key] += 1
                    rest = left(one)
                    again += [rest] if rest.copies or not one.copies else []
                else:
                    lost.append(told)
    if tries:
        sweep(one.target)


def _on_a_gpu(job: Job, there: bool) -> bool:
    """Whether a job is given a GPU: it fits on one, or has models that are to be there, or go where one is."""
    models = Models(**job.recipe.get("models", {}))
    device = "cpu" if models == Models(device=models.device) else models.device
    return job.device == "cuda" or device.startswith("cuda") or (device == "auto" and there)


def _told(ray: Any, ref: Any, job: Job) -> list[Outcome | Lost]:
    """What came of a task."""
    try:
        return ray.get(ref)
    except ray.exceptions.RayTaskError as error:  # of what the node lacks, not of the episode
        reason = str(error).strip().split("\n")[-1]
        return [Outcome(job, 0, f"{job.key}: a node cannot do it: {reason}", fatal=True)]
    except ray.exceptions.RayError:
        return [Lost(job, LOST)]


def done(job: Job, budget: Budget, alone: bool, folder: Path, version: str) -> list[Outcome | Lost]:
    """One job, on the node that does it, in the folder that paths are relative to. Raises RpaugError on a node with
    another rpaug, or one that does not see that folder."""
    if version != __version__:
        raise RpaugError(f"rpaug {__version__} there, {version} here: install one version on all")
    try:
        os.chdir(folder)
    except OSError as error:
        raise RpaugError(f"{folder}: {error.strerror}: nodes must see the same files") from None
    visible, lost = os.environ.get(VISIBLE, ""), list[Lost]()
    for other in _processes.keys() - {visible}:  # another GPU is this worker's now
        for one in _processes.pop(other):
            one.end()
    within = among(budget, 1 if alone else os.cpu_count() or 1)
    with one_thread_each():
        kept = _processes.setdefault(visible, [])
        return [*pooled([job], lost, within, 1, kept), *lost]
