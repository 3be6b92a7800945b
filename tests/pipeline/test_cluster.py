"""Jobs on a Ray cluster of two nodes on this machine: the bytes of one machine, whatever is lost on the way."""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("ray", reason="the extra `cluster` is not installed")

from ray.cluster_utils import Cluster
from runs import GROUP, augment, contents
from test_augment import RECIPE, alive, long_run, made
from test_merge import MADE, WANTED, rlbench

from rpaug.core.errors import RpaugError
from rpaug.pipeline import cluster, recipe

FEW = {"num_cpus": 1, "include_dashboard": False, "object_store_memory": 80 * 2**20}


@pytest.fixture(scope="module")
def nodes() -> Iterator[Cluster]:
    """A cluster whose second node a test may take, and gives back."""
    started = Cluster(initialize_head=True, head_node_args=FEW)
    started.add_node(**FEW)
    yield started
    started.shutdown()


@pytest.fixture
def command(
    nodes: Cluster, template: Path, tmp_path: Path
) -> tuple[list[str], Path, dict[str, bytes]]:
    """A command that augments six episodes on the cluster, its output, and what one process makes of them."""
    given, many, out = long_run(template, tmp_path)
    at = given.index("--workers")
    given[at : at + 2] = ["--engine", "ray", "--address", nodes.address, "--json"]
    augment(many, recipe.load(tmp_path / "r.yaml"), tmp_path / "one")
    return given, out, contents(tmp_path / "one")


def shown(out: Path) -> dict[str, bytes]:
    """All but what the command makes beside."""
    return {name: data for name, data in contents(out).items() if name != "rpaug.contact.html"}


def begun(run: subprocess.Popen[str], out: Path) -> None:
    while run.poll() is None and not (out / GROUP / "episode1").exists():
        time.sleep(0.01)
    assert run.poll() is None


@pytest.mark.parametrize("kind", ["rlbench", *MADE])
def test_two_nodes_make_the_bytes_of_one_process(
    kind: str, nodes: Cluster, template: Path, tmp_path: Path
) -> None:
    engine, source = partial(cluster.run, address=nodes.address), tmp_path / "in"
    rlbench(source, template) if kind == "rlbench" else MADE[kind](source)
    augment(source, WANTED, tmp_path / "ray", workers=0, engine=engine)
    augment(source, WANTED, tmp_path / "one")
    assert contents(tmp_path / "ray") == contents(tmp_path / "one")


def test_a_lost_node_costs_nothing(
    nodes: Cluster, command: tuple[list[str], Path, dict[str, bytes]]
) -> None:
    given, out, wanted = command
    run = subprocess.Popen(given, stdout=subprocess.PIPE, text=True)
    begun(run, out)
    nodes.remove_node(nodes.list_all_nodes()[1], allow_graceful=False)
    printed, _ = run.communicate()
    nodes.add_node(**FEW)
    assert (run.returncode, json.loads(printed)["failures"]) == (0, {})
    assert shown(out) == wanted
    assert not list(out.rglob("*.part"))


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for processes in /proc")
@pytest.mark.parametrize("sent", [signal.SIGTERM, signal.SIGKILL])
def test_a_killed_run_ends_on_all_nodes_and_can_go_on(
    sent: signal.Signals, command: tuple[list[str], Path, dict[str, bytes]]
) -> None:
    given, out, wanted = command
    run = subprocess.Popen(given, stdout=subprocess.PIPE, text=True)
    begun(run, out)
    at_work = processes()
    assert at_work
    run.send_signal(sent)
    run.wait()
    ends = time.monotonic() + 5
    while time.monotonic() < ends and any(map(alive, at_work)):
        time.sleep(0.05)
    assert not any(map(alive, at_work))
    again = subprocess.run([*given, "--resume"], stdout=subprocess.PIPE, check=False)
    assert again.returncode == 0
    assert shown(out) == wanted


def processes() -> list[int]:
    """Those that do jobs: fresh ones that a Ray worker began."""
    found = []
    for folder in Path("/proc").iterdir():
        try:
            line = (folder / "cmdline").read_bytes()
            parent = (folder / "stat").read_text().rsplit(")", 1)[1].split()[1]
            above = Path(f"/proc/{parent}/cmdline").read_bytes()
        except (OSError, IndexError):
            continue
        if b"spawn_main" in line and b"ray::" in above:
            found.append(int(folder.name))
    return found


def test_a_killed_process_costs_its_job_one_more_try(
    command: tuple[list[str], Path, dict[str, bytes]],
) -> None:
    given, out, wanted = command
    run = subprocess.Popen(given, stdout=subprocess.PIPE, text=True)
    begun(run, out)
    os.kill(processes()[0], signal.SIGKILL)
    printed, _ = run.communicate()
    assert (run.returncode, json.loads(printed)["failures"]) == (0, {})
    assert shown(out) == wanted


