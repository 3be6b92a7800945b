"""An adapter from outside: episodes as folders of PNG files beside one `episode.json`.

NAME0/episode.json           instruction, cameras (K, cam_to_world of each frame), joints, gripper_open, rate; and
                             whatever else it holds, which comes back as it was
NAME0/front/rgb_0000.png     8 bits
NAME0/front/depth_0000.png   16 bits, millimetres; 0 where nothing is, or farther than 65.5 m
NAME0/front/ids_0000.png     16 bits, instance ids; 0 for none
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rpaug import Adapter, BadInput, Camera, CameraView, Episode, Robot, Side, Unsupported, files

FACTS = "episode.json"
MILLIMETRE = np.float32(0.001)
MOST = 2**16 - 1
KINDS = ("rgb", "depth", "ids")


@dataclass(frozen=True)
class Recorded:
    """What an episode was read from: its folder, what `episode.json` says, its views."""

    folder: Path
    facts: Mapping[str, Any]
    views: Mapping[str, CameraView]


class Frames(Adapter):
    """Folders of PNG files with an `episode.json`."""

    name = "frames"

    def episodes(self, root: Path) -> Sequence[str]:
        found = (path.parent.relative_to(root) for path in root.rglob(FACTS))
        keys = (one.as_posix() for one in found if not any(p.startswith(".") for p in one.parts))
        return sorted((key for key in keys if key != "."), key=files.natural)

    def read(self, root: Path, key: str) -> Episode:
        folder = root / key
        facts = _facts(folder / FACTS)
        length = _length(folder, facts)
        views = {name: _view(folder, name, said, length) for name, said in facts["cameras"].items()}
        joints = _rows(folder, facts, "joints", length)
        opening = _rows(folder, facts, "gripper_open", length)
        robot = Robot(
            np.zeros((length, 0)) if joints is None else joints,
            np.zeros((length, 0)),
            None,
            opening,
        )
        return Episode(
            key,
            views,
            robot,
            (facts["instruction"],),
            length,
            source=Recorded(folder, facts, views),
            rate=facts.get("rate"),
        )

    def write(self, episode: Episode, root: Path, key: str, side: Side) -> None:
        recorded = episode.source if isinstance(episode.source, Recorded) else None
        with files.atomic_folder(root / key) as work:
            if recorded is not None:
                _pass_on_the_rest(recorded, episode, work)
            facts = _edited_facts(episode, recorded)
            if recorded is None or facts != recorded.facts:
                (work / FACTS).write_text(json.dumps(facts))
            else:
                files.pass_on(recorded.folder / FACTS, work / FACTS)
            for name, view in episode.views.items():
                (work / name).mkdir(exist_ok=True)
                for t in range(episode.length):
                    _write_frame(work, name, view, recorded, t)
            for name, data in side().items():
                (work / name).write_bytes(data)

    def key_at(self, like: str, index: int) -> str:
        return re.sub(r"\d*$", str(index), like, count=1)

    def untouched(self, episode: Episode, edited_words: bool) -> Mapping[str, bytes]:
        rest = {
            k: v for k, v in episode.source.facts.items() if k not in ("instruction", "cameras")
        }
        return {FACTS: json.dumps(rest, sort_keys=True).encode()}


def _facts(path: Path) -> dict[str, Any]:
    """What `episode.json` says, with all that an episode needs."""
    try:
        facts = json.loads(files.read_bytes(path))
    except ValueError as error:
        raise BadInput(path, "JSON", found=str(error), expected="an object") from None
    cameras = facts.get("cameras") if isinstance(facts, dict) else None
    if not isinstance(cameras, dict) or not cameras:
        raise BadInput(path, "cameras", found=cameras, expected="at least one by its name")
    for name, said in cameras.items():
        if not isinstance(said, dict) or "/" in name or name.startswith("."):
            raise BadInput(path, f"cameras {name!r}", found=said, expected="K and cam_to_world")
    if not isinstance(facts.get("instruction"), str):
        raise BadInput(path, "instruction", found=facts.get("instruction"), expected="a sentence")
    return facts


def _length(folder: Path, facts: Mapping[str, Any]) -> int:
    counts = {name: len(list((folder / name).glob("rgb_*.png"))) for name in facts["cameras"]}
    if len(set(counts.values())) != 1 or 0 in counts.values():
        raise BadInput(folder, "rgb_*.png", found=counts, expected="the same number in each camera")
    return next(iter(counts.values()))


def _numbers(path: Path, name: str, value: Any, shape: tuple[int, ...]) -> np.ndarray:
    """A list of lists as an array; -1 in the shape is any number."""
    try:
        array = np.array(value, np.float64)
    except (TypeError, ValueError):
        array = np.array(np.nan)
    fits = array.ndim == len(shape) and all(
        w in (-1, n) for n, w in zip(array.shape, shape, strict=True)
    )
    if not fits or not np.isfinite(array).all():
        raise BadInput(path, name, found=f"shape {array.shape}", expected=f"finite numbers {shape}")
    return array


def _rows(folder: Path, facts: Mapping[str, Any], name: str, length: int) -> np.ndarray | None:
    if name not in facts:
        return None
    shape = (length, -1) if name == "joints" else (length,)
    return _numbers(folder / FACTS, name, facts[name], shape)


def _view(folder: Path, name: str, said: Mapping[str, Any], length: int) -> CameraView:
    """A camera whose files are seen to be there and of one size; each is decoded when it is asked for."""
    path = folder / FACTS
    kinds = [kind for kind in KINDS if _file(folder, name, kind, 0).exists()]
    sizes = {
        files.check_image(where, files.read_bytes(where))
        for where in (_file(folder, name, "rgb", t) for t in range(length))
    }
    if len(sizes) != 1:
        raise BadInput(folder / name, "rgb", found=f"sizes {sizes}", expected="one size")
    ((width, height),) = sizes
    for kind in kinds[1:]:
        for t in range(length):
            _codes(_file(folder, name, kind, t), (height, width))
    camera = Camera(
        _numbers(path, f"K of {name}", said.get("K"), (3, 3)),
        _numbers(path, f"cam_to_world of {name}", said.get("cam_to_world"), (length, 4, 4)),
        width,
        height,
    )
    read = {kind: partial(_image, folder, name, kind, (height, width)) for kind in kinds}
    return CameraView(camera, read["rgb"], read.get("depth"), read.get("ids"))


def _file(folder: Path, camera: str, kind: str, t: int) -> Path:
    return folder / camera / f"{kind}_{t:04d}.png"


def _image(folder: Path, camera: str, kind: str, size: tuple[int, int], t: int) -> np.ndarray:
    path = _file(folder, camera, kind, t)
    if kind == "rgb":
        return files.decode_image(path)
    codes = _codes(path, size)
    return codes * MILLIMETRE if kind == "depth" else codes.astype(np.int32)


def _codes(path: Path, size: tuple[int, int]) -> np.ndarray:
    codes = cv2.imdecode(np.frombuffer(files.read_bytes(path), np.uint8), cv2.IMREAD_UNCHANGED)
    if codes is None or codes.dtype != np.uint16 or codes.shape != size:
        found = "no image" if codes is None else f"{codes.dtype} {codes.shape}"
        raise BadInput(path, "pixels", found=found, expected=f"uint16 {size}")
    return codes


def _pass_on_the_rest(recorded: Recorded, episode: Episode, work: Path) -> None:
    """All that lies beside our images and `episode.json`; an earlier report stays behind."""
    for path in sorted(recorded.folder.rglob("*")):
        place = path.relative_to(recorded.folder)
        ours = place.parts[0] in episode.views and re.match(r"(rgb|depth|ids)_\d+\.png$", path.name)
        if path.is_dir() or ours or str(place) == FACTS or place.name.startswith("rpaug"):
            continue
        (work / place).parent.mkdir(parents=True, exist_ok=True)
        files.pass_on(path, work / place)


def _edited_facts(episode: Episode, recorded: Recorded | None) -> dict[str, Any]:
    """What `episode.json` says now: of a recorded one only instruction and cameras may be new."""
    cameras = dict(recorded.facts["cameras"]) if recorded else {}
    for name, view in episode.views.items():
        if recorded is None or view.camera is not recorded.views[name].camera:
            new = {"K": view.camera.K.tolist(), "cam_to_world": view.camera.cam_to_world.tolist()}
            cameras[name] = {**cameras.get(name, {}), **new}
    facts: dict[str, Any] = {"joints": episode.robot.joint_positions.tolist()}
    if episode.robot.gripper_open is not None:
        facts["gripper_open"] = episode.robot.gripper_open.tolist()
    if episode.rate is not None:
        facts["rate"] = episode.rate
    facts = dict(recorded.facts) if recorded else facts
    return {**facts, "instruction": episode.instruction, "cameras": cameras}


def _write_frame(
    work: Path, name: str, view: CameraView, recorded: Recorded | None, t: int
) -> None:
    """The images of a camera at t: the recorded file where nothing changed, so that its bytes stay."""
    for kind in KINDS:
        new = getattr(view, kind)
        old = getattr(recorded.views[name], kind) if recorded else None
        if new is None:
            continue
        target = _file(work, name, kind, t)
        if old is not None and (new is old or np.array_equal(new(t), old(t))):
            files.pass_on(_file(recorded.folder, name, kind, t), target)
        else:
            target.write_bytes(_encoded(kind, new(t), target))


def _encoded(kind: str, image: np.ndarray, target: Path) -> bytes:
    if kind == "rgb":
        return files.encode_png(image)
    if kind == "depth":
        codes = np.rint(np.where(np.isfinite(image), image, 0) / MILLIMETRE)
        image = np.where(codes <= MOST, codes, 0)
    elif image.max() > MOST:
        raise Unsupported(f"{target.name}: id {image.max()}; masks here hold up to {MOST}")
    return cv2.imencode(".png", image.astype(np.uint16))[1].tobytes()
