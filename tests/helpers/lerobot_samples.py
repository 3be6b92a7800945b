"""A small LeRobot dataset: two splits, videos and images, words that change within an episode, an unknown column."""

import json
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import pyarrow as pa
from rpaug_adapters.lerobot import LeRobot, codes, fresh, pack, tables

from rpaug import Camera, CameraView, Episode, Robot

HEIGHT, WIDTH = 32, 48
WORDS = ("pick it up", "put it down")
DEPTH = "observation.images.front_depth"
FILMED = {"depth_min": 0.2, "depth_max": 3.0, "shift": 1.0, "use_log": True}


def picture(seed: int, t: int) -> np.ndarray:
    """Smooth and colorful, and another one in each frame."""
    image = np.random.default_rng(seed).integers(0, 255, (3, 4, 3), np.uint8)
    return np.roll(cv2.resize(image, (WIDTH, HEIGHT)), 2 * t, 1)


def episode(seed: int, length: int) -> Episode:
    rng = np.random.default_rng(seed)
    pose = np.tile(np.eye(4), (length, 1, 1))
    pose[:, :3, 3] = rng.normal(size=(length, 3))
    K = np.array([[50.0, 0, 24], [0, 50, 16], [0, 0, 1]])
    depth = rng.uniform(0.5, 2, (length, HEIGHT, WIDTH)).astype(np.float32)
    views = {
        "front": CameraView(
            Camera(K, np.tile(np.eye(4), (length, 1, 1)), WIDTH, HEIGHT),
            lambda t: picture(seed, t),
            lambda t: depth[t],
            lambda t: np.full((HEIGHT, WIDTH), seed + t, np.int32),
        ),
        "wrist": CameraView(Camera(K, pose, WIDTH, HEIGHT), lambda t: picture(seed + 9, t)),
    }
    robot = Robot(
        rng.normal(size=(length, 7)), rng.normal(size=(length, 7)), pose, np.linspace(0, 1, length)
    )
    return Episode(f"{seed}", views, robot, WORDS[:1], length, rate=10.0)


def dataset(folder: Path, *, train: tuple[int, ...] = (5, 3), val: tuple[int, ...] = (4,)) -> Path:
    """Episodes of as many frames as given; returns the root, one level above the dataset."""
    adapter = LeRobot()
    for split, lengths in {"train": train, "val": val}.items():
        for number, length in enumerate(lengths):
            made = episode(10 * len(split) + number, length)
            adapter.write(made, folder, f"toy/{split}/{number}", dict)
            path = folder / "toy" / split / str(number) / tables.STAGED
            table = tables.table(path)
            half = [WORDS[t >= length // 2] for t in range(length)]
            table = table.set_column(table.column_names.index("task"), "task", pa.array(half))
            table = table.append_column("note", pa.array([f"{t}!" for t in range(length)]))
            small = [
                cv2.imencode(".png", picture(t, 0)[..., ::-1])[1].tobytes() for t in range(length)
            ]
            table = table.append_column("observation.image", fresh.images(small))
            pa.parquet.write_table(table, path)
    described = folder / "toy/meta/info.json"
    given = json.loads(described.read_text())
    given["features"]["note"] = {"dtype": "string", "shape": [1], "names": None}
    given["features"]["observation.image"] = {
        "dtype": "image", "shape": [HEIGHT, WIDTH, 3], "names": ["height", "width", "channels"]
    }  # fmt: skip
    described.write_text(json.dumps(given | {"data_files_size_in_mb": 0.01}))
    pack.pack(folder / "toy", folder / "toy")
    return folder


def halved(view: CameraView) -> CameraView:
    return replace(view, rgb=lambda t: view.rgb(t) // 2)


def filmed_depth(root: Path, more: tuple[int, int] = (0, 0)) -> Path:
    """A dataset whose depth is a video, as LeRobot's recorder writes it; one corner was not measured.

    The film is so many columns and rows larger than the color's.
    """
    wide, high = more
    adapter = LeRobot()
    for number in range(2):
        made, own = episode(number, 3 + number), root / f"toy/train/{number}"
        adapter.write(made, root, f"toy/train/{number}", dict)
        rows = pa.parquet.read_table(own / tables.STAGED).drop_columns([DEPTH])
        pa.parquet.write_table(rows, own / tables.STAGED)
        counted = json.loads((own / tables.STATISTICS).read_text())
        del counted[DEPTH]  # of metres
        (own / tables.STATISTICS).write_text(json.dumps(counted))
        (own / tables.ROW).unlink()  # and of images
        with av.open(str(own / f"{DEPTH}.mp4"), "w", format="mp4") as film:
            options = {"g": "1", "x265-params": "lossless=1:log-level=none"}
            stream = film.add_stream("libx265", rate=10, options=options)
            stream.width, stream.height = WIDTH + wide, HEIGHT + high
            stream.pix_fmt = "gray12le"
            for t in range(made.length):
                values = codes.Scale(**FILMED).codes(made.views["front"].depth(t))
                values[:8, :8] = 0
                values = np.pad(values, ((0, high), (0, wide)))
                frame = av.VideoFrame.from_ndarray(values, format="gray12le")
                film.mux(stream.encode(frame))
            film.mux(stream.encode())
    path = root / "toy" / tables.INFO
    given = json.loads(path.read_text())
    about = {"is_depth_map": True, "depth_unit": "mm", "video.pix_fmt": "gray12le"}
    about |= {f"video.{name}": value for name, value in FILMED.items()}
    given["features"][DEPTH] |= {"dtype": "video", "info": about}
    path.write_text(json.dumps(given))
    adapter.finish(root, root)
    return root
