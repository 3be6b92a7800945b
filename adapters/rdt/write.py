"""Writing an episode for RDT: what was recorded with only what changed new, or, from another source, all of it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from jaxtyping import Float64, UInt8
from rpaug_adapters.rdt.read import IMAGES, QPOS, TEXTS, WORDS, RDTSource
from rpaug_adapters.shared import cameras, fresh
from rpaug_adapters.shared.hdf5 import dataset, opened
from rpaug_adapters.shared.texts import json_bytes

from rpaug import CameraView, Episode, Unsupported, files

HIGH, LEFT, RIGHT = "cam_high", "cam_left_wrist", "cam_right_wrist"
EXTERNAL = ("front", "cam_high", "third_person", "image", "image_0", "overhead")  # best first
HAND = ("wrist", "hand", "gripper")  # in the names of cameras that ride on it
DEPTH = "observations/depth"
JOINTS = 6  # of one arm in RDT's stock reader, and then its gripper
QPOS_OPEN, ACTION_OPEN = 4.7888, 13.9231  # what that reader divides the right gripper by
UNIFIED, ARM, GRIPPER, EEF = 128, 0, 10, 30  # RDT's vector (configs/state_vec.py), right arm


def write_episode(episode: Episode, recorded: RDTSource | None, path: Path) -> dict[str, bytes]:
    """Write the HDF5 file; returns the files to lay beside it."""
    if recorded is None:
        _fresh(episode, path)
        return {WORDS: json_bytes(_given(episode)), cameras.NAME: _beside(episode)}
    _edited(episode, recorded, path)
    words = recorded.words
    if episode.descriptions != recorded.descriptions:
        words = _reworded(recorded, episode)
    extra = {} if words is None else {WORDS: json_bytes(words)}
    extra |= cameras.brought(recorded.beside)
    return extra | cameras.moved(episode, recorded.views, recorded.beside)


def _edited(episode: Episode, recorded: RDTSource, path: Path) -> None:
    new: dict[str, Any] = {}
    for name, view in episode.views.items():
        before = recorded.views[name]
        if view.rgb is not before.rgb:
            images = _images(view, before, recorded.encoded[name], episode.length)
            new[recorded.images[name]] = images
        if name in recorded.depths and view.depth is not before.depth:
            place, metres = recorded.depths[name]
            assert view.depth is not None
            new[place] = [view.depth(t) / np.float32(metres) for t in range(episode.length)]
    if not new:
        files.pass_on(recorded.path, path)
        return
    with opened(recorded.path) as source, h5py.File(path, "w") as target:
        _copy(source, target, "", new)
        for name, values in new.items():
            _store(dataset(recorded.path, source, name), target, name, values)
        if "compress_len" in target:  # ALOHA's lengths of padded images: none may cut one off
            widest = [d.shape[1] for n, d in _padded(target)]
            target["compress_len"][...] = max(widest, default=0)


def _padded(target: h5py.File) -> list[tuple[str, h5py.Dataset]]:
    return [(name, held) for name, held in target[IMAGES].items() if held.ndim == 2]


def _images(
    view: CameraView, before: CameraView, encoded: list[bytes] | None, length: int
) -> list[bytes] | list[UInt8[np.ndarray, "h w 3"]]:
    if encoded is None:
        return [view.rgb(t) for t in range(length)]
    return [
        encoded[t] if np.array_equal(image := view.rgb(t), before.rgb(t)) else jpeg(image)
        for t in range(length)
    ]


def jpeg(image: UInt8[np.ndarray, "h w 3"]) -> bytes:
    """A JPEG whose decoding by OpenCV, taken for RGB as RDT does, is the image."""
    return files.encode_jpeg(image[..., ::-1])


def _copy(source: h5py.Group, target: h5py.Group, at: str, but: dict[str, Any]) -> None:
    """Everything in a group but some datasets, with attributes."""
    for name, value in source.attrs.items():
        target.attrs[name] = value
    for name in source:
        place = f"{at}{name}"
        if not isinstance(source.get(name, getlink=True), h5py.HardLink):
            continue  # a link leads out of the episode
        if isinstance(source[name], h5py.Group):
            _copy(source[name], target.create_group(name), f"{place}/", but)
        elif place not in but:
            source.copy(name, target)


def _store(like: h5py.Dataset, target: h5py.File, name: str, values: list[Any]) -> None:
    """New values as the recorded dataset stored its own."""
    if not isinstance(values[0], bytes):
        array = np.stack(values)
        if like.dtype.kind in "iu":
            most = np.iinfo(like.dtype).max
            array = np.clip(np.rint(array), 0, most).astype(like.dtype)
        made = target.create_dataset(
            name, data=array.astype(like.dtype), chunks=like.chunks, compression=like.compression
        )
    elif like.ndim == 2:
        width = max(like.shape[1], *(len(value) for value in values))
        rows = np.zeros((len(values), width), np.uint8)
        for row, value in zip(rows, values, strict=True):
            row[: len(value)] = np.frombuffer(value, np.uint8)
        made = target.create_dataset(name, data=rows)
    elif like.dtype.kind == "S":
        made = target.create_dataset(name, data=np.array(values, "S"))
    else:
        made = target.create_dataset(name, (len(values),), dtype=like.dtype)
        text = h5py.check_string_dtype(like.dtype) is not None
        for t, value in enumerate(values):
            made[t] = value if text else np.frombuffer(value, np.uint8)
    for key, value in like.attrs.items():
        made.attrs[key] = value


def _fresh(episode: Episode, path: Path) -> None:
    """RDT's layout from another source: actions are the next step's joints, as its data has them."""
    robot = episode.robot
    if not robot.joint_positions.shape[1]:
        raise Unsupported(f"{episode.key}: RDT needs joint positions; the source names none")
    following = np.minimum(np.arange(episode.length) + 1, episode.length - 1)
    opening = np.zeros(episode.length) if robot.gripper_open is None else robot.gripper_open
    views = _slots(episode)
    with h5py.File(path, "w") as file:
        file[QPOS] = _arms(robot.joint_positions, opening, QPOS_OPEN)
        file["action"] = _arms(robot.joint_positions[following], opening[following], ACTION_OPEN)
        state, indicator = _unified(episode, opening)
        file["unified/state"], file["unified/action"] = state, state[following]
        file["unified/indicator"] = indicator
        for name, track in fresh.tracks(episode).items():
            file[fresh.RECORDED + name] = track
        size = next(iter(episode.views.values())).camera
        blank = np.zeros((size.height, size.width, 3), np.uint8)
        for name, view in views.items():
            images = [jpeg(blank if view is None else view.rgb(t)) for t in range(episode.length)]
            file.create_dataset(f"{IMAGES}/{name}", data=np.array(images, "S"))
            if view is not None and view.depth is not None:
                depth = np.stack([view.depth(t) for t in range(episode.length)])
                file.create_dataset(f"{DEPTH}/{name}", data=depth, compression="gzip")


def _slots(episode: Episode) -> dict[str, CameraView | None]:
    """RDT's three cameras, None where there is no such camera, and all others by their own names."""
    views = dict(episode.views)
    found: dict[str, CameraView | None] = {HIGH: None, LEFT: None, RIGHT: None}
    for name in [name for name in found if name in views]:
        found[name] = views.pop(name)
    hands = [name for name in views if any(word in name for word in HAND)]
    if found[RIGHT] is None and hands:
        found[RIGHT] = views.pop(hands[0])
    outside = [name for name in (*EXTERNAL, *views) if name in views and name not in hands]
    if found[HIGH] is None and outside:
        found[HIGH] = views.pop(outside[0])
    return found | views


