"""A LeRobot episode from another source: the features it gets, and its rows.

Color is video; depth is a float image in metres and handles are whole numbers, so that both come back exactly; other
numbers are float32. Frames a second are a whole number here: the nearest to what the source states, or to the times of
a video's frames; where neither is there it is asked for, and never assumed.
"""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from rpaug_adapters.lerobot import tables
from rpaug_adapters.lerobot.read import DEPTH, MASK
from rpaug_adapters.lerobot.tables import COUNTED, DATA_PATH, VIDEO_PATH
from rpaug_adapters.shared import fresh

from rpaug import Embeddings, Episode, Unsupported

SECONDS = "seconds"  # the numbers that hold the time of each frame
IMAGE = "observation.images."
UNPACKED = [cv2.IMWRITE_TIFF_COMPRESSION, 1]  # every reader of TIFF knows it


def described(episode: Episode) -> dict[str, Any]:
    """`meta/info.json` of a dataset of such episodes, with none in it yet."""
    fps = rate(episode)
    return {
        "codebase_version": "v3.0",
        "robot_type": None,
        "total_episodes": 0,
        "total_frames": 0,
        "total_tasks": 0,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {},
        "data_path": DATA_PATH,
        "video_path": VIDEO_PATH,
        "features": _features(plain(episode), fps),
    }


def rate(episode: Episode) -> int:
    """Frames a second: as the source states, or of the times that it tells, the mean as a whole number. Raises
    Unsupported where it does neither."""
    if episode.rate is not None:
        return max(1, round(episode.rate))
    names = (name for name in episode.robot.extra if name.rpartition("/")[2] == SECONDS)
    name = next(names, None)
    if name is not None:
        times = np.asarray(episode.robot.extra[name], float).reshape(episode.length, -1)[:, 0]
        if (lasts := float(times[-1] - times[0])) > 0:
            return max(1, round((episode.length - 1) / lasts))
    reason = "LeRobot needs the frames a second, and the source states none (--fps gives them)"
    raise Unsupported(f"{episode.key}: {reason}")


def _features(episode: Episode, fps: int) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, view in episode.views.items():
        size = [view.camera.height, view.camera.width]
        about = {
            "video.height": size[0],
            "video.width": size[1],
            "video.codec": "h264",
            "video.pix_fmt": "yuv444p",
            "is_depth_map": False,
            "video.fps": fps,
            "video.channels": 3,
            "has_audio": False,
        }
        sides = ["height", "width", "channels"]
        found[IMAGE + name] = {"dtype": "video", "shape": [*size, 3], "names": sides, "info": about}
        if view.depth is not None:
            metric = {"is_depth_map": True, "depth_unit": "m"}
            shape = [*size, 1]
            one = {"dtype": "image", "shape": shape, "names": sides, "info": metric}
            found[IMAGE + name + DEPTH] = one
        if view.ids is not None:
            found[MASK + name] = {"dtype": "int32", "shape": size, "names": sides[:2]}
    for name, track in fresh.tracks(episode).items():
        found[named(name)] = {"dtype": "float32", "shape": [track.shape[1]], "names": None}
    for name, kind in COUNTED.items():
        found[name] = {"dtype": kind, "shape": [1], "names": None}
    return found


def rows(episode: Episode) -> Any:
    """The episode's table, but for what counts frames of the whole dataset."""
    pa, _ = tables.arrow()
    length = episode.length
    columns: dict[str, Any] = {}
    for name, track in fresh.tracks(episode).items():
        flat = pa.array(track.astype(np.float32).ravel())
        width = track.shape[1]
        columns[named(name)] = (
            flat if width == 1 else pa.FixedSizeListArray.from_arrays(flat, width)
        )
    for name, view in episode.views.items():
        if view.depth is not None:
            columns[IMAGE + name + DEPTH] = images([tiff(view.depth(t)) for t in range(length)])
        if view.ids is not None:
            columns[MASK + name] = whole([view.ids(t) for t in range(length)])
    columns["timestamp"] = pa.array((np.arange(length) / rate(episode)).astype(np.float32))
    columns["frame_index"] = pa.array(np.arange(length))
    columns["task"] = pa.array([episode.instruction] * length)
    return pa.table(columns)


def beside(episode: Episode) -> bytes:
    """What `cameras.yaml` says of the episode."""

    def image(name: str) -> str:
        camera, _, kind = name.rpartition("_")
        return MASK + camera if kind == "mask" else IMAGE + camera + DEPTH

    return fresh.beside(episode, named, image)


def named(name: str) -> str:
    """LeRobot's features have no slashes, and policies take all that begin with `observation` for states: vectors made
    of words do not."""
    if Embeddings.among([name]):
        name = name.removeprefix("observation/")
    return name.replace("/", ".")


def plain(episode: Episode) -> Episode:
    """The episode with no slash in the names of its cameras."""
    views = {name.replace("/", "_"): view for name, view in episode.views.items()}
    return replace(episode, views=views)


def tiff(values: np.ndarray) -> bytes:
    """One channel of any number type, exactly."""
    return cv2.imencode(".tiff", values, UNPACKED)[1].tobytes()


def images(encoded: list[bytes]) -> Any:
    """A column of encoded images."""
    pa, _ = tables.arrow()
    kind = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
    return pa.array([{"bytes": data, "path": None} for data in encoded], kind)


def whole(frames: list[np.ndarray]) -> Any:
    """A column of arrays of whole numbers."""
    pa, _ = tables.arrow()
    height, width = frames[0].shape
    flat = pa.array(np.stack(frames).astype(np.int32).ravel())
    lines = pa.ListArray.from_arrays(
        pa.array(np.arange(0, len(flat) + 1, width, dtype=np.int32)), flat
    )
    ends = np.arange(0, len(frames) * height + 1, height, dtype=np.int32)
    return pa.ListArray.from_arrays(pa.array(ends), lines)
