"""Whether policies get better: the same small policy trained on several kinds of data, tested under each factor.

    python -m tools.bench.closed_loop run WORK [--seeds 2] [--episodes 10] [--demos 25] [--smoke] [--json]
    python -m tools.bench.closed_loop table OUTCOMES [--arms ARM ...] [--seeds 0 1 ...] [--record TOPIC]
    python -m tools.bench.closed_loop train POLICY DATASET [DATASET ...] [--seed 0] [--steps 2000]
    python -m tools.bench.closed_loop eval POLICY EVALUATION

`run` does everything that is not yet done in WORK, so that it can be stopped and started again, writes what came of
every episode to WORK/outcomes.json, and prints the tables, as `table` does again from such a file; with --record they
become a topic's in docs/benchmarks/results.
`train` and `eval` are what `rpaug loop` is given in the arm `diagnosed`. With --smoke two tasks, few demonstrations,
steps and episodes show within minutes that all of it works; its numbers mean nothing.
"""

import argparse
import json
import shlex
import sys
from pathlib import Path

import torch

from tools.bench.closed_loop import arms, result
from tools.bench.harness import pages

ORDER = (
    "plain",
    "jitter",
    "oracle_valid",
    "oracle",
    "diagnosed",
    "rpaug",
)  # each is held to those before it


def main() -> None:
    """One of the three commands."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parts = parser.add_subparsers(dest="command", required=True)
    run_ = parts.add_parser("run")
    run_.add_argument("work", type=Path)
    run_.add_argument("--arms", nargs="+", choices=arms.ARMS, default=arms.ARMS)
    run_.add_argument("--seeds", type=int, default=2)
    run_.add_argument("--demos", type=int, default=arms.Size.demos)
    run_.add_argument("--episodes", type=int, default=arms.Size.episodes)
    run_.add_argument("--steps", type=int, default=arms.Size.steps)
    run_.add_argument("--workers", type=int, default=2)
    run_.add_argument("--smoke", action="store_true")
    run_.add_argument("--json", action="store_true")
    table_ = parts.add_parser("table")
    table_.add_argument("outcomes", type=Path)
    table_.add_argument("--arms", nargs="+", choices=arms.ARMS)
    table_.add_argument(
        "--seeds", type=int, nargs="+", help="all; arms without one of them are left out"
    )
    table_.add_argument("--record", metavar="TOPIC")
    train_ = parts.add_parser("train")
    train_.add_argument("policy", type=Path)
    train_.add_argument("datasets", type=Path, nargs="+", help="the recorded one first")
    train_.add_argument("--seed", type=int, default=0)
    train_.add_argument("--steps", type=int, default=arms.Size.steps)
    eval_ = parts.add_parser("eval")
    eval_.add_argument("policy", type=Path)
    eval_.add_argument("evaluation", type=Path)
    eval_.add_argument("--episodes", type=int, default=arms.Size.episodes)
    eval_.add_argument("--tasks", nargs="+", default=arms.TASKS)
    given = parser.parse_args()
    torch.set_num_threads(1)
    if given.command == "train":
        arms.learn(given.policy, given.datasets, given.seed, given.steps, False, arms.TASKS)
    elif given.command == "eval":
        arms.judge(given.policy, given.evaluation, given.tasks, given.episodes)
    elif given.command == "table":
        kept: result.Kept = json.loads(given.outcomes.read_bytes())
        seeds = given.seeds or sorted({int(seed) for trained in kept.values() for seed in trained})
        names = given.arms or [
            n for n in arms.ARMS if n in kept and {*map(str, seeds)} <= {*kept[n]}
        ]
        command = shlex.join(["python", *sys.orig_argv[1:]]).partition(" --record")[0]
        for table in result.tables(kept, names, seeds, command):
            print(table.markdown())
            if given.record:
                pages.record(given.record, table)
    else:
        size = arms.SMOKE
        if not given.smoke:
            size = arms.Size(demos=given.demos, episodes=given.episodes, steps=given.steps)
        arms.run(given.work, size, given.arms, range(given.seeds), given.workers, given.json)


if __name__ == "__main__":
    main()