def _arms(
    joints: Float64[np.ndarray, "t j"], opening: Float64[np.ndarray, "t"], scale: float
) -> Float64[np.ndarray, "t 14"]:
    """Two arms of six joints and a gripper: a single arm is the right one; a seventh joint is in `unified` alone."""
    if joints.shape[1] == 2 * (JOINTS + 1):
        return joints
    row = np.zeros((len(joints), 2 * (JOINTS + 1)))
    kept = joints[:, :JOINTS]
    row[:, JOINTS + 1 : JOINTS + 1 + kept.shape[1]] = kept
    row[:, -1] = opening * scale
    return row


def _unified(
    episode: Episode, opening: Float64[np.ndarray, "t"]
) -> tuple[Float64[np.ndarray, "t 128"], Float64[np.ndarray, "128"]]:
    """RDT's vector of the right arm: joints, gripper, and the gripper's place and turn (6 numbers: two columns)."""
    robot = episode.robot
    row, known = np.zeros((episode.length, UNIFIED)), np.zeros(UNIFIED)
    joints = robot.joint_positions[:, :GRIPPER]
    row[:, ARM : ARM + joints.shape[1]], known[ARM : ARM + joints.shape[1]] = joints, 1
    row[:, GRIPPER], known[GRIPPER] = opening, robot.gripper_open is not None
    if robot.gripper_to_world is not None:
        row[:, EEF : EEF + 3] = robot.gripper_to_world[:, :3, 3]
        turn = robot.gripper_to_world[:, :3, :2]
        row[:, EEF + 3 : EEF + 9], known[EEF : EEF + 9] = turn.swapaxes(1, 2).reshape(-1, 6), 1
    return row, known


def _beside(episode: Episode) -> bytes:
    """What `cameras.yaml` says, so that the file can be read with all it had: by the names that its cameras had, and
    without the black ones."""
    images = {}
    for name, view in _slots(episode).items():
        if view is None:
            continue
        own = next(one for one, held in episode.views.items() if held is view)
        images[own] = f"{IMAGES}/{name}"

    def depth(name: str) -> str:
        return f"{DEPTH}/{images[name.removesuffix('_depth')].rpartition('/')[2]}"

    bare = {name: replace(view, ids=None) for name, view in episode.views.items()}  # no place here
    more = {"images": images, "views": [*images]}
    without = replace(episode, views=bare)
    return fresh.beside(without, lambda name: fresh.RECORDED + name, depth, more)


def _reworded(recorded: RDTSource, episode: Episode) -> dict[str, Any]:
    """The instructions in the forms that they have, each text with its own new words."""
    old, new = recorded.descriptions, episode.descriptions
    if recorded.words is None or len(old) != len(new):  # no edit of ours
        return _given(episode)
    now = dict(zip(old, new, strict=True))

    def follow(value: Any) -> Any:
        if isinstance(value, list):
            return [follow(one) for one in value]
        return now.get(value, value) if isinstance(value, str) else value

    return {
        name: follow(value) if name in TEXTS else value for name, value in recorded.words.items()
    }


def _given(episode: Episode) -> dict[str, Any]:
    """The instruction in RDT's three forms; no form is empty, for its reader draws from each."""
    every = list(episode.descriptions) or [episode.instruction]
    return {"instruction": episode.instruction, TEXTS[1]: every, TEXTS[2]: every}
