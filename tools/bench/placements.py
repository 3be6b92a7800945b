"""Where 1000 distractors come to stand: near what was asked for, touching and hiding nothing, on the table, in reach.

python -m tools.bench.placements --seeds 8 --json placements.json
python -m tools.bench.placements --data FOLDER [FOLDER ...] --json placements.json

On the twin its true shapes say how near the robot and all else come to a thing at every frame, on datasets the recorded
points of all frames and cameras. The share near is told by middles, seen from above: to the gripper's tip where it goes
low, and to the target's points as recorded at any time. `truth.json` in a folder above, if any, names the true roles.
"""

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Bool, Float

import rpaug
from rpaug import twin
from rpaug.assets import library
from rpaug.core import geometry, registry, sampling
from rpaug.core.errors import RpaugError
from rpaug.core.types import Body, Scene
from rpaug.operators import insert as inserting
from rpaug.operators.distractors import Distractors
from rpaug.render import mesh as meshes
from rpaug.scene import build
from rpaug.scene.placement import placing, policy_views, zones
from rpaug.scene.sampled_frames import look
from rpaug.twin import mjcf, tabletop, tasks
from tools.bench.harness import pages
from tools.bench.objects import extra

PLACED = 1000
WITHIN = 0.15  # metres
ABOVE = 0.004  # metres over the table: lower points are its own
TALL = 0.4  # metres over the table: nothing that is put there is taller
GRAIN = 0.003  # metres: recorded points nearer than this count once
LOOKED = 24  # frames in which is looked for what a thing hides


@dataclass
class World:
    """One scene and its true roles; `gap` is the least distance from a thing to all else, of the twin."""

    name: str
    scene: Scene
    roles: dict[str, frozenset[int]]
    gap: object = None


def twins(seeds: int, frames: int) -> Iterator[World]:
    """The twin's tasks, in turn."""
    choices = library.find(size=(0.04, 0.16))
    for seed in range(seeds):
        task = tuple(twin.TASKS)[seed % len(twin.TASKS)]
        take = twin.perform(task, seed, frames=frames)
        scene = build.build(take.episode, with_bodies=True)
        model, data, others = _mujoco(task, seed, choices)

        def gap(thing: dict, model=model, data=data, others=others, take=take) -> float:
            return _gap(model, data, others, take, thing["asset"], np.array(thing["pose"]))

        roles = {
            "table": frozenset([take.truth.handles["table"]]),
            "manipulated": frozenset([take.truth.handles[take.truth.manipulated]]),
        }
        yield World(f"twin {task}", scene, roles, gap)


def recorded(root: Path, told: bool) -> Iterator[World]:
    """The episodes of a dataset; `told`: their scenes are given the true roles."""
    given = next(
        (f / "truth.json" for f in (root, *root.parents) if (f / "truth.json").exists()), None
    )
    truth = json.loads(given.read_text()) if given else {}
    for key in registry.adapter_for(root).episodes(root):
        scene = build.build(rpaug.read(root, key), with_bodies=True)
        roles = dict(scene.roles)
        if key in truth:
            found = truth[key]["roles"]
            roles = {role: frozenset(ids["must"]) for role, ids in found.items() if ids["must"]}
            scene = replace(scene, roles=roles) if told else scene
        yield World(f"{root.name} {Path(key).name}", scene, roles)


def placements(world: World, count: int) -> dict:
    """Things that distractors' defaults put into one scene, and what is wrong with them."""
    scene, operator = world.scene, Distractors(harmonise=False)
    rng = np.random.default_rng(0)
    things, elsewhere = [], 0
    start = time.process_time()
    try:
        placing.find_free_space(scene)
        found = time.process_time() - start
        while len(things) < count:
            edit = operator.sample(scene, rng)
            things += edit["things"]
            elsewhere += sum(edit["elsewhere"].values())
    except RpaugError as error:
        return {"world": world.name, "count": 0, "refused": str(error)}
    seconds = (time.process_time() - start - found) / len(things)
    bodies = [_body(thing, scene.episode.length) for thing in things]
    points = [geometry.transform(body.to_world[0], body.mesh.points) for body in bodies]
    middles = np.array([(p[:, :2].min(0) + p[:, :2].max(0)) / 2 for p in points])
    level, table, others = _around(world)
    target = world.roles.get("manipulated") or world.roles.get("receiver") or frozenset()
    close = _close(scene, target, level, middles)
    gaps = [
        world.gap(thing) if world.gap else _free(others, p)
        for thing, p in zip(things, points, strict=True)
    ]
    sights = [_sights(scene, target, body) for body in bodies]
    box = zones.workspace(scene)
    inside = (
        np.ones(len(middles), bool)
        if box is None
        else ((middles >= box[0]) & (middles <= box[1])).all(1)
    )
    resting = [_rests(table, level, p) for p in points]
    return {
        "world": world.name,
        "count": len(things),
        "asked_percent": round(100 * sum(operator.near.values()), 1),
        "near_percent": round(100 * close.mean(), 1),
        "elsewhere": elsewhere,
        "touch": int((np.array(gaps) <= 0).sum()),
        "nearest_mm": round(1000 * min(gaps), 1),
        "hide": int(sum(hides > operator.hides for hides, _ in sights)),
        "unseen": int(sum(not seen for _, seen in sights)),
        "off_table": len(resting) - sum(resting),
        "inside_percent": round(100 * inside.mean(), 1),
        "room_s": round(found, 2),
        "thing_s": round(seconds, 3),
    }


