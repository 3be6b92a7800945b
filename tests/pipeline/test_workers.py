"""Jobs in processes of their own: a worker that dies, grows or hangs costs its job alone."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from multiprocessing import active_children
from pathlib import Path

import played_jobs
import pytest

from rpaug.core import progress
from rpaug.pipeline import workers
from rpaug.pipeline.run import Budget


@pytest.fixture
def played(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., dict[str, str | None]]:
    """What becomes of jobs that are called so."""
    monkeypatch.setattr(workers, "_serve", played_jobs.serve)
    monkeypatch.setattr(workers, "left", lambda job: job)

    def outcomes(*names: str, budget: Budget | None = None) -> dict[str, str | None]:
        (tmp_path / ".half.part").mkdir()
        jobs = [played_jobs.job(name, tmp_path) for name in names]
        found = list(workers.run(jobs, 2, budget))
        assert len(found) == len({one.job.key for one in found})
        return {one.job.key: one.error for one in found}

    return outcomes


def test_a_job_whose_worker_dies_again_is_left_out_by_name(
    played: Callable[..., dict[str, str | None]], tmp_path: Path
) -> None:
    found = played("e0", "dies", "e1", "dies once", "e2", "e3")
    assert found.keys() == {"e0", "dies", "e1", "dies once", "e2", "e3"}
    assert {key for key, error in found.items() if error} == {"dies"}
    assert "dies: a worker died" in str(found["dies"])
    assert not (tmp_path / ".half.part").exists()  # what it left half written


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read in /proc")
def test_a_job_beyond_its_budget_costs_itself_alone(
    played: Callable[..., dict[str, str | None]],
) -> None:
    few = Budget(memory=resident(), minutes=0.2)
    found = played("e0", "grows", "hangs", "e1", "e2", budget=few)
    assert {key for key, error in found.items() if not error} == {"e0", "e1", "e2"}
    assert "GB of" in str(found["grows"])
    assert "more than 0.4 minutes" in str(found["hangs"])  # of two copies


def resident() -> float:
    """Bytes of a process that has loaded what workers load, and half of what one takes that grows."""
    line = "import played_jobs; print(open('/proc/self/statm').read().split()[1])"
    env = os.environ | {"PYTHONPATH": str(Path(played_jobs.__file__).parent)}
    ran = subprocess.run(
        [sys.executable, "-c", line], env=env, capture_output=True, text=True, check=True
    )
    return int(ran.stdout) * os.sysconf("SC_PAGE_SIZE") + played_jobs.MEGABYTES * 2**19


@pytest.mark.parametrize(
    ("line", "where", "name"),
    [
        ("0::/system.slice/job_7/step_0", "system.slice/job_7", "memory.max"),
        ("9:memory:/slurm/job_7/step_0", "memory/slurm/job_7", "memory.limit_in_bytes"),
        ("9:memory:/docker/0123", "memory", "memory.limit_in_bytes"),  # as a container sees it
    ],
)
def test_workers_share_the_memory_that_a_job_or_a_container_is_given(
    line: str, where: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / where).mkdir(parents=True, exist_ok=True)
    (tmp_path / where / name).write_text("1000000000\n")
    (tmp_path / "memory.max").touch()
    (tmp_path / "own").write_text(f"1:cpu:/elsewhere\n{line}\n")
    monkeypatch.setattr(workers, "OWN_GROUPS", tmp_path / "own")
    kinds = {"": (tmp_path, "memory.max"), "memory": (tmp_path / "memory", "memory.limit_in_bytes")}
    monkeypatch.setattr(workers, "GROUPS", kinds)
    assert workers.among(Budget(), 4).memory == pytest.approx(0.9e9 / 4)
    assert workers.among(Budget(5.0), 4).memory == 5.0
    (tmp_path / where / name).write_text("max\n")
    (tmp_path / "own").unlink()
    assert workers.among(Budget(), 1).memory > 1e9


def test_one_worker_with_a_budget_is_a_process_too(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(workers, "_serve", played_jobs.serve)
    before = active_children()
    (found,) = workers.run([played_jobs.job("hangs", tmp_path)], 1, Budget(minutes=0.01))
    assert "more than 0.02 minutes" in str(found.error)
    assert {*active_children()} <= {*before}  # it was ended, not left to hang


def test_a_worker_says_how_far_it_is(played: Callable[..., dict[str, str | None]]) -> None:
    told: list[progress.Told] = []
    with progress.heard(told.append):
        assert played("e0", "e1") == {"e0": None, "e1": None}
    assert sorted((one["key"], one["stage"]) for one in told) == [
        ("e0", "has begun"),
        ("e1", "has begun"),
    ]


def test_a_full_disk_ends_the_run(played: Callable[..., dict[str, str | None]]) -> None:
    found = played("full", *(f"e{n}" for n in range(9)))
    assert found["full"] == "No space left"
    assert len(list(found)[list(found).index("full") :]) <= 2  # what the other worker had begun


def test_one_of_several_workers_has_one_thread(
    played: Callable[..., dict[str, str | None]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    assert played("e0", "threads")["threads"] == "1 1 1 1"
    assert os.environ["OMP_NUM_THREADS"] == "8"


BEGINS = """
import os, sys, threading
from multiprocessing import current_process
from rpaug.core import progress
from rpaug.pipeline import workers
sys.path.insert(0, sys.argv[1])
import played_jobs
parent = os.getpid()

