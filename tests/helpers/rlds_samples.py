"""Small RLDS datasets, written as TFDS lays them out."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rpaug_adapters.rlds import tfrecord
from rpaug_adapters.rlds.example import example

STEPS, SIDE = 3, 16
CORE = "tensorflow_datasets.core.features."


def tensor(dtype: str, *shape: int) -> dict[str, Any]:
    about = {
        "shape": {"dimensions": [str(side) for side in shape]},
        "dtype": dtype,
        "encoding": "none",
    }
    return {"pythonClassName": CORE + "tensor_feature.Tensor", "tensor": about}


def image(dtype: str, encoding: str, *shape: int) -> dict[str, Any]:
    dimensions = {"dimensions": [str(side) for side in shape]}
    about = {"shape": dimensions, "dtype": dtype, "encodingFormat": encoding}
    return {"pythonClassName": CORE + "image_feature.Image", "image": about}


def several(**features: Any) -> dict[str, Any]:
    return {
        "pythonClassName": CORE + "features_dict.FeaturesDict",
        "featuresDict": {"features": features},
    }


TEXT = {"pythonClassName": CORE + "text_feature.Text", "text": {}}
FEATURES = several(
    steps={
        "pythonClassName": CORE + "dataset_feature.Dataset",
        "sequence": {
            "feature": several(
                action=tensor("float32", 7),
                is_last={"pythonClassName": CORE + "scalar.Scalar", "tensor": {"shape": {}, "dtype": "bool"}},
                language_instruction=TEXT,
                observation=several(
                    image=image("uint8", "jpeg", SIDE, SIDE, 3),
                    wrist=image("uint8", "png", SIDE, SIDE, 3),
                    depth=image("uint16", "png", SIDE, SIDE, 1),
                    far=image("float32", "png", SIDE, SIDE, 1),
                    near=tensor("float32", SIDE, SIDE, 1),
                    state=tensor("float32", 7),
                ),
            )
        },
    },
    episode_metadata=several(file_path=TEXT),
)  # fmt: skip


def record(rng: np.random.Generator) -> bytes:
    """One episode; every image a smooth one, so that JPEG shows it well."""

    def picture() -> np.ndarray:
        return cv2.resize(rng.integers(0, 255, (4, 4, 3), np.uint8), (SIDE, SIDE))

    def png(pixels: np.ndarray) -> bytes:
        return cv2.imencode(".png", pixels)[1].tobytes()

    metres = [rng.uniform(0.2, 2, (SIDE, SIDE)).astype(np.float32) for _ in range(STEPS)]
    split = [d[..., None].view(np.uint8)[..., [2, 1, 0, 3]] for d in metres]
    return example({
        "steps/observation/state": rng.normal(size=7 * STEPS).astype(np.float32),
        "steps/observation/image": [cv2.imencode(".jpg", picture())[1].tobytes() for _ in range(STEPS)],
        "steps/is_last": np.array([0, 0, -1]),
        "episode_metadata/file_path": [b"/somewhere"],
        "steps/observation/depth": [png((1000 * d).astype(np.uint16)) for d in metres],
        "steps/observation/far": [png(np.ascontiguousarray(d)) for d in split],
        "steps/observation/near": np.stack(metres),
        "steps/observation/wrist": [png(picture()) for _ in range(STEPS)],
        "steps/action": rng.normal(size=7 * STEPS).astype(np.float32),
        "steps/language_instruction": [b"put the cup away"] * STEPS,
        "unknown": [b"\x00\xff"],
    })  # fmt: skip


def dataset(folder: Path, *, train: tuple[int, ...] = (2, 1), val: tuple[int, ...] = (1,)) -> Path:
    """A dataset of as many records a shard as given; returns the root, two levels above."""
    rng = np.random.default_rng(0)
    place = folder / "toy" / "1.0.0"
    place.mkdir(parents=True)
    (place / "features.json").write_text(json.dumps(FEATURES, indent=4))
    splits = []
    for name, lengths in {"train": train, "val": val}.items():
        total = 0
        for i, length in enumerate(lengths):
            records = [record(rng) for _ in range(length)]
            total += sum(map(len, records))
            path = place / f"toy-{name}.tfrecord-{i:05d}-of-{len(lengths):05d}"
            path.write_bytes(b"".join(map(tfrecord.frame, records)))
        splits.append({
            "filepathTemplate": "{DATASET}-{SPLIT}.{FILEFORMAT}-{SHARD_X_OF_Y}",
            "name": name,
            "numBytes": str(total),
            "shardLengths": [str(length) for length in lengths],
        })  # fmt: skip
    info = {"fileFormat": "tfrecord", "name": "toy", "splits": splits, "version": "1.0.0"}
    (place / "dataset_info.json").write_text(json.dumps(info, indent=2))
    return folder
