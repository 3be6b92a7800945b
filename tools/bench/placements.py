"""How many of 1000 random placements intersect the swept robot, float or sink, by the twin's true shapes.

python tools/bench/placements.py --seeds 6 --json placements.json
"""

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
from objects import extra

from rpaug import twin
from rpaug.assets import library
from rpaug.core import geometry
from rpaug.operators import insert as inserting
from rpaug.scene import build
from rpaug.scene.placement import placing
from rpaug.twin import mjcf, tabletop, tasks

PLACED = 1000


def placements(seeds: int, frames: int) -> Iterator[dict]:
    """PLACED random placements over `seeds` episodes: the nearest the robot's true shapes ever come, and the foot."""
    for seed in range(seeds):
        task = tuple(twin.TASKS)[seed % len(twin.TASKS)]
        take = twin.perform(task, seed, frames=frames)
        scene = build.build(take.episode, with_bodies=True)
        around, choices = placing.find_free_space(scene), library.find(size=(0.04, 0.25))
        rng = np.random.default_rng(seed)
        model, data, robot = _world(task, seed, take, choices)
        hits, off, nearest, start = 0, [], np.inf, time.process_time()
        count = -(-PLACED // seeds)
        for _ in range(count):
            (thing,), _ = inserting.draw(scene, around, choices, 1, 1.0, rng)
            pose = np.array(thing["pose"])
            points = geometry.transform(pose, library.mesh(thing["asset"]).points)
            off.append(points[:, 2].min() - tabletop.TABLE)
            gap = _gap(model, data, robot, take, thing["asset"], pose)
            nearest, hits = min(nearest, gap), hits + (gap <= 0)
        worst = 1000 * max(np.abs(off))
        yield {
            "seed": seed,
            "task": task,
            "count": count,
            "hits": hits,
            "nearest_mm": round(1000 * nearest, 1),
            "float_or_sink_mm": round(worst, 3),
            "over_2mm": int((np.abs(off) > 0.002).sum()),
            "seconds": round(time.process_time() - start, 1),
        }


def _world(
    task: str, seed: int, take: twin.Take, choices: tuple
) -> tuple[mujoco.MjModel, mujoco.MjData, list[int]]:
    """The twin's world with one of each asset, and the robot's shapes."""
    layout, instance_ids, _, _ = (np.random.default_rng([seed, 0, k]) for k in range(4))
    job = tasks.TASKS[task](layout)
    world = tabletop.build(job.placing, instance_ids, 0)
    extras = tuple(extra({"asset": a.name, "handle": 1, "pose": np.eye(4)}) for a in choices)
    extras = tuple(replace(extra, name=a.name) for extra, a in zip(extras, choices, strict=True))
    model = mjcf.compile_model(world, twin.Look(extras=extras), 16)
    moving = ("link", "hand", "finger", job.manipulated)
    robot = [g for g in range(model.ngeom) if model.geom(g).name.startswith(moving)]
    return model, mujoco.MjData(model), robot


def _gap(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    robot: list[int],
    take: twin.Take,
    asset: str,
    pose: np.ndarray,
) -> float:
    """Metres between the placed thing's convex hull and the robot or what it moves, the least over all frames."""
    body, geom = model.body(f"extra-{asset}").id, model.geom(f"extra-{asset}/0").id
    model.body_pos[body] = pose[:3, 3]
    mujoco.mju_mat2Quat(model.body_quat[body], pose[:3, :3].ravel())
    robot_states = take.episode.robot
    opening = robot_states.extra["gripper_joint_positions"]
    least = np.inf
    for t in range(take.episode.length):
        data.qpos[:] = (*robot_states.joint_positions[t], *opening[t])
        for name, track in take.poses.items():
            slot = model.body(name).mocapid[0]
            data.mocap_pos[slot] = track[t, :3, 3]
            mujoco.mju_mat2Quat(data.mocap_quat[slot], track[t, :3, :3].ravel())
        mujoco.mj_kinematics(model, data)
        for other in robot:
            if np.linalg.norm(data.geom_xpos[other] - data.geom_xpos[geom]) < 0.5:
                least = min(least, mujoco.mj_geomDistance(model, data, other, geom, 0.3, None))
    return float(least)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--frames", type=int, default=17)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    rows = []
    for row in placements(given.seeds, given.frames):
        rows.append(row)
        print("  ".join(f"{value}" for value in row.values()), flush=True)
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