def test_a_bad_episode_costs_itself_alone(nodes: Cluster, dataset: Path, tmp_path: Path) -> None:
    image = dataset / GROUP / "episode0/front_rgb/2.png"
    image.write_bytes(image.read_bytes()[:-9])
    engine = partial(cluster.run, address=nodes.address)
    found = augment(dataset, made(), tmp_path / "out", workers=0, engine=engine)
    assert (found.copies, list(found.failures)) == (2, [f"{GROUP}/episode0"])


def test_another_rpaug_on_a_node_ends_the_run_in_words(
    nodes: Cluster, template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "__version__", "0.0.1")
    engine = partial(cluster.run, address=nodes.address)
    found = augment(template, made(), tmp_path / "out", workers=0, engine=engine)
    assert "install one version on all" in str(found.aborted)
    assert not (tmp_path / "out").exists()


def test_no_cluster_is_told(template: Path, tmp_path: Path) -> None:
    engine: Any = partial(cluster.run, address="127.0.0.1:1")
    with pytest.raises(RpaugError, match="no Ray cluster there"):
        augment(template, made(), tmp_path / "out", workers=0, engine=engine)


def test_without_ray_the_extra_is_named() -> None:
    line = "import sys; sys.modules['ray'] = None; from rpaug.pipeline import cluster; "
    done = subprocess.run(
        [sys.executable, "-c", line + "list(cluster.run([], 0))"], capture_output=True, text=True
    )
    assert "pip install 'rpaug[cluster]'" in done.stderr


EXAMPLES = Path(__file__).parents[2] / "examples"


def as_named(template: Path, folder: Path) -> None:
    """The dataset and recipe that the examples' scripts name."""
    shutil.copytree(template, folder / "data/train/open_drawer")
    (folder / "recipe.yaml").write_text(json.dumps(RECIPE))


SRUN = """#!/bin/bash
while [[ $1 == -* ]]; do shift 2; done
exec "$@"
"""


def test_the_slurm_job_of_the_examples_runs_as_written(template: Path, tmp_path: Path) -> None:
    """Both nodes on this machine, which `ray start` has for several."""
    as_named(template, tmp_path)
    for name, text in {"srun": SRUN, "scontrol": "#!/bin/bash\necho 127.0.0.1\n"}.items():
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    path = f"{tmp_path}:{Path(sys.executable).parent}:{os.environ['PATH']}"
    given = {"SLURM_JOB_ID": "4711", "SLURM_NNODES": "2", "SLURM_CPUS_PER_TASK": "1"}
    env = os.environ | given | {"SLURM_JOB_NODELIST": "n[1-2]", "PATH": path}
    run = subprocess.Popen(
        ["bash", EXAMPLES / "slurm_ray.sh"],
        cwd=tmp_path,
        env=env,
        start_new_session=True,
        stdout=subprocess.DEVNULL,
    )
    try:
        assert run.wait() == 0
    finally:
        os.killpg(run.pid, signal.SIGKILL)  # as Slurm ends what a job began
    augment(tmp_path / "data/train/open_drawer", recipe.build(RECIPE), tmp_path / "one")
    assert shown(tmp_path / "augmented") == contents(tmp_path / "one")


def test_the_job_of_the_examples_runs_as_submitted(
    template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To a cluster of one node with Ray's dashboard, which takes jobs."""
    pytest.importorskip("aiohttp_cors", reason="ray without its dashboard: no `ray[default]`")
    as_named(template, tmp_path)
    port = free_port()
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    monkeypatch.setenv("RAY_API_SERVER_ADDRESS", f"http://127.0.0.1:{port}")
    shows = {**FEW, "include_dashboard": True, "dashboard_port": port}
    head = Cluster(initialize_head=True, head_node_args=shows)
    ready = ["ray", "job", "submit", "--", "true"]
    try:
        while subprocess.run(ready, capture_output=True).returncode:
            time.sleep(1)  # until the dashboard has found the node
        subprocess.run(["bash", EXAMPLES / "ray_job.sh"], cwd=tmp_path, check=True)
        named = shown_in_the_dashboard(f"http://127.0.0.1:{port}")
    finally:
        head.shutdown()
    augment(tmp_path / "data/train/open_drawer", recipe.build(RECIPE), tmp_path / "one")
    assert shown(tmp_path / "augmented") == contents(tmp_path / "one")
    assert named == {f"{GROUP}/episode{number}": "FINISHED" for number in range(2)}


def shown_in_the_dashboard(address: str) -> dict[str, str]:
    """Our tasks by name, with their states; it hears of them a second later."""
    from ray.util.state import list_tasks

    ends = time.monotonic() + 20
    while True:
        tasks = list_tasks(address=address, filters=[("func_or_class_name", "=", "done")])
        found = {one.name: one.state for one in tasks}
        if (found and {*found.values()} == {"FINISHED"}) or time.monotonic() > ends:
            return found
        time.sleep(1)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        return int(listening.getsockname()[1])
