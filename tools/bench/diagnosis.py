"""Does the rule-based analyst find a policy's planted weakness, from pictures alone?

    python tools/bench/diagnosis.py                  each weakness alone, pairs, none, and failures by chance
    python tools/bench/diagnosis.py --single         in every rollout one factor is changed, or none
    python tools/bench/diagnosis.py --given masks    the evaluation gives masks and roles too
    python tools/bench/diagnosis.py --room 2         another room: other walls, recordings and rollouts

A case is a policy with one or two weaknesses and some rollouts of the twin, each with several factors changed. The
analyst gets the rollouts' pictures and outcomes, and ten training recordings. Policies are those of
`diagnosis_policies.py`. Rollouts are drawn from a pool (`--pool`), so that cases share some; `--cache` keeps the pool.
Seconds are processor time.
"""

import argparse
import itertools
import json
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import diagnosis_pool
import numpy as np
from diagnosis_policies import WEAK, Outcomes, Trained, outcomes
from diagnosis_pool import CAMERA, CHANGES, ROOM, TASK, WALLS, Seen

from rpaug import twin
from rpaug.diagnosis import measure, reference, weigh
from rpaug.diagnosis.evaluation import CameraShot, Evaluation, Rollout
from rpaug.diagnosis.messages import KEPT
from rpaug.twin import factors
from rpaug.twin.look import Look

ROLLOUTS = 60
CLEAR = 0.0  # share of the training pictures in which anything is changed
ROLES = {
    "manipulated": ("block_plain",),
    "table": ("table",),
    "background": factors.BACKGROUND,
    "robot": ("hand", "finger_left", "finger_right", *(f"link{k}" for k in range(8))),
}


def main() -> None:
    """Print a table, or one JSON value."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=100, help="for each factor, and for all pairs")
    parser.add_argument("--pool", type=int, default=360)
    parser.add_argument("--rollouts", type=int, default=ROLLOUTS, help="in one case")
    parser.add_argument(
        "--share", type=float, default=0.3, help="of rollouts with a factor changed"
    )
    parser.add_argument("--single", action="store_true", help="one factor changed at a time")
    parser.add_argument("--given", choices=("pictures", "masks"), default="pictures")
    parser.add_argument("--cache", type=Path, default=None)
    parser.add_argument("--room", type=int, default=0, help="0 is what the analyst was written on")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    start = time.process_time()
    cache, room = options.cache, options.room
    pool = diagnosis_pool.pool(options.pool, options.share, options.single, cache, 0, room)
    acts = outcomes(pool, Trained(diagnosis_pool.pool(30, CLEAR, False, cache, 9000, room)))
    table = _table(pool, _reference(cache, room), options.given == "masks")
    drawn = time.process_time() - start
    figures = _figures(acts, table, options)
    figures["seconds"] = {
        "pool and measuring": round(drawn, 1),
        "all": round(time.process_time() - start, 1),
    }
    if options.json:
        sys.stdout.write(json.dumps(figures, indent=1) + "\n")
    else:
        _print(figures)


def _figures(acts: Outcomes, table: measure.Table, options: argparse.Namespace) -> dict[str, Any]:
    names = list(CHANGES)
    alone = {
        name: [_case(acts, table, (name,), n, options.rollouts) for n in range(options.cases)]
        for name in names
    }
    pairs = list(itertools.combinations(names, 2))
    both = [
        (pair := pairs[n % len(pairs)], _case(acts, table, pair, n, options.rollouts))
        for n in range(options.cases)
    ]
    chance = [_by_chance(table, n, options.rollouts) for n in range(options.cases)]
    first = {name: sum(one[0][0] == name for one in cases) for name, cases in alone.items()}
    return {
        "first": first,
        "first, all": sum(first.values()) / options.cases / len(names),
        "confusion": {name: Counter(one[0][0] for one in cases) for name, cases in alone.items()},
        "failure rate": {
            n: round(float(np.mean([c[2] for c in cases])), 2) for n, cases in alone.items()
        },
        "kept, of those first": sum(
            c[0][0] == n and c[1] > KEPT for n, cs in alone.items() for c in cs
        )
        / max(1, sum(first.values())),
        "pairs, both in three": sum(set(pair) <= set(one[0][:3]) for pair, one in both) / len(both),
        "pairs missed": Counter(name for pair, one in both for name in set(pair) - set(one[0][:3])),
        "failures by chance, a cause kept": sum(chance) / len(chance),
        "cases": options.cases,
    }


def _case(
    acts: Outcomes, table: measure.Table, weak: tuple[str, ...], number: int, count: int
) -> tuple[list[str], float, float]:
    """The factors, the likeliest first, the confidence in that one, and the share of failures."""
    rng = np.random.default_rng([11, number, *(list(WEAK).index(one) for one in weak)])
    rows = rng.choice(len(table.names), count, replace=False)
    failed = acts.failed(rows, weak, rng)
    found = weigh.ranked(table.taken(rows, failed), number)
    return [one.factor for one in found], found[0].confidence, float(failed.mean())


def _by_chance(table: measure.Table, number: int, count: int) -> bool:
    """Whether a cause is kept where failures have none."""
    rng = np.random.default_rng([12, number])
    rows = rng.choice(len(table.names), count, replace=False)
    found = weigh.ranked(table.taken(rows, rng.random(count) < 0.3), number)
    return any(one.confidence > KEPT for one in found)


def _table(pool: list[Seen], usual: reference.Reference, masks: bool) -> measure.Table:
    """All rollouts measured once; outcomes are each case's own."""
    rollouts = tuple(
        Rollout(
            str(n), True, "",
            {CAMERA: {0: CameraShot(lambda s=s: s.rgb, (lambda s=s: s.ids) if masks else None)}},
            {r: frozenset(s.handles[p] for p in ps if p in s.handles) for r, ps in ROLES.items()} if masks else {},
        )
        for n, s in enumerate(pool)
    )  # fmt: skip
    return measure.table(Evaluation(rollouts), usual)


def _reference(cache: Path | None, room: int) -> reference.Reference:
    """Ten training recordings, written and read like anyone's."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "recordings" if cache is None else cache / f"recordings-{room}"
        if not root.exists():
            twin.record(
                TASK,
                3 + ROOM * room,
                root,
                look=Look(texture_seed=WALLS + ROOM * room),
                size=diagnosis_pool.SIZE,
                frames=20,
                episodes=10,
            )
        return reference.learn(root)


def _print(figures: dict[str, Any]) -> None:
    names = list(figures["first"])
    out = sys.stdout.write
    out(f"{'weak at':18}{'first of ' + str(figures['cases']):>14}{'fails':>8}   named instead\n")
    for name in names:
        wrong = {k: v for k, v in figures["confusion"][name].most_common(4) if k != name}
        given = ", ".join(f"{k} {v}" for k, v in wrong.items())
        out(
            f"{name:18}{figures['first'][name]:>14}{figures['failure rate'][name]:>8.2f}   {given}\n"
        )
    for name in (
        "first, all",
        "kept, of those first",
        "pairs, both in three",
        "failures by chance, a cause kept",
    ):
        out(f"{name:36}{figures[name]:.3f}\n")
    out(f"pairs missed: {dict(figures['pairs missed'])}\nseconds: {figures['seconds']}\n")


if __name__ == "__main__":
    main()
