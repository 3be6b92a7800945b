"""Records scripted demonstrations of robosuite in one HDF5 file a task, as robomimic's `dataset_states_to_obs.py` lays
them out; runs in the simulators' environment, without rpaug.

python -m tools.bench.foreign.demos --task Lift --episodes 50 --out demos
"""

import argparse
import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import robosuite as suite

from tools.bench.foreign.simulated import SHADOW
from tools.bench.foreign.worlds.robosuite import EXPERTS, LINGER, LONGEST, tasks

CAMERAS = ("agentview", "robot0_eye_in_hand")
CONTROL = 20  # actions a second


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
    quality.set("shadowsize", str(SHADOW))
    return ET.tostring(root, encoding="unicode")


def observed(env: Any, model: str, states: np.ndarray) -> dict[str, np.ndarray]:
    """What robomimic's wrapper would have seen in each state: images upright."""
    env.reset_from_xml_string(env.edit_model_xml(model))
    env.sim.reset()
    seen: dict[str, list[np.ndarray]] = {}
    for state in states:
        env.sim.set_state_from_flattened(state)
        env.sim.forward()
        for name, value in env._get_observations(force_update=True).items():
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


def main() -> None:
    """Parse, record."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--task", required=True, choices=list(EXPERTS))
    parser.add_argument("--episodes", type=int, default=50)
    parser.add_argument("--size", type=int, default=84, help="pixels a side")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    record(given.task, given.episodes, given.size, given.out / f"{given.task.lower()}.hdf5")


if __name__ == "__main__":
    main()
