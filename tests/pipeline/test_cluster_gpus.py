"""Which jobs of a cluster are given a GPU, and which process they meet there; Ray itself is played."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import played_jobs
import pytest

from rpaug.pipeline import cluster, workers
from rpaug.pipeline.job import Job
from rpaug.pipeline.run import Budget

FINDS = {"text": "a-model"}


class PlayedRay:
    """A cluster that does a task when it is waited for; what tasks ask for, and how many were there at once."""

    def __init__(self, **resources: float) -> None:
        self.resources, self.most = resources, 0
        self.asked: dict[str, int] = {}
        self.jobs: dict[str, Job] = {}

    def cluster_resources(self) -> dict[str, float]:
        return self.resources

    def remote(self, **asked: int) -> Any:
        self.asked = asked
        return lambda done: SimpleNamespace(options=lambda name: SimpleNamespace(remote=self.begin))

    def begin(self, job: Job, *_: Any) -> str:
        self.jobs[job.key] = job
        return job.key

    def wait(self, refs: list[str], timeout: float) -> tuple[list[str], list[str]]:
        self.most = max(self.most, len(refs))
        return refs[:1], refs[1:]

    def get(self, ref: str) -> list[workers.Outcome]:
        return [workers.Outcome(self.jobs[ref], 1)]


def jobs(models: dict[str, str], device: str) -> list[Job]:
    recipe = {"models": models} if models else {}
    return [
        Job("rlbench", Path(), f"e{n}", Path(), ((1, "a"),), recipe, 0, device=device)
        for n in range(9)
    ]


@pytest.mark.parametrize(
    ("models", "device", "gpus", "most"),
    [
        ({}, "cpu", 0, 4),
        ({}, "cuda", 1, 2),
        (FINDS, "cpu", 1, 2),
        (FINDS | {"device": "cpu"}, "cpu", 0, 4),
        (FINDS | {"device": "cuda:0"}, "cpu", 1, 2),
        ({"device": "cuda"}, "cpu", 0, 4),
    ],
)
def test_who_is_given_a_gpu(models: dict[str, str], device: str, gpus: int, most: int) -> None:
    ray = PlayedRay(CPU=4, GPU=2)
    found = list(cluster._spread(ray, jobs(models, device), [], Budget(), 0, False))
    assert len(found) == 9
    assert ray.asked == {"num_cpus": 1, "num_gpus": gpus, "max_retries": 0}
    assert ray.most == most


def test_without_a_gpu_there_models_go_without_and_fits_end_in_words() -> None:
    ray = PlayedRay(CPU=4)
    assert len(list(cluster._spread(ray, jobs(FINDS, "cpu"), [], Budget(), 0, False))) == 9
    assert ray.asked["num_gpus"] == 0
    (found,) = cluster._spread(ray, jobs({}, "cuda"), [], Budget(), 0, False)
    assert found.fatal
    assert "no node of the cluster has a GPU" in str(found.error)
    assert list(cluster._spread(ray, [], [], Budget(), 0, False)) == []


def test_a_process_is_kept_for_the_gpu_that_it_sees(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(workers, "_serve", played_jobs.serve)
    monkeypatch.setattr(cluster, "_processes", {})

    def process(gpu: str) -> workers.WorkerProcess:
        monkeypatch.setenv(cluster.VISIBLE, gpu)
        given = played_jobs.job("e0", tmp_path), Budget(), False, Path.cwd(), cluster.__version__
        (found,) = cluster.done(*given)
        assert isinstance(found, workers.Outcome)
        (one,) = cluster._processes[gpu]
        return one

    first, same, other = process("0"), process("0"), process("1")
    assert (first is same, first is other) == (True, False)
    assert not Path(f"/proc/{first.process.pid}").exists()
    assert list(cluster._processes) == ["1"]
    other.end()
