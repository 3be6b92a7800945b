"""Runs of the whole command killed at random moments (kill -9), then gone on with: are the bytes those of one run?

    python tools/bench/killed.py [--trials 100] [--layout rlbench] [--engine local] [--seed 0] [--json FILE]

Six tiny episodes of the twin, two copies each, on two workers. By turns the run itself is killed and resumed, and one
of its workers, which the run must get over by itself; with `--engine ray` (two nodes on this machine, extra `cluster`)
a node is killed as well. The moment is drawn evenly over the time from the first sign of the run to its end; what ends
before its moment is run again. Then no process and no temporary file may be left five seconds later, and every file but
the journal, the summary and the contact sheet, and the seconds in reports, must be as an undisturbed run wrote it. What
FILE counts already is not done again.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rpaug import twin
from rpaug.pipeline import journal, report
from rpaug.pipeline.augment import execute
from rpaug.pipeline.convert import convert
from rpaug.pipeline.recipe import build
from rpaug.pipeline.run import Run

RECIPE = {
    "version": 1,
    "copies": 2,
    "edits": [{"op": "light_color", "range": [[0.36, 0.36, 0.33], [0.5, 0.5, 0.5]]}],
}
APART = (journal.NAME, report.SUMMARY, report.CONTACT_SHEET)  # files that tell of one run alone
ENDS = 5.0  # seconds in which all that a killed run began must be gone
NODE = {"num_cpus": 1, "include_dashboard": False, "object_store_memory": 80 * 2**20}


def dataset(folder: Path, layout: str) -> Path:
    """Six episodes of the twin, of other lengths."""
    root = folder / "recorded"
    twin.record("open_drawer", 0, root, size=32, frames=16, episodes=6)
    if layout == "rlbench":
        return root
    convert(root, folder / layout, layout)
    return folder / layout


def contents(folder: Path) -> dict[str, bytes]:
    """Every file that an undisturbed run writes alike; of reports all but the seconds."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.name not in APART:
            data = path.read_bytes()
            if path.name == report.NAME:
                data = json.dumps(json.loads(data) | {"seconds": {}}).encode()
            found[path.relative_to(folder).as_posix()] = data
    return found


def descendants(pid: int) -> list[int]:
    """Processes below one, as they are now."""
    found = []
    with suppress(OSError):
        for thread in Path(f"/proc/{pid}/task").iterdir():
            found += [int(one) for one in (thread / "children").read_text().split()]
    return found + [below for one in found for below in descendants(one)]


def works(pid: int, parent: bytes = b"") -> bool:
    """Whether a process does jobs of a run; on Ray its parent's command holds `parent`."""
    with suppress(OSError, IndexError):
        stat = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        line, above = (Path(f"/proc/{one}/cmdline").read_bytes() for one in (pid, stat[1]))
        return (b"spawn_main" in line or line == above) and parent in above  # forked: alike
    return False


def alive(pid: int) -> bool:
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    return False


