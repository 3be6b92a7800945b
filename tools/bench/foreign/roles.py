"""rpaug's roles against the true ones, by role, on the worked-with half, on the held one, and on RLBench's episodes.

    python -m tools.bench.foreign.roles --data data --rlbench rlbench --out roles.json [--held]

What was scored is kept in OUT as it is found, and not scored again. `--held` opens the tasks that were set aside.
"""

import argparse
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rpaug.core import registry
from rpaug.core.files import write_atomic
from rpaug.core.types import Episode, Scene
from rpaug.scene import build
from rpaug.scene.sampled_frames import look
from tools.bench.foreign import scoring
from tools.bench.foreign.convert import TRUTH
from tools.bench.harness import pages

ROLES = ("table", "manipulated", "robot", "receiver", "background")
TARGETS = {"table": 98, "manipulated": 98, "robot": 98, "receiver": 90}  # percent right, at least
BY_EYE = Path(__file__).with_name("rlbench_roles.json")
RLBENCH = "rlbench"


def cases(data: Path, half: str) -> Iterator[tuple[str, Path, str, Mapping[str, Any]]]:
    """Task, dataset, key and true roles of every episode of a half."""
    for task in sorted((data / half).iterdir()):
        for key, facts in json.loads((task / TRUTH).read_text()).items():
            yield task.name, task, key, facts["roles"]


def by_eye(roots: Sequence[Path]) -> Iterator[tuple[str, Path, str, Mapping[str, Any]]]:
    """The episodes of RLBench whose roles were told from their images: those of `roots` that the file names."""
    told = json.loads(BY_EYE.read_text())
    for root in roots:
        for key in registry.adapter(RLBENCH).episodes(root):
            if (name := Path(key).name) in told:
                yield "open_drawer", root, key, told[name]


def score(scene: Scene, truth: Mapping[str, Any], weights: Mapping[int, int]) -> dict[str, Any]:
    """Grade, confidence and instance ids of each role. Without beliefs every role that is given counts as sure."""
    out = {}
    for role in ROLES:
        found = scene.roles.get(role, frozenset())
        belief = scene.beliefs.get(role)
        out[role] = {
            "grade": scoring.grade(truth[role], found, weights),
            "confidence": belief.confidence if belief else float(bool(found)),
            "exists": any(weights.get(one) for one in truth[role]["must"]),
            "found": sorted(found),
        }
    return out


def pixels(episode: Episode) -> Counter[int]:
    """How many sampled pixels each instance id has."""
    ids, counts = np.unique(look(episode).ids, return_counts=True)
    return Counter(
        {int(one): int(count) for one, count in zip(ids, counts, strict=True) if one > 0}
    )


def rows(kept: Mapping[str, Mapping[str, Any]], worlds: Sequence[str]) -> list[list[pages.Cell]]:
    """A row for each half and role: how often it was right where it exists, absent, wrong, sure though wrong."""
    out = []
    for half in worlds:
        for role in ROLES:
            tasks: dict[str, list[Mapping[str, Any]]] = {}
            for place, found in kept.items():
                where, task, _ = place.split("|")
                if where == half:
                    tasks.setdefault(task, []).append(found[role])
            there = [[one for one in task if one["exists"]] for task in tasks.values()]
            some = [one for task in tasks.values() for one in task]
            if not some:
                continue
            right = scoring.share([[one["grade"] == scoring.RIGHT for one in t] for t in there])
            counts = Counter(one["grade"] for one in some)
            bad = [one["grade"] in (scoring.WRONG, scoring.INVENTED) for one in some]
            sure = [
                b and one["confidence"] >= scoring.SURE for b, one in zip(bad, some, strict=True)
            ]
            figure: pages.Cell = right.percent
            if role in TARGETS:
                figure = {"value": right.percent, "target": f">= {TARGETS[role]}"}
            out.append(
                [
                    f"{half}: {role}", sum(map(len, there)), figure, f"{right.low} to {right.high}",
                    counts[scoring.ABSENT], counts[scoring.WRONG], counts[scoring.INVENTED],
                    {"value": round(100 * float(np.mean(sure)), 1), "target": "<= 0.5"},
                ]
            )  # fmt: skip
    return out


COLUMNS = (
    "role", "episodes that have it", "right, %", "95 % interval", "absent", "wrong", "invented", "sure and wrong, %",
)  # fmt: skip


def main() -> None:
    """Score what is not scored yet, and print or record the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, help="folder of worked/ and held/")
    parser.add_argument("--rlbench", type=Path, action="append", default=[], help="open_drawer")
    parser.add_argument("--held", action="store_true", help="the set-aside tasks instead")
    parser.add_argument("--out", type=Path, required=True, help="what was scored, kept")
    parser.add_argument("--record", action="store_true", help="write docs/benchmarks' results")
    given = parser.parse_args()
    kept = json.loads(given.out.read_text()) if given.out.exists() else {}
    half = "held" if given.held else "worked"
    work = [(half, case) for case in cases(given.data, half)] if given.data else []
    work += [(RLBENCH, case) for case in by_eye(given.rlbench)]
    for where, (task, root, key, truth) in work:
        place = f"{where}|{task}|{root.name}/{key}"
        if place in kept:
            continue
        episode = registry.read(root, key)
        scene = build.build(episode, with_bodies=True)
        kept[place] = score(scene, truth, pixels(episode))
        write_atomic(given.out, json.dumps(kept, indent=1).encode())
        bad = {
            role: (one["grade"], round(one["confidence"], 2), one["found"], truth[role])
            for role, one in kept[place].items()
            if one["grade"] != scoring.RIGHT
        }
        print(place, bad or "all right", flush=True)
    worlds = list(dict.fromkeys(where for where, _ in work))
    table = rows(kept, worlds)
    for row in table:
        print("  ".join(pages.shown(cell) for cell in row))
    if given.record:
        for where in worlds:
            mine = [row for row in table if str(row[0]).startswith(f"{where}:")]
            seeds = f"{sum(place.startswith(where) for place in kept)} episodes"
            pages.record(
                "foreign",
                pages.Table(
                    id=f"roles-{where}", title=f"Roles, {where}", columns=COLUMNS, rows=mine, seeds=seeds,
                    command=f"python -m tools.bench.foreign.roles --data DATA{' --held' * given.held}", **pages.stamp(),
                ),
            )  # fmt: skip


if __name__ == "__main__":
    main()
