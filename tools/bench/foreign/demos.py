"""Records scripted demonstrations of robosuite in one HDF5 file a task, as robomimic's `dataset_states_to_obs.py` lays
them out; sees what was re-observed in them with robosuite's own sensors; runs in the simulators' environment, without
rpaug.

python -m tools.bench.foreign.demos --task Lift --episodes 50 --out demos

With `--seen FILE`, a file that `rpaug reobserve` wrote, OUT gets `compared.json` instead, and of the demonstrations
`--demo` neutral folders without films, from which `tools.bench.foreign.changed` renders their states truly changed.
"""

import argparse
import json
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import mujoco
import numpy as np
import robosuite as suite
from robosuite.utils.camera_utils import get_real_depth_map

from tools.bench.foreign import neutral, simulated
from tools.bench.foreign.record import by_geom, roles
from tools.bench.foreign.worlds import robosuite as world
from tools.bench.foreign.worlds.robosuite import EXPERTS, LINGER, LONGEST, tasks

CAMERAS = ("agentview", "robot0_eye_in_hand")
CONTROL = 20  # actions a second
IDS = "segmentation_instance"
SEEN = ("depth", IDS)  # of each camera, by `rpaug reobserve`
EACH = 3  # of the states that are compared


def settings(size: int) -> dict[str, Any]:
    """What the environment is made with."""
    return {
        "robots": "Panda", "has_renderer": False, "has_offscreen_renderer": True, "ignore_done": True,
        "use_camera_obs": True, "camera_names": list(CAMERAS), "camera_heights": size,
        "camera_widths": size, "camera_depths": False, "control_freq": CONTROL,
    }  # fmt: skip


def rollout(task: str, seed: int) -> tuple[str, np.ndarray, np.ndarray] | None:
    """An expert's run until shortly after success: the model, states and actions; None if it fails."""
    given = settings(1) | {"has_offscreen_renderer": False, "use_camera_obs": False}
    env = suite.make(task, seed=seed, horizon=LONGEST + 1, **given)
    seen = env.reset()
    model = quicker(env.sim.model.get_xml())
    expert = EXPERTS[task](seen)
    states, actions, lingered = [], [], 0
    for _ in range(LONGEST):
        action = expert.send(seen if states else None)
        states.append(env.sim.get_state().flatten())
        actions.append(action)
        seen, _, _, _ = env.step(action)
        lingered = lingered + 1 if env._check_success() or lingered else 0
        if lingered > LINGER:
            env.close()
            return model, np.array(states), np.array(actions)
    return None


def quicker(model: str) -> str:
    """The model with a smaller map of shadows, which a processor renders at twice the pace."""
    root = ET.fromstring(model)
    visual = root.find("visual")
    quality = None if visual is None else visual.find("quality")
    if quality is None:
        quality = ET.SubElement(root if visual is None else visual, "quality")
    quality.set("shadowsize", str(simulated.SHADOW))
    return ET.tostring(root, encoding="unicode")


def sensed(env: Any, model: str, states: np.ndarray) -> Iterator[dict[str, np.ndarray]]:
    """What robosuite's sensors say in each state; images are upside down."""
    env.reset_from_xml_string(env.edit_model_xml(model))
    env.sim.reset()
    for state in states:
        env.sim.set_state_from_flattened(state)
        env.sim.forward()
        yield env._get_observations(force_update=True)


def observed(env: Any, model: str, states: np.ndarray) -> dict[str, np.ndarray]:
    """What robomimic's wrapper would have seen in each state: images upright."""
    seen: dict[str, list[np.ndarray]] = {}
    for shown in sensed(env, model, states):
        for name, value in shown.items():
            if name.endswith("_image"):
                value = value[::-1]
            if (name.startswith("robot0_") and "proprio" not in name) or name.endswith("_image"):
                seen.setdefault(name, []).append(np.array(value))
    return {name: np.stack(rows) for name, rows in seen.items()}


def record(task: str, episodes: int, size: int, path: Path) -> None:
    """Write a file with so many successful demonstrations."""
    path.parent.mkdir(parents=True, exist_ok=True)
    env = suite.make(task, **settings(size))
    with h5py.File(path, "w") as file:
        data, seed, total = file.create_group("data"), 0, 0
        while len(data) < episodes:
            run, seed = rollout(task, seed), seed + 1
            if run is None:
                continue
            model, states, actions = run
            demo = data.create_group(f"demo_{len(data)}")
            demo["actions"], demo["states"] = actions, states
            demo["rewards"], demo["dones"] = np.zeros(len(actions)), np.zeros(len(actions), int)
            for name, rows in observed(env, model, states).items():
                demo.create_dataset(f"obs/{name}", data=rows, compression="gzip")
            demo.attrs["model_file"], demo.attrs["num_samples"] = model, len(actions)
            demo.attrs["ep_meta"] = json.dumps({"lang": tasks[task].instruction})
            total += len(actions)
            print(f"{task}: {len(data)} of {episodes}", flush=True)
        given = {"env_name": task, "env_version": suite.__version__, "type": 1}
        data.attrs["env_args"] = json.dumps(given | {"env_kwargs": settings(size)}, indent=4)
        data.attrs["total"] = total
        names = [f"demo_{i}".encode() for i in range(episodes)]
        most = max(1, round(0.9 * episodes))
        file["mask/train"], file["mask/valid"] = (
            np.array(names[:most]),
            np.array(names[most:], "S8"),
        )