def _body(thing: dict, length: int) -> Body:
    return inserting.inserted_body(thing, None, length)


def _around(world: World) -> tuple[float, np.ndarray, np.ndarray]:
    """The true table's level and points, and points of all else low above it, over all frames of all cameras."""
    scene = world.scene
    table = world.roles.get("table", frozenset())
    on, else_ = [], []
    for view in scene.episode.views.values():
        for t in range(scene.episode.length):
            ids, depth = view.ids(t), view.depth(t)
            world_points = geometry.world_points(np.nan_to_num(depth, posinf=0), view.camera, t)
            own = np.isin(ids, list(table))
            known = (depth > 0) & np.isfinite(depth)
            if view.camera.fixed and t % 8 == 0:
                on.append(world_points[own & known])
            else_.append(world_points[known & ~own])
    on = np.concatenate(on)
    level = float(np.median(on[:, 2]))
    thinned = []
    for part in else_:
        low = part[(part[:, 2] > level + ABOVE) & (part[:, 2] < level + TALL)]
        thinned.append(np.unique(np.rint(low / GRAIN).astype(np.int32), axis=0))
    return level, on, GRAIN * np.unique(np.concatenate(thinned), axis=0)


def _close(
    scene: Scene, target: frozenset[int], level: float, middles: np.ndarray
) -> Bool[np.ndarray, "n"]:
    sampled = look(scene.episode)
    shown = np.isin(sampled.ids, list(target)) & (sampled.depth > 0)
    near = np.concatenate([zones.low_path(scene, level), sampled.points[shown]])[:, :2]
    if not len(near):
        return np.zeros(len(middles), bool)
    return np.array([np.linalg.norm(near - one, axis=1).min() <= WITHIN for one in middles])


def _free(others: Float[np.ndarray, "n 3"], points: Float[np.ndarray, "m 3"]) -> float:
    """Metres from a thing's upright prism to the nearest recorded point that is not the table's."""
    outline = placing.hull(points)
    over = others[others[:, 2] < points[:, 2].max()]
    near = over[(np.abs(over[:, :2] - outline.mean(0)) < 0.4).all(1), :2]
    if not len(near):
        return 0.4
    edges = np.roll(outline, -1, axis=0) - outline
    normals = np.stack([edges[:, 1], -edges[:, 0]], 1) / np.linalg.norm(edges, axis=1)[
        :, None
    ].clip(1e-9)
    offsets = (outline * normals).sum(1)
    if (outline.mean(0) @ normals.T - offsets).mean() > 0:
        normals, offsets = -normals, -offsets
    return float((near @ normals.T - offsets).max(1).min())


def _rests(table: np.ndarray, level: float, points: np.ndarray) -> bool:
    """Whether the true table was seen within 2 cm beneath its foot."""
    foot = points[points[:, 2] < points[:, 2].min() + 0.01, :2].mean(0)
    beneath = np.linalg.norm(table[:, :2] - foot, axis=1) < 0.03
    return bool(abs(points[:, 2].min() - level) < 0.01 and beneath.any())


def _sights(scene: Scene, target: frozenset[int], body: Body) -> tuple[float, bool]:
    """The largest share over cameras of frames in which it hides part of the target, and whether a camera shows it."""
    worst, seen = 0.0, False
    for view in scene.episode.views.values():
        hidden, shown, fixed = 0, 0, None
        for t in sampling.frames(scene.episode.length, LOOKED):
            camera, depth, ids = view.camera, view.depth(t), view.ids(t)
            if fixed is None or not camera.fixed:
                size = camera.width, camera.height
                fixed = meshes.draw(
                    body.mesh, body.to_world[0], camera.K, camera.cam_to_world[t], size
                )
            front = fixed.hit & ((depth <= 0) | (fixed.depth < depth))
            seen |= bool(front.sum() >= 4)
            own = np.isin(ids, list(target))
            shown += own.any()
            hidden += (front & own).sum() > policy_views.COVERED * own.sum() > 0
        worst = max(worst, hidden / shown if shown else 0.0)
    return worst, seen


