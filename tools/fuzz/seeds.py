"""Tiny whole datasets, one a layout, from which spoilt ones are made."""

import json
from dataclasses import replace
from pathlib import Path

import av
import cv2
import h5py
import numpy as np
import yaml
from rpaug_adapters.rlds import tfrecord
from rpaug_adapters.rlds.example import example

from rpaug import Camera, CameraView, Episode, Robot
from rpaug.core.registry import adapter

STEPS, SIDE = 2, 8


def episode() -> Episode:
    """Two cameras with color, depth and handles."""
    rng = np.random.default_rng(0)
    pose = np.tile(np.eye(4), (STEPS, 1, 1))
    pose[:, 0, 3] = np.arange(STEPS)
    K = np.array([[9.0, 0, 4], [0, 9, 4], [0, 0, 1]])
    images = rng.integers(0, 255, (2, STEPS, SIDE, SIDE, 3), np.uint8)
    views = {
        name: CameraView(
            Camera(K, pose, SIDE, SIDE),
            lambda t, i=i: images[i, t],
            lambda t: np.full((SIDE, SIDE), 1 + t, np.float32),
            lambda t: np.full((SIDE, SIDE), 7 * t, np.int32),
        )
        for i, name in enumerate(("front", "wrist"))
    }
    numbers = rng.normal(size=(STEPS, 7))
    robot = Robot(numbers, numbers, pose, np.linspace(0, 1, STEPS))
    return Episode("0", views, robot, ("pick it up",), STEPS)


def rlbench(root: Path) -> None:
    """One episode."""
    adapter("rlbench").write(episode(), root, "all_variations/episodes/episode0", dict)


def lerobot(root: Path) -> None:
    """One episode, gathered."""
    writer = adapter("lerobot")
    writer.write(replace(episode(), rate=10.0), root, "toy/train/0", dict)
    writer.finish(root, root)


def lerobot_v21(root: Path) -> None:
    """One episode with files of its own, and annotations that number tasks."""
    writer = adapter("lerobot").in_version("v2.1")
    writer.write(replace(episode(), rate=10.0), root, "toy/train/0", dict)
    modality = {"annotation": {"task": {"original_key": "task_index"}}}
    (root / "toy/meta/modality.json").write_text(json.dumps(modality))
    writer.finish(root, root)


def rlds(root: Path) -> None:
    """One episode of our own writing: PNG, float images, packed tensors, a side file."""
    writer = adapter("rlds")
    writer.write(episode(), root, "toy/1.0.0/train/0", dict)
    writer.finish(root, root)


def jpeg_rlds(root: Path) -> None:
    """One episode as Open X-Embodiment has them: JPEG, numbers, words."""
    rng = np.random.default_rng(1)
    core = "tensorflow_datasets.core.features."

    def tensor(kind: str, *shape: int) -> dict:
        about = {"shape": {"dimensions": [str(s) for s in shape]}, "dtype": kind}
        return {"pythonClassName": core + "tensor_feature.Tensor", "tensor": about}

    def several(inner: dict) -> dict:
        name = core + "features_dict.FeaturesDict"
        return {"pythonClassName": name, "featuresDict": {"features": inner}}

    about = {
        "shape": {"dimensions": [str(SIDE), str(SIDE), "3"]},
        "dtype": "uint8",
        "encodingFormat": "jpeg",
    }
    image = {"pythonClassName": core + "image_feature.Image", "image": about}
    text = {"pythonClassName": core + "text_feature.Text", "text": {}}
    steps = several({
        "observation": several({"image_0": image, "state": tensor("float32", 7)}),
        "action": tensor("float32", 7), "is_last": tensor("bool"), "language_instruction": text,
    })  # fmt: skip
    sequence = {"feature": steps, "length": "-1"}
    every = {"pythonClassName": core + "dataset_feature.Dataset", "sequence": sequence}
    folder = root / "toy/1.0.0"
    folder.mkdir(parents=True)
    (folder / "features.json").write_text(json.dumps(several({"steps": every})))
    images = rng.integers(0, 255, (STEPS, SIDE, SIDE, 3), np.uint8)
    record = example({
        "steps/observation/image_0": [cv2.imencode(".jpg", i)[1].tobytes() for i in images],
        "steps/observation/state": rng.normal(size=7 * STEPS).astype(np.float32),
        "steps/action": rng.normal(size=7 * STEPS).astype(np.float32),
        "steps/is_last": np.array([0, 1]),
        "steps/language_instruction": [b"put it away"] * STEPS,
    })  # fmt: skip
    (folder / "toy-train.tfrecord-00000-of-00001").write_bytes(tfrecord.frame(record))
    split = {"name": "train", "numBytes": str(len(record)), "shardLengths": ["1"],
             "filepathTemplate": "{DATASET}-{SPLIT}.{FILEFORMAT}-{SHARD_X_OF_Y}"}  # fmt: skip
    info = {"fileFormat": "tfrecord", "name": "toy", "splits": [split], "version": "1.0.0"}
    (folder / "dataset_info.json").write_text(json.dumps(info))