def compared(task: str, path: Path) -> dict[str, dict[str, int]]:
    """By demonstration of a re-observed file: pixels, depths that are not robosuite's, and pixels of other instances
    than their geom has elsewhere, or of instances that hold bodies which can move apart."""
    with h5py.File(path) as file:
        first = next(iter(file["data"].values()))
        size = first[f"obs/{CAMERAS[0]}_image"].shape[1]
        given = settings(size) | {"camera_depths": True, "camera_segmentations": "element"}
        env, found = suite.make(task, **given), {}
        for name, demo in file["data"].items():
            count = dict.fromkeys(("images", "pixels", "depths", "masks"), 0)
            of_geom: dict[int, int] = {}
            welds: dict[int, int] = {}
            steps = range(0, len(demo["states"]), EACH)
            shown = sensed(env, demo.attrs["model_file"], demo["states"][::EACH])
            pairs = (
                (t, seen, camera)
                for t, seen in zip(steps, shown, strict=True)
                for camera in CAMERAS
            )
            for t, seen, camera in pairs:
                obs = {kind: demo[f"obs/{camera}_{kind}"][t][..., 0] for kind in SEEN}
                depth = get_real_depth_map(env.sim, seen[f"{camera}_depth"][::-1])[..., 0]
                geoms = seen[f"{camera}_segmentation_element"][::-1, :, 0]
                model = env.sim.model._model
                for geom in np.unique(geoms):
                    ids = obs[IDS][geoms == geom]
                    mine = of_geom.setdefault(int(geom), int(ids[0]) if geom >= 0 else 0)
                    weld = model.body_weldid[model.geom_bodyid[geom]] if geom >= 0 else -1
                    right = welds.setdefault(mine, int(weld)) == weld
                    count["masks"] += int((ids != mine).sum()) if right else len(ids)
                count["images"] += 1
                count["pixels"] += depth.size
                count["depths"] += int((depth != obs["depth"]).sum())
            found[name] = count
            print(task, name, count, flush=True)
    return found


def lay_out(task: str, path: Path, name: str, folder: Path) -> None:
    """One re-observed demonstration as a neutral folder without films: model, states, cameras, and true roles by the
    ids that its masks give the simulator's bodies; a body that no mask shows has a number of its own."""
    with h5py.File(path) as file:
        demo = file[f"data/{name}"]
        states, xml = demo["states"][()], demo.attrs["model_file"]
        seen = {camera: demo[f"obs/{camera}_{IDS}"][..., 0] for camera in CAMERAS}
    env = suite.make(
        task, **settings(1) | {"has_offscreen_renderer": False, "use_camera_obs": False}
    )
    source = env.edit_model_xml(xml)
    env.close()
    model = simulated.load(source, folder, world.hidden)
    initial, count = mujoco.MjData(model), len(states)
    mujoco.mj_resetData(model, initial)
    kept = {
        key: np.repeat(value[None], count, 0) for key, value in simulated.state(initial).items()
    }
    kept["qpos"] = states[:, 1 : 1 + model.nq]
    kept["qvel"] = states[:, 1 + model.nq : 1 + model.nq + model.nv]
    things = simulated.shown(model, world.groups)
    numbers = {body: k + 1 for k, body in enumerate(things)}
    eyes = {camera: eye(model, camera) for camera in CAMERAS}
    given = {"size": seen[CAMERAS[0]].shape[1], "headlamp": True}
    studio = simulated.Studio(model, by_geom(model, things, numbers), world.groups, **given)
    films = studio.film(kept, eyes)
    studio.close()
    ids = {}
    for body, number in numbers.items():
        found = np.concatenate([seen[camera][films[camera]["ids"] == number] for camera in CAMERAS])
        ids[body] = (
            int(np.bincount(found).argmax()) if found.size else model.nbody + model.ngeom + number
        )
    facts = {
        "world": "robosuite", "task": task, "seed": int(name.removeprefix("demo_")),
        "instruction": tasks[task].instruction, "model": "model.xml", "groups": world.groups,
        "steps": [*range(count)], "ids": ids, "roles": roles(world, task, model, ids, kept),
        "cameras": {camera: vars(one) for camera, one in eyes.items()}, "studio": given,
    }  # fmt: skip
    neutral.save(folder, facts, {"states": kept, "model": {}})


def eye(model: mujoco.MjModel, name: str) -> simulated.Eye:
    """A camera of the model's own."""
    camera, turn = model.camera(name), np.zeros(9)
    mujoco.mju_quat2Mat(turn, camera.quat)
    _, up, back = turn.reshape(3, 3).T
    body = model.body(int(camera.bodyid[0])).name if camera.bodyid[0] else None
    at = (camera.pos - back).tolist()
    fovy = float(camera.fovy[0])
    return simulated.Eye(eye=camera.pos.tolist(), at=at, up=up.tolist(), body=body, fovy=fovy)


def main() -> None:
    """Record demonstrations, or see what was re-observed in them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--task", required=True, choices=list(EXPERTS))
    parser.add_argument("--episodes", type=int, default=50)
    parser.add_argument("--size", type=int, default=84, help="pixels a side")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seen", type=Path, help="a re-observed file")
    parser.add_argument("--demo", action="append", default=[], help="lay out a neutral folder")
    given = parser.parse_args()
    if given.seen is None:
        record(given.task, given.episodes, given.size, given.out / f"{given.task.lower()}.hdf5")
        return
    for name in given.demo:
        lay_out(given.task, given.seen, name, given.out / name)
    if not given.demo:
        given.out.mkdir(parents=True, exist_ok=True)
        (given.out / "compared.json").write_text(json.dumps(compared(given.task, given.seen)))


if __name__ == "__main__":
    main()