def kind(job):
    progress.told(job.key, "at work")
    return workers.Outcome(job, 0, type(current_process()).__name__)

workers.attempt = kind  # of children that are forked
if sys.argv[2] == "threads":
    workers._serve = played_jobs.serve
    threading.Thread(target=threading.Event().wait, daemon=True).start()
with progress.heard(lambda told: print("heard", os.getpid() == parent, flush=True)):
    for done in workers.run([played_jobs.job("kind", ".")], 1, workers.Budget()):
        print(done.error)
"""


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="threads are counted in /proc")
@pytest.mark.parametrize(("given", "kind"), [("none", "ForkProcess"), ("threads", "SpawnProcess")])
def test_a_process_of_one_thread_is_forked_and_its_worker_tells_it_alone(
    given: str, kind: str
) -> None:
    command = [sys.executable, "-c", BEGINS, str(Path(played_jobs.__file__).parent), given]
    env = os.environ | {"OMP_NUM_THREADS": "1"}
    ran = subprocess.run(command, env=env, capture_output=True, text=True, check=True)
    assert ran.stdout.splitlines() == ["heard True", kind]


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
def test_a_worker_that_still_loads_ends_with_the_run(tmp_path: Path) -> None:
    """Its module takes a minute to load; what began it is killed meanwhile."""
    loads = (
        "import time, pathlib; pathlib.Path(r'{}').touch(); time.sleep(60)\ndef serve(given): pass"
    )
    (tmp_path / "slow.py").write_text(loads.format(tmp_path / "loading"))
    line = (
        "from multiprocessing import get_context; from rpaug.core import owner\n"
        "if __name__ == '__main__':\n"
        "    one = get_context('spawn').Process(target=owner.child, args=('slow', 'serve', 0))\n"
        "    one.start(); print(one.pid, flush=True); one.join()"
    )
    (tmp_path / "begins.py").write_text(line)
    begins = subprocess.Popen(
        [sys.executable, str(tmp_path / "begins.py")], stdout=subprocess.PIPE, text=True
    )
    assert begins.stdout
    began = Path("/proc") / begins.stdout.readline().strip() / "stat"
    while not (tmp_path / "loading").exists():
        assert begins.poll() is None
    begins.kill()
    begins.wait()
    ends = time.monotonic() + 5
    while began.exists() and time.monotonic() < ends:
        time.sleep(0.05)
    assert not began.exists() or began.read_text().rsplit(")", 1)[1].split()[0] == "Z"