def rdt(root: Path, version: str | None = None) -> None:
    """One episode with every way to store images, depth, words and a side file."""
    rng = np.random.default_rng(2)
    (root / "toy").mkdir(parents=True)
    images = rng.integers(0, 255, (STEPS, SIDE, SIDE, 3), np.uint8)
    encoded = [cv2.imencode(".jpg", image)[1].tobytes() for image in images]
    with h5py.File(root / "toy/episode_0.hdf5", "w", libver=version) as file:
        file["observations/qpos"] = rng.normal(size=(STEPS, 14))
        file["action"] = rng.normal(size=(STEPS, 14))
        file["observations/images/cam_high"] = np.array(encoded, "S")
        width = max(map(len, encoded))
        rows = [np.frombuffer(data.ljust(width, b"\0"), np.uint8) for data in encoded]
        file["observations/images/cam_left_wrist"] = np.stack(rows)
        kind = h5py.vlen_dtype(np.uint8)
        vary = file.create_dataset("observations/images/cam_right_wrist", (STEPS,), kind)
        for t, data in enumerate(encoded):
            vary[t] = np.frombuffer(data, np.uint8)
        file.create_dataset(
            "observations/images/raw", data=images, chunks=(1, SIDE, SIDE, 3), compression="gzip"
        )
        depth = np.full((STEPS, SIDE, SIDE), 900, np.uint16)
        file.create_dataset("observations/depth/cam_high", data=depth, compression="gzip")
        file["observations/eef"] = rng.normal(size=(STEPS, 7))
    words = {
        "instruction": "pour",
        "simplified_instruction": ["pour"],
        "expanded_instruction": ["pour it"],
    }
    (root / "toy/expanded_instruction_gpt-4-turbo.json").write_text(json.dumps(words))
    given = {
        "version": 1,
        "cameras": {"cam_high": {"K": [[9.0, 0, 4], [0, 9, 4], [0, 0, 1]], "metres": 0.001,
                                 "depth": "observations/depth/cam_high",
                                 "cam_to_world": np.eye(4).tolist()}},
        "gripper": {"key": "observations/eef", "opening": 6},
    }  # fmt: skip
    (root / "toy/cameras.yaml").write_text(yaml.safe_dump(given))


def latest_rdt(root: Path) -> None:
    """The same in HDF5's latest format, whose parts are sealed by checksums."""
    rdt(root, "latest")


def robomimic(root: Path, version: str | None = None) -> None:
    """One demonstration with depth, ids, `next_obs`, camera matrices, words and filter keys."""
    rng = np.random.default_rng(4)
    root.mkdir(parents=True)
    with h5py.File(root / "lift.hdf5", "w", libver=version) as file:
        demo = file.create_group("data/demo_0")
        shape = (STEPS + 1, SIDE, SIDE, 1)
        for name, rows in {
            "agentview_image": rng.integers(0, 255, (*shape[:3], 3), np.uint8),
            "agentview_depth": np.ones(shape, np.float32),
            "agentview_segmentation_instance": np.ones(shape, np.int32),
            "robot0_eef_pos": rng.normal(size=(STEPS + 1, 3)),
            "robot0_eef_quat": np.tile([0.0, 0, 0, 1], (STEPS + 1, 1)),
        }.items():
            demo.create_dataset(f"obs/{name}", data=rows[:-1], compression="gzip")
            demo.create_dataset(f"next_obs/{name}", data=rows[1:], compression="gzip")
        demo["actions"], demo["states"] = rng.normal(size=(STEPS, 7)), rng.normal(size=(STEPS, 9))
        matrix = {"intrinsics": np.eye(3).tolist(), "extrinsics": np.eye(4).tolist()}
        demo.attrs["num_samples"] = STEPS
        demo.attrs["camera_info"] = json.dumps({"agentview": matrix})
        demo.attrs["ep_meta"] = json.dumps({"lang": "lift it"})
        file["data"].attrs["env_args"] = json.dumps({"env_kwargs": {"control_freq": 20}})
        file["mask/train"] = np.array([b"demo_0"])


