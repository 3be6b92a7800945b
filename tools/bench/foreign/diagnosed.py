"""Does the rule-based analyst find what was planted in a foreign world, and does its recipe reach that?

    python -m tools.bench.foreign.diagnosed --data data/worked/TASK --recorded recorded/worked/TASK \\
        --layouts layouts/worked/TASK --python foreign/bin/python --out diagnosed

`--data` holds the converted training recordings of `--recorded`; `--layouts` one-frame recordings of other seeds
(`record --frames 1 --first 1000`). Every factor of a rollout is changed by a chance of 0.3. A case plants one cause: a
range of one factor's values, at least 40 % of those that were drawn. Rollouts in that range fail by a chance of 0.9,
all others by 0.05; in cases of failures by chance all fail by 0.3. Given pictures, or masks and true roles too.

The recipe reaches a planted range if the cause is kept and its edit draws from the range's middle; texture, table and
background are reached by an edit of theirs, a planted look-alike by an added thing of the target's color. Object
position has no edit.
"""

import argparse
import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rpaug.diagnosis import measure, reference, remedies, rules
from rpaug.diagnosis.evaluation import CameraShot, Evaluation, Rollout
from rpaug.diagnosis.messages import KEPT, Cause
from tools.bench.foreign.met import CAMERA
from tools.bench.foreign.planted import FACTORS, Pool, Values, pool
from tools.bench.harness import pages

PAGE = "diagnosis_foreign"
ROLLOUTS = 60
WITHIN, BESIDE, CHANCE = 0.9, 0.05, 0.3  # chances of failing
NARROWEST = 0.4  # share of a factor's drawn values in a planted range
SIDED = ("object size", "lighting")
NO_EDIT = "object position"


class Plant:
    """One planted cause: `value` of `factor` beyond `bar`, on the sides that count."""

    def __init__(self, values: Sequence[Values], factor: str, rng: np.random.Generator) -> None:
        self.factor = factor
        drawn = np.array([one[factor] for one in values if factor in one])
        self.sides = ((-1,), (1,), (-1, 1))[int(rng.integers(3))] if factor in SIDED else (-1, 1)
        some = np.abs(drawn[np.isin(np.sign(drawn), self.sides)])
        levels = np.unique(some)
        if len(levels) < 3:  # kinds rather than amounts
            self.bar = float(rng.choice(levels))
        else:
            self.bar = float(np.quantile(some, rng.uniform(0, 1 - NARROWEST)))
        self.most = float(some.max())

    def holds(self, one: Values) -> bool:
        """Does this rollout meet it?"""
        value = one.get(self.factor, 0.0)
        return np.sign(value) in self.sides and abs(value) >= self.bar

    @property
    def middles(self) -> list[float]:
        """The middle of the range on each of its sides."""
        return [side * (self.bar + self.most) / 2 for side in self.sides]


def reached(edits: Sequence[Mapping[str, Any]], plant: Plant) -> bool:
    """Do these edits draw from the middle of the planted range, on one of its sides at least?"""
    flat = [part for edit in edits for part in edit.get("one_of", [edit])]
    ops = {edit["op"]: edit for edit in flat}
    return bool(REACHES[plant.factor](ops, plant))


def _turned(ops: Mapping[str, Any], plant: Plant) -> bool:
    return ops["camera_pose"]["turn"] >= np.deg2rad(plant.middles[-1])


def _scaled(ops: Mapping[str, Any], plant: Plant) -> bool:
    low, high = ops["object_size"].get("range", (0.75, 1.25))
    return any(low <= np.exp(one) <= high for one in plant.middles)


def _lit(ops: Mapping[str, Any], plant: Plant) -> bool:
    low, high = ops["light_color"].get("range", ((0, 0, 0), (0.5, 0.5, 0.5)))
    asked = [0.5 * np.exp(one) for one in plant.middles]
    return any(max(low) <= one <= min(high) for one in asked)


def _added(ops: Mapping[str, Any], plant: Plant) -> bool:
    return "distractors" in ops and (plant.bar < 2 or ops["distractors"].get("like") == "color")


REACHES: Mapping[str, Callable[[Mapping[str, Any], Plant], bool]] = {
    "object color": lambda ops, _: "recolor" in ops,
    "object texture": lambda ops, _: "retexture" in ops,
    "object size": _scaled,
    "lighting": _lit,
    "table": lambda ops, _: bool({"table_color", "table_texture"} & ops.keys()),
    "background": lambda ops, _: "background_texture" in ops,
    "distractor": _added,
    "camera": _turned,
}


