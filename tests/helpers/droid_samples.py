"""A tiny episode as DROID's recorder and postprocessing write one: trajectory, metadata, videos of three cameras."""

import json
from pathlib import Path
from typing import Any

import av
import cv2
import h5py
import numpy as np

STEPS, WIDTH, HEIGHT = 5, 64, 36
WRIST, FIRST, SECOND = "14436910", "24013089", "26405488"  # serials
UUID = "AUTOLab+5d05c5aa+2023-07-07-09h-42m-23s"
FOLDER = "AUTOLab/success/2023-07-07/Fri_Jul__7_09:42:23_2023"
WORDS = {"language_instruction1": "put the red block in the bowl", "language_instruction2": "red into the bowl",
         "language_instruction3": "move the red block"}  # fmt: skip
K = np.array([[40.0, 0, WIDTH / 2], [0, 40.0, HEIGHT / 2], [0, 0, 1]])


def picture(serial: str, side: str, t: int) -> np.ndarray:
    """What an eye sees at a step: a smooth pattern of its own, and a red block that moves."""
    rng = np.random.default_rng([int(serial), side == "left"])
    image = cv2.resize(rng.integers(60, 200, (3, 4, 3), np.uint8), (WIDTH, HEIGHT))
    image[10:20, 8 + 4 * t : 20 + 4 * t] = (200, 30, 30)
    return image


def step(t: int, intrinsics: bool) -> dict[str, Any]:
    """One step as `collect_trajectory` puts it together."""
    joints = np.linspace(0, 1, 7) + 0.01 * t
    pose = np.array([0.4, 0.1, 0.3 + 0.01 * t, 3.1, 0.05, -0.2])
    fixed = {FIRST: [0.1, 0.6, 0.4, -1.9, 0.1, -2.2], SECOND: [0.2, -0.6, 0.4, -1.9, 0.0, 0.9]}
    placed = {
        f"{serial}_{side}": np.array(at)
        for serial, at in fixed.items()
        for side in ("left", "right")
    }
    placed |= {
        f"{WRIST}_{side}": pose + np.array([0.05, 0, 0.05, 0, 0, 0.1]) for side in ("left", "right")
    }
    placed |= {f"{WRIST}_left_gripper_offset": np.array([0.05, 0, 0.05, 0, 0, 0.1])}
    received = {
        f"{serial}_frame_received": 1688744543000 + 67 * t for serial in (WRIST, FIRST, SECOND)
    }
    observation = {
        "robot_state": {"joint_positions": joints, "joint_velocities": joints / 10, "cartesian_position": pose,
                        "gripper_position": 0.25, "prev_command_successful": True},
        "camera_type": {WRIST: 0, FIRST: 1, SECOND: 1},
        "camera_extrinsics": placed,
        "controller_info": {"movement_enabled": True, "success": t == STEPS - 1, "failure": False},
        "timestamp": {"cameras": received, "skip_action": False,
                      "control": {"step_start": 1688744543000 + 67 * t, "step_end": 1688744543066 + 67 * t}},
    }  # fmt: skip
    if intrinsics:
        observation["camera_intrinsics"] = {name: K for name in placed if "offset" not in name}
    action = {"joint_position": joints + 0.01, "joint_velocity": joints / 9, "cartesian_position": pose,
              "cartesian_velocity": pose / 9, "gripper_position": 0.2, "gripper_velocity": 0.1}  # fmt: skip
    return {"observation": observation, "action": action}


def append(group: h5py.Group, given: dict[str, Any]) -> None:
    """One more row of each number, as DROID's `TrajectoryWriter` grows its datasets."""
    for name, value in given.items():
        if isinstance(value, dict):
            append(group.require_group(name), value)
            continue
        value = np.asarray(value)
        if name not in group:
            group.create_dataset(
                name, (0, *value.shape), value.dtype, maxshape=(None, *value.shape)
            )
        group[name].resize(len(group[name]) + 1, axis=0)
        group[name][-1] = value


def film(path: Path, images: list[np.ndarray]) -> None:
    """An MP4 as `svo2mp4.py` writes it: MPEG-4, the camera's 60 frames a second."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as made:
        stream = made.add_stream("mpeg4", rate=60, options={"qscale": "2"})
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        for image in images:
            made.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        made.mux(stream.encode())


def droid(
    root: Path,
    *,
    stereo: bool = True,
    raw: bool = True,
    intrinsics: bool = True,
    depth: bool = False,
    annotated: bool = True,
) -> Path:
    """The root of a dataset with one episode."""
    folder = root / FOLDER
    folder.mkdir(parents=True)
    with h5py.File(folder / "trajectory.h5", "w") as file:
        file.attrs.update(
            current_task="Move object into container", user="anyone", building="main", success=True
        )
        for t in range(STEPS):
            append(file, step(t, intrinsics))
    about: dict[str, Any] = {"uuid": UUID, "lab": "AUTOLab", "current_task": "Move object into container",
                             "trajectory_length": STEPS,
                             "hdf5_path": f"{FOLDER.partition('/')[2]}/trajectory.h5"}  # fmt: skip
    for short, serial in (("wrist", WRIST), ("ext1", FIRST), ("ext2", SECOND)):
        recordings = f"{FOLDER.partition('/')[2]}/recordings"
        about[f"{short}_cam_serial"] = serial
        about[f"{short}_cam_extrinsics"] = step(0, False)["observation"]["camera_extrinsics"][
            f"{serial}_left"
        ].tolist()
        about[f"{short}_svo_path"] = f"{recordings}/SVO/{serial}.svo"
        about[f"{short}_mp4_path"] = f"{recordings}/MP4/{serial}.mp4"
        eyes = [[picture(serial, side, t) for t in range(STEPS)] for side in ("left", "right")]
        film(folder / f"recordings/MP4/{serial}.mp4", eyes[0])
        if stereo:
            film(
                folder / f"recordings/MP4/{serial}-stereo.mp4",
                [np.hstack(both) for both in zip(*eyes, strict=True)],
            )
        if raw:
            (folder / "recordings/SVO").mkdir(exist_ok=True)
            (folder / f"recordings/SVO/{serial}.svo").write_bytes(b"ZED" * 9)
        if depth:
            (folder / f"recordings/Depth/{serial}").mkdir(parents=True)
            for t in range(STEPS):
                codes = np.full((HEIGHT, WIDTH), 900 + t, np.uint16)
                codes[0, 0] = 0
                (folder / f"recordings/Depth/{serial}/{t}.png").write_bytes(
                    cv2.imencode(".png", codes)[1].tobytes()
                )
    (folder / f"metadata_{UUID}.json").write_text(json.dumps(about))
    if annotated:
        (root / "aggregated-annotations-030724.json").write_text(
            json.dumps({UUID: WORDS, "another": WORDS})
        )
    return root
