"""Writing a raw episode of DROID: the recorded folder, with what changed laid into it.

Videos of which no frame changed are linked, edited ones keep their codec. SVO files of edited cameras are left out:
they show what was recorded, and readers that have the ZED SDK take them first.
"""

import os
import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import h5py
import numpy as np
from jaxtyping import Float64, UInt8
from rpaug_adapters.droid.read import (
    EXTRINSICS,
    INTRINSICS,
    LANGUAGE,
    TASK,
    TRAJECTORY,
    DroidSource,
    codes,
    depth_file,
)
from rpaug_adapters.shared import cameras
from rpaug_adapters.shared.folders import see_no_pickle, walk
from rpaug_adapters.shared.texts import json_bytes
from rpaug_adapters.video import encode
from rpaug_adapters.video.stream import Video

from rpaug import CameraView, Episode, files

OWN = ("rpaug.json", cameras.NAME, LANGUAGE)  # of the episode that was read
NUMBERED = re.compile(r"\+episode_\d+$")  # what tells copies of one uuid apart
LARGE = (".mp4", ".svo")
SHORTS = {
    "wrist_image_left": "wrist",
    "exterior_image_1_left": "ext1",
    "exterior_image_2_left": "ext2",
}


def write_episode(
    episode: Episode, source: DroidSource, work: Path, key: str
) -> tuple[dict[str, bytes], list[str]]:
    """Fill a folder; returns the files to lay beside it, and what could not be had, in words.

    Raises Unsupported where a video cannot be encoded.
    """
    edited = [
        name for name, view in episode.views.items() if view.rgb is not source.views[name].rgb
    ]
    videos = {video.path: video for name in edited for video, _ in source.eyes[name].shown}
    raw = {f"{source.eyes[name].serial}.svo" for name in edited}
    left = {*videos, source.metadata, *(source.folder / name for name in OWN)}
    for here, _, names in walk(source.folder):
        for path in (here / name for name in names if name not in raw):
            if path not in left:
                see_no_pickle(path)
                target = work / path.relative_to(source.folder)
                target.parent.mkdir(parents=True, exist_ok=True)
                _keep(path, target)
    said: list[str] = []
    for path, video in videos.items():
        target = work / path.relative_to(source.folder)
        target.parent.mkdir(parents=True, exist_ok=True)
        said += encode.write(target, video, _shown(episode, source, video))
    for name, view in episode.views.items():
        _lay_depth(source, name, view, work)
    moved = _lay_trajectory(episode, source, work / TRAJECTORY)
    extra = _metadata(episode, source, key, moved)
    if source.annotated:
        extra[LANGUAGE] = json_bytes(
            {f"language_instruction{n}": one for n, one in enumerate(episode.descriptions, 1)}
        )
    extra |= cameras.brought(source.beside)
    rest = {**episode.views, **{name: source.views[name] for name in moved}}
    extra |= cameras.moved(replace(episode, views=rest), source.views, source.beside)
    return extra, said


def _keep(path: Path, target: Path) -> None:
    """A recording linked, where the file system can; other files, which are small, copied."""
    if path.suffix in LARGE:
        try:
            os.link(path.resolve(), target)
            return
        except OSError:
            pass  # another file system
    shutil.copyfile(path, target)


def _shown(
    episode: Episode, source: DroidSource, video: Video
) -> Callable[[int], UInt8[np.ndarray, "h w 3"]]:
    """A video's frames with the changed pixels of its eyes; those after the last step as recorded."""
    held = [
        (name, columns)
        for name, eye in source.eyes.items()
        for other, columns in eye.shown
        if other is video
    ]

    def at(t: int) -> np.ndarray:
        image = video.rgb(t).copy()
        for name, columns in held if t < episode.length else ():
            new, old = episode.views[name].rgb(t), source.views[name].rgb(t)
            image[:, columns] = np.where(
                (new != old).any(-1, keepdims=True), new, image[:, columns]
            )
        return image

    return at