@dataclass
class Bench:
    """A dataset, what an undisturbed run makes of it, and the cluster if runs are on one."""

    folder: Path
    source: Path
    cluster: Any = None
    wanted: dict[str, bytes] = field(default_factory=dict)
    lasts: float = 0.0

    def command(self, out: Path) -> list[str]:
        (self.folder / "recipe.yaml").write_text(json.dumps(RECIPE))
        engine = ["--engine", "ray", "--address", self.cluster.address] if self.cluster else []
        given = ["--recipe", str(self.folder / "recipe.yaml"), "--out", str(out), *engine]
        return [sys.executable, "-m", "rpaug", "augment", str(self.source), *given, "--workers=2"]

    @contextmanager
    def begun(self, out: Path) -> Iterator[subprocess.Popen[bytes]]:
        """A run of which there is a sign; its processes are ended at last."""
        env = os.environ | {"OMP_NUM_THREADS": "1"}
        run = subprocess.Popen(
            self.command(out), env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            while run.poll() is None and not (out / journal.NAME).exists():
                time.sleep(0.005)
            yield run
        finally:
            for pid in [*descendants(run.pid), run.pid]:
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            run.wait()

    def workers(self, run: int) -> list[int]:
        if not self.cluster:
            return [pid for pid in descendants(run) if works(pid)]
        every = (int(one.name) for one in Path("/proc").iterdir() if one.name.isdigit())
        return [pid for pid in every if works(pid, b"ray::")]

    def undisturbed(self) -> None:
        """What one process makes of it, and how long the command takes from its first sign to its end."""
        execute(Run(self.source, build(RECIPE), self.folder / "one"))
        self.wanted = contents(self.folder / "one")
        out = self.folder / "warm"
        with self.begun(out) as run:
            begun = time.monotonic()
            assert run.wait() == 0
        self.lasts = time.monotonic() - begun
        assert contents(out) == self.wanted
        shutil.rmtree(out)

    def trial(self, who: str, rng: random.Random) -> list[str] | None:
        """What was wrong after one kill; None where the run had ended before its moment."""
        out = self.folder / "out"
        with self.begun(out) as run:
            time.sleep(rng.uniform(0, self.lasts))
            at_work = self.workers(run.pid)
            early = run.poll() is not None or (who == "worker" and not at_work)
            faults = [] if early else self.killed(who, run, at_work, rng)
        if early:
            self.settled(at_work)
            shutil.rmtree(out)
            return None
        if who == "run":
            execute(Run(self.source, build(RECIPE), out), resume=True)
        found = contents(out)
        differ = sorted(
            {n for n, data in self.wanted.items() if found.get(n) != data}
            | found.keys() - self.wanted.keys()
        )
        faults += [f"other bytes: {', '.join(differ[:5])}"] if differ else []
        left = [str(path) for path in self.folder.rglob(".*") if path.suffix in (".part", ".lock")]
        faults += [f"left: {', '.join(left)}"] if left else []
        shutil.rmtree(out)
        return faults

    def killed(
        self, who: str, run: subprocess.Popen[bytes], at_work: list[int], rng: random.Random
    ) -> list[str]:
        """Kill, and wait for what that must come to."""
        if who == "run":
            run.kill()
            run.wait()
            return [] if self.settled(at_work) else ["workers lived on"]
        if who == "node":
            node = self.cluster.list_all_nodes()[1]
            self.cluster.remove_node(node, allow_graceful=False)
            code = run.wait()
            self.cluster.add_node(**NODE)
        else:
            os.kill(rng.choice(at_work), signal.SIGKILL)
            code = run.wait()
        return [f"exit code {code}"] if code else []

    def settled(self, at_work: list[int]) -> bool:
        """Whether those processes end in time."""
        ends = time.monotonic() + ENDS
        while any(map(alive, at_work)) and time.monotonic() < ends:
            time.sleep(0.05)
        return not any(map(alive, at_work))


@contextmanager
def nodes(engine: str) -> Iterator[Any]:
    """Two nodes of Ray on this machine, or None."""
    if engine != "ray":
        yield None
        return
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args=NODE)
    cluster.add_node(**NODE)
    try:
        yield cluster
    finally:
        cluster.shutdown()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--layout", default="rlbench")
    parser.add_argument("--engine", choices=["local", "ray"], default="local")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    kinds = ["run", "worker"] + (["node"] if given.engine == "ray" else [])
    before = json.loads(given.json.read_text()) if given.json and given.json.exists() else {}
    done, wrong = Counter[str](before.get("killed", {})), list[str](before.get("wrong", []))
    with tempfile.TemporaryDirectory() as made, nodes(given.engine) as cluster:
        bench = Bench(Path(made), dataset(Path(made), given.layout), cluster)
        bench.undisturbed()
        rng = random.Random(f"{given.seed} {done.total()}")
        while done.total() < given.trials:
            who = kinds[done.total() % len(kinds)]
            faults = bench.trial(who, rng)
            if faults is not None:
                done[who] += 1
                wrong += [f"{who}, {done.total()}: {fault}" for fault in faults]
                print(f"{done.total()} {who}: {'; '.join(faults) or 'the same'}", flush=True)
                found = {"layout": given.layout, "engine": given.engine, "killed": dict(done)}
                if given.json:
                    given.json.write_text(json.dumps(found | {"wrong": wrong}, indent=1) + "\n")
    print(json.dumps({"killed": dict(done), "wrong": wrong}))


if __name__ == "__main__":
    main()
