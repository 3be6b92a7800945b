"""Where `distractors` puts things in foreign scenes: near, on the table, inside the workspace, touching or hiding.

    python -m tools.bench.foreign.distractors --data data --out distractors.json [--held]

A few draws a task in its first episode, judged by its recorded depth and masks and by the true roles. Nothing is
rendered: a thing is the points of its mesh where the edit puts it.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from rpaug.assets import library
from rpaug.core import geometry, registry
from rpaug.core.errors import RpaugError
from rpaug.core.files import write_atomic
from rpaug.core.types import Scene
from rpaug.operators.distractors import Distractors
from rpaug.scene import build
from rpaug.scene.sampled_frames import SampledFrames, look
from tools.bench.foreign import scoring
from tools.bench.foreign.convert import TRUTH
from tools.bench.harness import pages

DRAWS = 20  # of two things each, a task
NEAR = 0.15  # metres from the target or the low path
LOW = 0.2  # metres above the table in which the gripper's path is low
REACH = (
    0.2  # metres beyond the gripper's path that belong to the workspace, as the operator promises
)
TOUCH = 0.003  # metres
LEVEL = 0.015  # metres off the table's top that are on it
HIDDEN = 0.25  # share of the target's pixels in one camera's frame that count as hiding it
DENSE = 600  # points of a mesh


def judge(scene: Scene, truth: dict[str, Any], draws: int) -> list[dict[str, Any]]:
    """Each drawn thing: whether it is near, on the table, inside, touches, hides."""
    sampled, episode = look(scene.episode), scene.episode
    target, table, robot = (truth[role]["must"] for role in ("manipulated", "table", "robot"))
    gripper = episode.robot.gripper_to_world
    assert gripper is not None
    path = gripper[:, :3, 3]
    overhead = sampled.cameras.index("overhead")
    flat = np.isin(sampled.ids[0, overhead], table)
    top = float(np.median(sampled.points[0, overhead][flat][:, 2]))
    goal = _points(sampled, target)
    near = np.concatenate([goal[:, :2], path[path[:, 2] < top + LOW][:, :2]])
    moving = _points(sampled, [*robot, *target])
    low, high = path[:, :2].min(0) - REACH, path[:, :2].max(0) + REACH
    out = []
    for number in range(draws):
        edit = Distractors().sample(scene, np.random.default_rng(number))
        short = bool(edit["elsewhere"])
        for thing in edit["things"]:
            pose, mesh = np.array(thing["pose"]), library.mesh(thing["asset"])
            solid = geometry.transform(
                pose, _surface(mesh.points, mesh.faces) * thing.get("scale", 1.0)
            )
            middle = solid.mean(0)
            out.append(
                {
                    "asset": thing["asset"],
                    "short": short,
                    "near": bool(np.linalg.norm(near - middle[:2], axis=1).min() <= NEAR),
                    "on_table": bool(abs(solid[:, 2].min() - top) < LEVEL),
                    "inside": bool((middle[:2] >= low).all() and (middle[:2] <= high).all()),
                    "touches": _touches(solid, moving),
                    "hides": bool(_hidden(sampled, solid, target) > HIDDEN),
                    "seen": _seen(sampled, solid) > 0,
                }
            )
    return out


def _points(sampled: SampledFrames, ids: list[int]) -> np.ndarray:
    shown = np.isin(sampled.ids, ids) & (sampled.depth > 0)
    return sampled.points[shown].reshape(-1, 3)


def _touches(solid: np.ndarray, moving: np.ndarray) -> bool:
    """Whether anything that moves ever comes as near as TOUCH."""
    around = ((moving > solid.min(0) - TOUCH) & (moving < solid.max(0) + TOUCH)).all(1)
    return any(np.linalg.norm(solid - point, axis=1).min() < TOUCH for point in moving[around])


def _surface(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Points spread over triangles by their area."""
    rng = np.random.default_rng(0)
    a, b, c = (points[faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = rng.choice(len(faces), DENSE, p=area / area.sum())
    u, v = np.sort(rng.random((2, DENSE, 1)), 0)
    return a[chosen] * u + b[chosen] * (v - u) + c[chosen] * (1 - v)


def _landed(sampled: SampledFrames, solid: np.ndarray, s: int, c: int) -> tuple[np.ndarray, ...]:
    """Rows, columns and depths of a thing's points inside a camera's image."""
    height, width = sampled.depth.shape[2:]
    local = geometry.transform(np.linalg.inv(sampled.cam_to_world[s, c]), solid)
    local = local[local[:, 2] > 0.02]
    column, row = (
        np.rint(local[:, :2] / local[:, 2:] * np.diag(sampled.K[c])[:2] + sampled.K[c, :2, 2])
        .astype(int)
        .T
    )
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    return row[inside], column[inside], local[inside, 2]


def _hidden(sampled: SampledFrames, solid: np.ndarray, target: list[int]) -> float:
    """The largest share of the target's pixels that the thing hides in a fixed camera's frame."""
    worst = 0.0
    for s in range(len(sampled.frames)):
        for c in np.flatnonzero(sampled.fixed):
            shown = np.isin(sampled.ids[s, c], target)
            if shown.sum() < 12:
                continue
            row, column, depth = _landed(sampled, solid, s, c)
            before = shown[row, column] & (depth < sampled.depth[s, c][row, column] - 0.005)
            pixels = len({*zip(row[before].tolist(), column[before].tolist(), strict=True)})
            worst = max(worst, pixels / shown.sum())
    return worst


def _seen(sampled: SampledFrames, solid: np.ndarray) -> int:
    """How many fixed cameras show more than a few pixels of it in the first frame."""
    count = 0
    for c in np.flatnonzero(sampled.fixed):
        row, column, depth = _landed(sampled, solid, 0, c)
        count += int((depth < sampled.depth[0, c][row, column] + 0.005).sum() > 10)
    return count


def main() -> None:
    """Judge what was not judged yet, and print or record the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True, help="folder of worked/ and held/")
    parser.add_argument("--held", action="store_true", help="the set-aside tasks instead")
    parser.add_argument("--task", action="append", help="only these, as <world>.<task>")
    parser.add_argument("--draws", type=int, default=DRAWS)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--record", action="store_true", help="write docs/benchmarks' results")
    given = parser.parse_args()
    half = "held" if given.held else "worked"
    kept = json.loads(given.out.read_text()) if given.out.exists() else {}
    for root in sorted((given.data / half).iterdir()):
        place = f"{half}|{root.name}"
        if place in kept or (given.task and root.name not in given.task):
            continue
        (key, facts), *_ = json.loads((root / TRUTH).read_text()).items()
        try:
            scene = build.build(registry.read(root, key), with_bodies=True)
            kept[place] = judge(scene, facts["roles"], given.draws)
        except RpaugError as error:
            kept[place] = []
            print(place, "refused:", error, flush=True)
        write_atomic(given.out, json.dumps(kept, indent=1).encode())
        counted = {name: sum(one[name] for one in kept[place]) for name in WANTED}
        print(place, len(kept[place]), counted, flush=True)
    table = rows(kept, half)
    for row in table:
        print("  ".join(pages.shown(cell) for cell in row))
    if given.record:
        count = sum(len(things) for place, things in kept.items() if place.startswith(half))
        pages.record(
            "foreign_placing",
            pages.Table(
                id=half, title=f"Where distractors stand, {half}",
                columns=("figure", "share, %", "95 % interval"), rows=table, seeds=f"{count} things",
                command=f"python -m tools.bench.foreign.distractors --data DATA{' --held' * given.held}",
                **pages.stamp(),
            ),
        )  # fmt: skip


ASKED, POINTS = 33.3, 5.0  # % near of the operator's default, and how far off it may be
WANTED = {
    "near": "", "on_table": ">= 100", "inside": ">= 90", "touches": "<= 0", "hides": "<= 0", "seen": ">= 100",
}  # fmt: skip
SAID = {
    "near": "within 15 cm of target or low path", "on_table": "on the table", "inside": "inside the gripper's reach",
    "touches": "touch what moves", "hides": "hide a quarter of the target in a frame",
    "seen": "seen by a fixed camera",
}  # fmt: skip


def rows(kept: dict[str, list[dict[str, Any]]], half: str) -> list[list[pages.Cell]]:
    """The share of things with each property, pooled over tasks; near apart where a draw found no room as asked."""
    tasks = [things for place, things in kept.items() if place.startswith(f"{half}|") and things]
    roomy = [things for things in tasks if not any(thing["short"] for thing in things)]
    out: list[list[pages.Cell]] = []
    cramped = [things for things in tasks if things not in roomy]
    if cramped:
        found = scoring.share([[bool(thing["near"]) for thing in things] for things in cramped])
        said = f"{half}: {SAID['near']}, {len(cramped)} tasks without room as asked"
        out.append([said, found.percent, f"{found.low} to {found.high}"])
    for name, target in WANTED.items():
        counted = roomy if name == "near" else tasks
        found = scoring.share([[bool(thing[name]) for thing in things] for things in counted])
        if name == "near":
            above = found.percent > ASKED
            target = f"<= {ASKED + POINTS:.1f}" if above else f">= {ASKED - POINTS:.1f}"
        figure: pages.Cell = {"value": found.percent, "target": target}
        where = f", {len(roomy)} tasks" if name == "near" else ""
        out.append([f"{half}: {SAID[name]}{where}", figure, f"{found.low} to {found.high}"])
    return out


if __name__ == "__main__":
    main()