def _mujoco(
    task: str, seed: int, choices: tuple
) -> tuple[mujoco.MjModel, mujoco.MjData, list[int]]:
    """The twin's world with one of each asset, and all shapes that a thing on the table must not touch."""
    layout, instance_ids, _, _ = (np.random.default_rng([seed, 0, k]) for k in range(4))
    job = tasks.TASKS[task](layout)
    world = tabletop.build(job.placing, instance_ids, 0)
    extras = tuple(extra({"asset": a.name, "handle": 1, "pose": np.eye(4)}) for a in choices)
    extras = tuple(replace(extra, name=a.name) for extra, a in zip(extras, choices, strict=True))
    model = mjcf.compile_model(world, twin.Look(extras=extras), 16)
    apart = ("table", "floor", "wall", "extra")
    return (
        model,
        mujoco.MjData(model),
        [g for g in range(model.ngeom) if not model.geom(g).name.startswith(apart)],
    )


def _gap(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    others: list[int],
    take: twin.Take,
    asset: str,
    pose: np.ndarray,
) -> float:
    """Metres between the placed thing's convex hull and all others, the least over all frames."""
    body, geom = model.body(f"extra-{asset}").id, model.geom(f"extra-{asset}/0").id
    model.body_pos[body] = pose[:3, 3]
    mujoco.mju_mat2Quat(model.body_quat[body], pose[:3, :3].ravel())
    robot_states = take.episode.robot
    opening = robot_states.extra["gripper_joint_positions"]
    least = 0.4
    for t in range(take.episode.length):
        data.qpos[:] = (*robot_states.joint_positions[t], *opening[t])
        for name, track in take.poses.items():
            slot = model.body(name).mocapid[0]
            data.mocap_pos[slot] = track[t, :3, 3]
            mujoco.mju_mat2Quat(data.mocap_quat[slot], track[t, :3, :3].ravel())
        mujoco.mj_kinematics(model, data)
        for other in others:
            if np.linalg.norm(data.geom_xpos[other] - data.geom_xpos[geom]) < 0.5:
                least = min(least, mujoco.mj_geomDistance(model, data, other, geom, 0.4, None))
    return float(least)


def _table(rows: list[dict], given: argparse.Namespace) -> pages.Table:
    """One row for each kind of world: the figures that are asked for, over all its scenes."""
    kinds: dict[str, list[dict]] = {}
    for row in rows:
        kinds.setdefault(row["world"].split()[0].split(".")[0], []).append(row)
    out = []
    for kind, every in kinds.items():
        some = [row for row in every if row["count"]]
        count = sum(row["count"] for row in some)
        if not count:
            continue

        def mean(key: str, some: list[dict] = some, count: int = count) -> float:
            return round(sum(row[key] * row["count"] for row in some) / count, 1)

        def total(key: str, some: list[dict] = some) -> pages.Cell:
            return {"value": sum(row[key] for row in some), "target": "<= 0"}

        off = round(abs(mean("near_percent") - mean("asked_percent")), 1)
        out.append(
            [
                kind,
                f"{len(some)} of {len(every)}",
                count,
                mean("near_percent"),
                {"value": off, "target": "<= 5"},
                sum(row["elsewhere"] for row in some),
                total("touch"),
                total("hide"),
                total("unseen"),
                total("off_table"),
                {"value": mean("inside_percent"), "target": ">= 90"},
                min(row["nearest_mm"] for row in some),
            ]
        )
    told = " --true-roles" if given.true_roles else ""
    return pages.Table(
        id="placed-data" if given.data else "placed",
        title="Distractors by default, a third of them asked to stand within 15 cm of target or low path",
        command=f"python -m tools.bench.placements{told} "
        + ("--data FOLDERS" if given.data else f"--seeds {given.seeds}"),
        seeds="two things a draw",
        columns=(
            "world",
            "scenes with room",
            "things",
            "near, %",
            "off what was asked, points",
            "elsewhere",
            "touch",
            "hide the target",
            "unseen",
            "off the table",
            "in the workspace, %",
            "nearest, mm",
        ),
        rows=out,
        **pages.stamp(),
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--frames", type=int, default=17)
    parser.add_argument(
        "--data", type=Path, nargs="+", default=[], help="recorded datasets, not the twin"
    )
    parser.add_argument(
        "--true-roles", action="store_true", help="scenes are given the true roles of truth.json"
    )
    parser.add_argument("--count", type=int, default=PLACED)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--record", action="store_true", help="keep the table in docs/benchmarks")
    given = parser.parse_args()
    worlds = (
        (world for root in given.data for world in recorded(root, given.true_roles))
        if given.data
        else twins(given.seeds, given.frames)
    )
    scenes = (
        sum(len(registry.adapter_for(root).episodes(root)) for root in given.data) or given.seeds
    )
    rows = []
    for world in worlds:
        rows.append(placements(world, -(-given.count // scenes)))
        print("  ".join(f"{key} {value}" for key, value in rows[-1].items()), flush=True)
    table = _table(rows, given)
    print(table.markdown())
    if given.record:
        pages.record("placing", table)
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