def latest_robomimic(root: Path) -> None:
    """The same in HDF5's latest format, whose parts are sealed by checksums."""
    robomimic(root, "latest")


def maniskill(root: Path) -> None:
    """One trajectory with depth, ids, camera matrices and the JSON beside."""
    rng = np.random.default_rng(5)
    root.mkdir(parents=True)
    with h5py.File(root / "cube.h5", "w") as file:
        obs = file.create_group("traj_0/obs", track_order=True)
        shape = (STEPS + 1, SIDE, SIDE)
        obs["sensor_data/base/rgb"] = rng.integers(0, 255, (*shape, 3), np.uint8)
        obs["sensor_data/base/depth"] = np.full((*shape, 1), 900, np.int16)
        obs["sensor_data/base/segmentation"] = np.ones((*shape, 1), np.int16)
        obs["sensor_param/base/intrinsic_cv"] = np.tile(np.eye(3), (STEPS + 1, 1, 1))
        obs["sensor_param/base/extrinsic_cv"] = np.tile(np.eye(4)[:3], (STEPS + 1, 1, 1))
        obs["agent/qpos"] = rng.normal(size=(STEPS + 1, 9))
        file["traj_0/actions"] = rng.normal(size=(STEPS, 8))
    about = {"env_info": {"env_id": "PickCube-v1"}, "episodes": [{"episode_id": 0}]}
    (root / "cube.json").write_text(json.dumps(about))


def droid(root: Path) -> None:
    """One raw episode: a camera filmed with both eyes, one whose depth was exported, metadata, words by uuid."""
    rng = np.random.default_rng(6)
    folder = root / "Lab/success/2023-07-07/morning"
    (folder / "recordings/MP4").mkdir(parents=True)
    (folder / "recordings/Depth/12").mkdir(parents=True)
    with h5py.File(folder / "trajectory.h5", "w") as file:
        for name in ("joint_position", "cartesian_velocity"):
            file[f"action/{name}"] = rng.normal(size=(STEPS, 7))
        seen = file.create_group("observation")
        for name, size in {
            "joint_positions": (7,),
            "cartesian_position": (6,),
            "gripper_position": (),
        }.items():
            seen[f"robot_state/{name}"] = rng.normal(size=(STEPS, *size))
        for serial, kind in (("11", 0), ("12", 1)):
            seen[f"camera_type/{serial}"] = np.full(STEPS, kind)
            seen[f"camera_extrinsics/{serial}_left"] = rng.normal(size=(STEPS, 6))
            seen[f"camera_intrinsics/{serial}_left"] = np.tile(
                [[9.0, 0, 4], [0, 9, 4], [0, 0, 1]], (STEPS, 1, 1)
            )
        seen["timestamp/control/step_start"] = 66 * np.arange(STEPS)
        file.attrs["current_task"] = "put it away"
    for name, wide in (("11", 1), ("11-stereo", 2), ("12", 1)):
        with av.open(folder / f"recordings/MP4/{name}.mp4", "w") as film:
            stream = film.add_stream("mpeg4", rate=60)
            stream.width, stream.height, stream.pix_fmt = wide * 16, 16, "yuv420p"
            for image in rng.integers(0, 255, (STEPS, 16, wide * 16, 3), np.uint8):
                film.mux(stream.encode(av.VideoFrame.from_ndarray(image)))
            film.mux(stream.encode())
    for t in range(STEPS):
        data = cv2.imencode(".png", np.full((16, 16), 900, np.uint16))[1].tobytes()
        (folder / f"recordings/Depth/12/{t}.png").write_bytes(data)
    about = {
        "uuid": "Lab+1",
        "current_task": "put it away",
        "hdf5_path": "success/2023-07-07/morning/trajectory.h5",
    }
    (folder / "metadata_Lab+1.json").write_text(json.dumps(about))
    words = {"Lab+1": {"language_instruction1": "put it away", "language_instruction2": "clear up"}}
    (root / "aggregated-annotations.json").write_text(json.dumps(words))
    given = {"exterior_image_1_left": {"K": [[9.0, 0, 4], [0, 9, 4], [0, 0, 1]], "metres": 0.001,
                                       "depth": "recordings/Depth/12"}}  # fmt: skip
    (root / "cameras.yaml").write_text(yaml.safe_dump({"version": 1, "cameras": given}))