def _lay_depth(source: DroidSource, name: str, view: CameraView, work: Path) -> None:
    """Depth images that changed, in the unit of the recorded ones; what no edit touched keeps its numbers."""
    eye, before = source.eyes[name], source.views[name]
    if eye.depth is None or view.depth is before.depth:
        return
    assert view.depth is not None
    assert before.depth is not None
    for t in range(len(view.camera.cam_to_world)):
        new, old = view.depth(t), before.depth(t)
        path = depth_file(eye.depth, t)
        scaled = np.clip(np.rint(new / np.float32(eye.metres)), 0, np.iinfo(np.uint16).max)
        image = np.where(new == old, codes(path), scaled.astype(np.uint16))
        (work / path.relative_to(source.folder)).write_bytes(files.encode_png(image))


def _lay_trajectory(episode: Episode, source: DroidSource, path: Path) -> set[str]:
    """What an edit changed of the trajectory: the task and cameras. Returns the moved cameras that it holds."""
    moved = {
        name: view.camera
        for name, view in episode.views.items()
        if view.camera is not source.views[name].camera and name in source.placed
    }
    reworded = episode.descriptions != source.words and not source.annotated
    if not moved and not reworded:
        return set()
    with h5py.File(path, "r+") as file:
        if reworded:
            file.attrs[TASK] = episode.instruction
        for name, camera in [*moved.items()]:
            eye = source.eyes[name].name
            if not np.array_equal(camera.K, source.views[name].camera.K):
                if f"{INTRINSICS}/{eye}" not in file or name in source.beside.cameras:
                    del moved[name]  # the side file holds it
                    continue
                file[f"{INTRINSICS}/{eye}"][...] = camera.K
            _lay_pose(file, f"{EXTRINSICS}/{eye}", camera.cam_to_world)
            carried = f"{EXTRINSICS}/{eye}_gripper_offset"
            if carried in file and (gripper := episode.robot.gripper_to_world) is not None:
                _lay_pose(file, carried, np.linalg.inv(gripper) @ camera.cam_to_world)
    return {*moved}


def _lay_pose(file: h5py.File, name: str, track: Float64[np.ndarray, "t 4 4"]) -> None:
    file[name][: len(track)] = np.concatenate([track[:, :3, 3], euler(track[:, :3, :3])], 1)


def euler(turn: Float64[np.ndarray, "t 3 3"]) -> Float64[np.ndarray, "t 3"]:
    """Angles about the fixed x, y and z axes, one after another, in radians: turn = Rz Ry Rx."""
    level = np.hypot(turn[:, 0, 0], turn[:, 1, 0])
    upright = level > 1e-9  # else x and z turn about one axis, and z is put to 0
    x = np.where(
        upright,
        np.arctan2(turn[:, 2, 1], turn[:, 2, 2]),
        np.arctan2(-turn[:, 1, 2], turn[:, 1, 1]),
    )
    z = np.where(upright, np.arctan2(turn[:, 1, 0], turn[:, 0, 0]), 0.0)
    return np.stack([x, np.arctan2(-turn[:, 2, 0], level), z], 1)


def _metadata(episode: Episode, source: DroidSource, key: str, moved: set[str]) -> dict[str, bytes]:
    """The metadata of an episode under its new name, with what an edit changed."""
    if source.metadata is None:
        return {}
    given = dict(source.about)
    if not source.annotated and episode.descriptions != source.words:
        given[TASK] = episode.instruction
    for name in sorted(moved):
        if f"{SHORTS.get(name)}_cam_extrinsics" in given:
            track = episode.views[name].camera.cam_to_world[:1]
            pose = np.concatenate([track[:, :3, 3], euler(track[:, :3, :3])], 1)[0]
            given[f"{SHORTS[name]}_cam_extrinsics"] = pose.tolist()
    return renamed(given, source.metadata, key)


def renamed(given: Mapping[str, Any], path: Path, key: str) -> dict[str, bytes]:
    """Metadata of a file under a new key: an uuid of its own, and paths below the lab's folder that lead there."""
    made, name = dict(given), PurePosixPath(key).name
    uuid = NUMBERED.sub("", path.stem.removeprefix("metadata_"))
    made["uuid"] = f"{uuid}+{name}" if NUMBERED.fullmatch(f"+{name}") else uuid
    for field, value in given.items():
        if field.endswith("_path") and isinstance(value, str):
            parts = PurePosixPath(value).parts
            deep = 1 if field == "hdf5_path" else 3
            made[field] = PurePosixPath(*parts[: -deep - 1], name, *parts[-deep:]).as_posix()
    return {f"metadata_{made['uuid']}.json": json_bytes(made)}
