"""Records scripted experts of foreign simulators into neutral folders; runs in their environment, without rpaug.

python -m tools.bench.foreign.record --world metaworld --episodes 2 --out recorded
"""

import argparse
import importlib
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np

from tools.bench.foreign import neutral, simulated
from tools.bench.foreign.worlds.task import World

FRAMES = 60  # of an episode, evenly spread
TRIES = 12  # seeds tried for each success that is wanted


def open_world(name: str) -> World:
    """A world by its name."""
    return importlib.import_module(f"tools.bench.foreign.worlds.{name}")  # type: ignore[return-value]


def record(
    name: str, task: str, seed: int, folder: Path, frames: int = FRAMES, size: int = simulated.SIZE
) -> bool:
    """Record one episode, if the expert succeeds. Several `frames` are spread evenly; a single one is the start."""
    world = open_world(name)
    run = world.rollout(task, seed)
    if not run.success:
        return False
    kept = np.unique(np.linspace(0, len(run.states) - 1, frames).round().astype(int))
    states = {key: np.stack([run.states[k][key] for k in kept]) for key in simulated.STATE}
    fresh = simulated.load(run.source, folder, world.hidden)
    things = simulated.shown(fresh, world.groups)
    ids = simulated.numbered(list(things), seed)
    edits = simulated.edits(run.model, fresh)
    model = simulated.apply(fresh, edits)
    studio = simulated.Studio(model, by_geom(model, things, ids), world.groups, size)
    reels = studio.film(states, world.cameras)
    studio.close()
    robot = {
        "gripper_to_world": np.stack([run.gripper[k] for k in kept]),
        "gripper_open": np.array([run.open[k] for k in kept]),
        "joint_positions": np.stack([run.joints[k] for k in kept]),
        "actions": np.stack([run.actions[k] for k in kept]),
    }
    facts = {
        "world": name, "task": task, "seed": seed, "instruction": world.tasks[task].instruction,
        "model": "model.xml" if run.source.lstrip().startswith("<") else run.source,
        "groups": world.groups, "steps": kept.tolist(), "studio": {"size": size},
        "ids": ids, "roles": roles(world, task, model, ids, states),
        "cameras": {key: vars(eye) for key, eye in world.cameras.items()},
    }  # fmt: skip
    neutral.save(folder, facts, {**reels, "robot": robot, "states": states, "model": edits})
    return True


def by_geom(
    model: mujoco.MjModel, things: Mapping[str, list[int]], ids: Mapping[str, int]
) -> np.ndarray:
    """The instance id of each geom, 0 for one that is not drawn."""
    out = np.zeros(model.ngeom, np.int32)
    for name, geoms in things.items():
        out[geoms] = ids[name]
    return out


def roles(
    world: World,
    task: str,
    model: mujoco.MjModel,
    ids: Mapping[str, int],
    states: Mapping[str, np.ndarray],
) -> dict[str, dict[str, list[int]]]:
    """True instance ids by role, `must` and `may`: by the names of bodies; what the robot pushes in `states` may be
    manipulated as well. Raises KeyError on an unknown name."""
    asked = world.tasks[task]
    arm = simulated.below(model, world.robot)
    robot = sorted(arm & ids.keys())
    table = asked.table or world.table
    must = {"manipulated": asked.moved, "receiver": asked.onto, "table": table, "robot": robot}
    things = simulated.shown(model, world.groups)
    must["background"] = [name for name in ids if model.geom_bodyid[things[name][0]] == 0]
    out = {}
    for role, names in must.items():
        extra = [*world.may.get(role, ()), *asked.may.get(role, ())]
        if role == "manipulated":
            extra += simulated.pushed(model, states, arm)
        out[role] = {
            "must": sorted({ids[name] for name in names}),
            "may": sorted({ids[name] for name in extra if name in ids and name not in names}),
        }
    return out


def main() -> None:
    """Record what is asked for; episodes that are there already are kept."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--world", required=True)
    parser.add_argument("--task", action="append", help="only these")
    parser.add_argument("--half", choices=neutral.HALVES, help="only this half of the tasks")
    parser.add_argument("--episodes", type=int, default=2)
    parser.add_argument("--frames", type=int, default=FRAMES, help="of an episode; 1: its start")
    parser.add_argument("--size", type=int, default=simulated.SIZE, help="pixels a side")
    parser.add_argument("--first", type=int, default=0, help="the first seed tried")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    world = open_world(given.world)
    for task in given.task or world.tasks:
        half = neutral.half(task, world.tasks)
        if given.half not in (None, half):
            continue
        done = 0
        for seed in range(given.first, given.first + given.episodes * TRIES):
            folder = given.out / half / f"{given.world}.{task}" / str(seed)
            if done == given.episodes:
                break
            known = (folder / "episode.json").exists()
            if known or record(given.world, task, seed, folder, given.frames, given.size):
                done += 1
        print(f"{half} {given.world}.{task}: {done} of {given.episodes} episodes", flush=True)


if __name__ == "__main__":
    main()
