"""Tiny datasets as robomimic, LIBERO and ManiSkill write them: names, kinds, attributes and order are theirs."""

import json
from pathlib import Path

import h5py
import numpy as np

STEPS, HEIGHT, WIDTH = 3, 6, 8


def robomimic(path: Path, demos: int = 2, libver: str | None = None) -> Path:
    """Color, depth, instance ids, `next_obs`, camera matrices, words and filter keys; compressed, as `--compress`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    camera = {
        "intrinsics": [[9.0, 0, WIDTH / 2], [0, 9.0, HEIGHT / 2], [0, 0, 1]],
        "extrinsics": np.diag([1.0, -1, -1, 1]).tolist(),
    }
    with h5py.File(path, "w", libver=libver) as file:
        data = file.create_group("data")
        for i in range(demos):
            rng = np.random.default_rng(i)
            demo = data.create_group(f"demo_{i}")
            seen = {
                "agentview_image": rng.integers(0, 255, (STEPS + 1, HEIGHT, WIDTH, 3), np.uint8),
                "robot0_eye_in_hand_image": rng.integers(0, 255, (STEPS + 1, 4, 4, 3), np.uint8),
                "agentview_depth": rng.uniform(0.5, 2, (STEPS + 1, HEIGHT, WIDTH, 1)).astype("f4"),
                "agentview_segmentation_instance": np.full(
                    (STEPS + 1, HEIGHT, WIDTH, 1), 1 + i, np.int32
                ),
                "robot0_joint_pos": rng.normal(size=(STEPS + 1, 7)),
                "robot0_eef_pos": rng.normal(size=(STEPS + 1, 3)),
                "robot0_eef_quat": np.tile([0.0, 0, 0, 1], (STEPS + 1, 1)),
                "robot0_gripper_qpos": rng.normal(size=(STEPS + 1, 2)),
            }
            for name, rows in seen.items():
                demo.create_dataset(f"obs/{name}", data=rows[:-1], compression="gzip")
                demo.create_dataset(f"next_obs/{name}", data=rows[1:], compression="gzip")
            demo["actions"] = rng.uniform(-1, 1, (STEPS, 7))
            demo["states"] = rng.normal(size=(STEPS, 32))
            demo["rewards"], demo["dones"] = np.zeros(STEPS), np.arange(STEPS)
            demo.attrs["model_file"] = "<mujoco/>"
            demo.attrs["ep_meta"] = json.dumps({"layout_id": i, "lang": "lift the red cube"})
            demo.attrs["num_samples"] = STEPS
            demo.attrs["camera_info"] = json.dumps(
                {"agentview": camera, "robot0_eye_in_hand": camera}
            )
        data.attrs["total"] = demos * STEPS
        data.attrs["env_args"] = json.dumps(
            {"env_name": "Lift", "type": 1, "env_kwargs": {"control_freq": 20}}
        )
        names = [f"demo_{i}".encode() for i in range(demos)]
        file["mask/train"], file["mask/valid"] = np.array(names[:-1]), np.array(names[-1:])
    return path


def libero(path: Path) -> Path:
    """Two cameras upside down, words of the file, counts."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        data = file.create_group("data")
        rng = np.random.default_rng(3)
        demo = data.create_group("demo_0")
        for name in ("agentview_rgb", "eye_in_hand_rgb"):
            demo[f"obs/{name}"] = rng.integers(0, 255, (STEPS, HEIGHT, WIDTH, 3), np.uint8)
        demo["obs/agentview_depth"] = rng.uniform(0.9, 1, (STEPS, HEIGHT, WIDTH, 1)).astype("f4")
        for name, size in {
            "joint_states": 7,
            "ee_pos": 3,
            "ee_ori": 3,
            "gripper_states": 2,
        }.items():
            demo[f"obs/{name}"] = rng.normal(size=(STEPS, size))
        demo["actions"], demo["dones"] = rng.uniform(-1, 1, (STEPS, 7)), np.zeros(STEPS, np.uint8)
        demo.attrs["num_samples"], demo.attrs["init_state"] = STEPS, np.arange(4.0)
        data.attrs["macros_image_convention"] = "opengl"
        data.attrs["problem_info"] = json.dumps(
            {"problem_name": "tabletop", "language_instruction": '"pick up the bowl"'}
        )
        data.attrs["env_args"] = json.dumps({"env_kwargs": {"control_freq": 20}})
        data.attrs["num_demos"], data.attrs["total"] = 1, STEPS
    return path


def maniskill(path: Path, demos: int = 2) -> Path:
    """Observations of one camera, one more than actions, with its matrices, and the JSON beside."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        for i in range(demos):
            rng = np.random.default_rng(i)
            demo = file.create_group(f"traj_{i}", track_order=True)
            obs = demo.create_group("obs", track_order=True)
            size = (STEPS + 1, HEIGHT, WIDTH)
            for name, rows in {
                "agent/qpos": rng.normal(size=(STEPS + 1, 9)).astype("f4"),
                "extra/tcp_pose": np.tile(np.float32([0.1, 0.2, 0.3, 1, 0, 0, 0]), (STEPS + 1, 1)),
                "sensor_param/base/extrinsic_cv": np.tile(
                    np.eye(4, dtype="f4")[:3], (STEPS + 1, 1, 1)
                ),
                "sensor_param/base/cam2world_gl": np.tile(
                    np.diag(np.float32([1, -1, -1, 1])), (STEPS + 1, 1, 1)
                ),
                "sensor_param/base/intrinsic_cv": np.tile(
                    np.float32([[9, 0, WIDTH / 2], [0, 9, HEIGHT / 2], [0, 0, 1]]),
                    (STEPS + 1, 1, 1),
                ),
            }.items():
                obs[name] = rows
            camera = obs.create_group("sensor_data/base", track_order=True)
            for name, rows in {
                "segmentation": rng.integers(0, 4, (*size, 1), np.int16),
                "rgb": rng.integers(0, 255, (*size, 3), np.uint8),
                "depth": rng.integers(500, 2000, (*size, 1), np.int16),
            }.items():
                camera.create_dataset(name, data=rows, compression="gzip", compression_opts=5)
            demo["actions"] = rng.uniform(-1, 1, (STEPS, 8)).astype("f4")
            demo["terminated"] = demo["truncated"] = demo["success"] = np.zeros(STEPS, bool)
            demo["env_states/actors/cube"] = rng.normal(size=(STEPS + 1, 13)).astype("f4")
    episodes = [
        {"episode_id": i, "reset_kwargs": {"seed": 40 + i}, "elapsed_steps": STEPS}
        for i in range(demos)
    ]
    about = {"env_info": {"env_id": "PickCube-v1", "env_kwargs": {}}, "episodes": episodes}
    path.with_suffix(".json").write_text(json.dumps(about))
    return path
