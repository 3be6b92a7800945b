"""Two nodes of a Ray cluster against one, each with one CPU of this machine: seconds of a run, start included.

    python tools/bench/two_nodes.py [--episodes 8] [--copies 3] [--pairs 3] [--json FILE]

Runs the sample's episode so many times, with so many copies, by turns on one node and on two. Other work on the machine
takes from all: the ratio of each pair is taken, and their median. Processor seconds are those of the processes that do
the jobs: as many on two nodes as on one if nothing is done twice. A ratio over two is the machine's other work.
"""

import argparse
import json
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
from cost import dataset
from killed import NODE, works

from rpaug.pipeline import cluster, recipe
from rpaug.pipeline.augment import execute
from rpaug.pipeline.job import Job
from rpaug.pipeline.run import Budget, Run
from rpaug.pipeline.workers import Outcome

RECIPE = {"version": 1, "edits": [{"op": "light_color"}]}
TICKS = os.sysconf("SC_CLK_TCK")


def processor_seconds() -> float:
    """Of the processes that do jobs on the nodes now."""
    total = 0
    for one in Path("/proc").iterdir():
        if one.name.isdigit() and works(int(one.name), b"ray::"):
            with suppress(OSError):
                fields = (one / "stat").read_text().rsplit(")", 1)[1].split()
                total += int(fields[11]) + int(fields[12])
    return total / TICKS


def measured(source: Path, out: Path, copies: int, address: str) -> dict[str, float]:
    """A run on all nodes."""
    processor = list[float]()

    def timed(jobs: Iterable[Job], workers: int, budget: Budget | None) -> Iterator[Outcome]:
        for outcome in cluster.run(jobs, workers, budget, address):
            processor.append(processor_seconds())
            yield outcome

    begun = time.monotonic()
    wanted = recipe.build(RECIPE | {"copies": copies})
    summary = execute(Run(source, wanted, out), workers=0, engine=timed)
    assert summary.exit_code == 0, summary.failures
    return {"seconds": time.monotonic() - begun, "processor_seconds": processor[-1]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--episodes", type=int, default=8)
    parser.add_argument("--copies", type=int, default=3)
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    from ray.cluster_utils import Cluster

    os.environ["OMP_NUM_THREADS"] = "1"
    found: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as made:
        source = dataset(Path(made, "in"), given.episodes)
        nodes = Cluster(initialize_head=True, head_node_args=NODE)
        run = partial(measured, source, copies=given.copies, address=nodes.address)
        try:
            for pair in range(given.pairs):
                one = run(out=Path(made, f"one{pair}"))
                second = nodes.add_node(**NODE)
                two = run(out=Path(made, f"two{pair}"))
                nodes.remove_node(second)
                found.append({"one": one, "two": two, "load": os.getloadavg()[0]})
                print(json.dumps(found[-1]), flush=True)
        finally:
            nodes.shutdown()
    ratios = [pair["one"]["seconds"] / pair["two"]["seconds"] for pair in found]
    told = {"median": statistics.median(ratios), "ratios": ratios, "pairs": found}
    print(json.dumps(told))
    if given.json:
        given.json.write_text(json.dumps(told, indent=1) + "\n")


if __name__ == "__main__":
    main()