def recipe(root: Path) -> None:
    """A recipe with fields of many kinds."""
    given = {
        "version": 1, "seed": 7, "copies": 2, "keep_originals": True,
        "select": {"episodes": ["*/train/*"], "limit": 3}, "accuracy": {"psnr": 30.0}, "arms": ["arm.xml"],
        "edits": [
            {"op": "recolor", "target": {"role": "manipulated"}, "color": {"sample": "colosseum"}, "probability": 0.8},
            {"one_of": [
                {"op": "light_color", "range": [[0, 0, 0], [0.5, 0.5, 0.5]], "weight": 3},
                {"op": "camera_pose", "camera": "front", "shift": 0.05},
                {"op": "recolor", "target": {"text": "the red thing"}, "color": {"rgb": [1, 0, 0]}},
            ]},
            {"op": "insert", "asset": "die"},
            {"op": "distractors", "count": 2},
        ],
        "gates": {"tries": 2},
    }  # fmt: skip
    root.mkdir(parents=True)
    (root / "recipe.yaml").write_text(yaml.safe_dump(given, sort_keys=False))


def ego4d(root: Path) -> None:
    """One video with its description, narrations, hands and a cut."""
    (root / "v2/full_scale").mkdir(parents=True)
    (root / "v2/annotations").mkdir()
    rng = np.random.default_rng(3)
    with av.open(root / "v2/full_scale/toy.mp4", "w") as file:
        stream = file.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = 16, 16, "yuv420p"
        for image in rng.integers(0, 255, (6, 16, 16, 3), np.uint8):
            file.mux(stream.encode(av.VideoFrame.from_ndarray(image)))
        file.mux(stream.encode())
    measured = {
        "fps": 30.0,
        "num_frames": 6,
        "display_resolution_width": 16,
        "display_resolution_height": 16,
    }
    clip = {"clip_uid": "c", "video_uid": "toy", "video_start_sec": 0.0, "video_end_sec": 0.1,
            "video_start_frame": 0, "video_end_frame": 3}  # fmt: skip
    videos = [{"video_uid": "toy", "duration_sec": 0.2, "video_metadata": measured}]
    stated = {
        "timestamp_sec": 0.05,
        "timestamp_frame": 1,
        "narration_text": "#C C lifts the lid",
        "annotation_uid": "a",
    }
    one = {"narration_pass_1": {"narrations": [stated], "summaries": []}}
    box = {"object_type": "left_hand", "bbox": {"x": 1, "y": 1, "width": 3, "height": 3}}
    frame = {"frame": 1, "clip_frame": 1, "boxes": [box]}
    hands = {
        **clip,
        "frames": [{"action_start_frame": 0, "action_end_frame": 2, "pnr_frame": frame}],
    }
    for name, given in {
        "ego4d.json": {"videos": videos, "clips": [clip]},
        "annotations/narration.json": {"toy": one},
        "annotations/fho_hands_train.json": {"clips": [hands]},
    }.items():
        (root / "v2" / name).write_text(json.dumps(given))
    cuts = {"clips": [{"video": "toy", "start": 0.0, "end": 0.1}]}
    (root / "v2/full_scale/clips.yaml").write_text(yaml.safe_dump(cuts))


def clip(root: Path) -> None:
    """A video of several groups of pictures, some of whose frames are stored early."""
    root.mkdir(parents=True)
    with av.open(root / "walk.mp4", "w") as file:
        stream = file.add_stream("libx264", rate=30, options={"g": "4", "x264-params": "threads=1"})
        stream.width, stream.height, stream.pix_fmt = 32, 32, "yuv420p"
        ramp = np.add.outer(np.arange(32), np.arange(32)).astype(np.uint8)
        for t in range(12):
            image = np.stack([ramp * 4, np.roll(ramp, 2 * t, 1) * 3, 255 - ramp * 2], -1)
            file.mux(stream.encode(av.VideoFrame.from_ndarray(image)))
        file.mux(stream.encode())