class Bench:
    """All rollouts measured once; outcomes are each case's own."""

    def __init__(self, seen: Pool, usual: reference.Reference, masks: bool) -> None:
        self.seen, self.usual = seen, usual
        rollouts = tuple(
            Rollout(
                str(n), True, "",
                {CAMERA: {0: CameraShot(
                    lambda n=n: seen.rgb[n], (lambda n=n: seen.ids[n]) if masks else None)}},
                seen.roles[n] if masks else {},
            )
            for n in range(len(seen.rgb))
        )  # fmt: skip
        self.table = measure.table(Evaluation(rollouts), usual)

    def case(self, factor: str, number: int) -> dict[str, Any]:
        """One planted cause, and what came of it."""
        rng = np.random.default_rng([21, list(FACTORS).index(factor), number])
        plant = Plant(self.seen.values, factor, rng)
        rows = rng.choice(len(self.seen.rgb), ROLLOUTS, replace=False)
        weak = np.array([plant.holds(self.seen.values[row]) for row in rows])
        failed = rng.random(ROLLOUTS) < np.where(weak, WITHIN, BESIDE)
        judged = rules.judged(self.table.taken(rows, failed), number)
        kept = [one for one in judged.causes if one.confidence > KEPT]
        mine = [one for one in kept if one.factor == factor]
        return {
            "first": judged.measured[0].factor,
            "kept": bool(mine),
            "others kept": len(kept) - len(mine),
            "reached": bool(mine) and factor != NO_EDIT and self._reached(mine[0], plant),
        }

    def _reached(self, cause: Cause, plant: Plant) -> bool:
        edits = remedies.mended(cause, self.usual).edits
        return bool(edits) and reached(edits, plant)

    def by_chance(self, number: int) -> bool:
        """Whether a cause is kept where failures have none."""
        rng = np.random.default_rng([22, number])
        rows = rng.choice(len(self.seen.rgb), ROLLOUTS, replace=False)
        judged = rules.judged(self.table.taken(rows, rng.random(ROLLOUTS) < CHANCE), number)
        return any(one.confidence > KEPT for one in judged.causes)


def figures(bench: Bench, cases: int) -> dict[str, Any]:
    """Shares over all cases, by factor and all together."""
    found = {name: [bench.case(name, n) for n in range(cases)] for name in FACTORS}
    every = [one for some in found.values() for one in some]
    editable = [one for name, some in found.items() if name != NO_EDIT for one in some]
    return {
        "by factor": {
            name: {
                "first": np.mean([one["first"] == name for one in some]),
                "kept": np.mean([one["kept"] for one in some]),
                "reached": np.mean([one["reached"] for one in some]),
                "instead": Counter(one["first"] for one in some if one["first"] != name),
            }
            for name, some in found.items()
        },
        "first": np.mean([one["first"] == name for name, some in found.items() for one in some]),
        "kept": np.mean([one["kept"] for one in every]),
        "reached": np.mean([one["reached"] for one in editable]),
        "others kept": np.mean([one["others kept"] > 0 for one in every]),
        "by chance": np.mean([bench.by_chance(n) for n in range(2 * cases)]),
        "cases": cases,
        "notes": bench.table.notes,
    }


def table(both: Mapping[str, Any], given: argparse.Namespace) -> pages.Table:
    """The figures as the page has them, in %."""
    percent = lambda share: f"{100 * share:.0f}"  # noqa: E731
    rows: list[list[pages.Cell]] = [
        [
            name,
            *(percent(both[kind]["by factor"][name]["first"]) for kind in both),
            *(
                "" if name == NO_EDIT else percent(both[kind]["by factor"][name]["reached"])
                for kind in both
            ),
        ]
        for name in FACTORS
    ]
    goals = (("pictures", 93), ("masks", 97))
    rows.append([
        "all",
        *(_cell(both[kind]["first"], f">= {goal}") for kind, goal in goals),
        *(_cell(both[kind]["reached"], ">= 90") for kind in both),
    ])  # fmt: skip
    rows.append(
        [
            "failures by chance, a cause named",
            *(_cell(both[k]["by chance"], "<= 5") for k in both),
            "",
            "",
        ]
    )
    rows.append(
        ["another cause named beside it", *(percent(both[k]["others kept"]) for k in both), "", ""]
    )
    return pages.Table(
        id=given.record,
        title=given.title,
        command=f"python -m tools.bench.foreign.diagnosed --data {given.data.name}",
        columns=["planted in", "first, pictures", "first, masks", "reached, pictures", "reached, masks"],
        rows=rows,
        seeds=f"{given.cases} cases a factor, {ROLLOUTS} of {given.pool} rollouts each",
        **pages.stamp(),
    )  # fmt: skip


def _cell(share: float, target: str) -> dict[str, str | float]:
    return {"value": f"{100 * share:.1f}", "target": target}


def main() -> None:
    """Render, measure and print one JSON value."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name in ("data", "recorded", "layouts", "python", "out"):
        parser.add_argument(f"--{name}", type=Path, required=True)
    parser.add_argument("--pool", type=int, default=160)
    parser.add_argument("--cases", type=int, default=50, help="for each factor")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--record", metavar="ID", help="the page's table that this becomes")
    parser.add_argument("--title", default="", help="of that table")
    given = parser.parse_args()
    seen = pool(given.layouts, given.recorded, given.python, given.pool, given.seed, given.out)
    usual = reference.learn(given.data)
    both = {
        name: figures(Bench(seen, usual, name == "masks"), given.cases)
        for name in ("pictures", "masks")
    }
    print(json.dumps(both, indent=1, default=float))
    if given.record:
        pages.record(PAGE, table(both, given))


if __name__ == "__main__":
    main()
