"""Ego4D videos, and any other: one view called `ego`, moving, its place unknown until it is worked out.

`<root>/[v1|v2]/{full_scale,clips}/<uid>.mp4`, `ego4d.json` there or above, `annotations/`; or just videos in folders,
or one file. A `clips.yaml` in the folder of the videos says what to cut. What rpaug writes is `<key>/video.mp4` with
its annotations and report; at the end of a run videos become `<key>.mp4`, the annotations Ego4D's own files. Traps:

- no camera poses are recorded, and none are made up: cameras are `assumed` until they are worked out from the images;
- clips have an uid of their own and hold part of a video, whose narrations are timed by the video;
- rates vary, and phones store portrait videos on their side: frames keep their times and the header its rotation.
"""

import json
import os
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from rpaug_adapters import _cameras, _ego4d_encode, _ego4d_notes
from rpaug_adapters._ego4d_notes import Notes
from rpaug_adapters._ego4d_video import Video
from rpaug_adapters._folders import natural
from rpaug_adapters._texts import read_yaml

from rpaug import Adapter, BadInput, CameraView, Episode, Robot, Side, Unsupported
from rpaug.core.files import atomic_folder, write_atomic

ENDINGS = (".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi")
STAGED, SAID, CUTS = "video", "annotations.json", "clips.yaml"
MOST = 10**6  # values in `clips.yaml`
VIEW = "ego"
PARTS = ("full_scale", "clips")
FOREIGN = ("meta/info.json",)  # datasets that hold videos and are not made of them


class Cut(BaseModel):
    """A part of a video: between two times in seconds, or around a narration or FHO action."""

    model_config = ConfigDict(extra="forbid")
    video: str = Field(description="its file's name, without the ending")
    start: float | None = Field(default=None, ge=0)
    end: float | None = Field(default=None, gt=0)
    annotation: str | None = Field(default=None, description="annotation_uid of a narration")
    margin: float = Field(default=2.0, gt=0, description="seconds on both sides of an annotation")


class Cuts(BaseModel):
    """All of `clips.yaml`."""

    model_config = ConfigDict(extra="forbid")
    version: Literal[1] = 1
    clips: list[Cut]


@dataclass(frozen=True)
class VideoSource:
    """Where an episode came from: the video, its view as read, and what is said of it."""

    video: Video
    view: CameraView
    notes: Notes
    beside: _cameras.Beside
    descriptions: tuple[str, ...]


class Ego4D(Adapter):
    """Reads and writes videos of one camera that someone wears or carries."""

    name: ClassVar[str] = "ego4d"
    loose: ClassVar[bool] = True

    def episodes(self, root: Path) -> Sequence[str]:
        if root.is_file():
            return [root.stem] if root.suffix.lower() in ENDINGS else []
        keys = []
        for folder, subfolders, files in os.walk(root):
            here = Path(folder)
            if any((here / name).exists() for name in FOREIGN):
                subfolders.clear()
                continue
            subfolders[:] = sorted(name for name in subfolders if not name.startswith("."))
            cuts = _cuts(here)
            for name in sorted(files):
                path = here / name
                if path.suffix.lower() not in ENDINGS or name.startswith("."):
                    continue
                at = here if path.stem == STAGED and here != root else path.with_suffix("")
                key = at.relative_to(root).as_posix()
                mine = [n for n, cut in enumerate(cuts) if cut.video == path.stem]
                keys += [f"{key}/cut_{n}" for n in mine] or [key]
        return sorted(set(keys), key=natural)

    def read(self, root: Path, key: str) -> Episode:
        path, cut = _place(root, key)
        whole = Video(path)
        notes = _notes(root, path)
        video = whole if cut is None else _part(whole, notes, *cut)
        if cut is not None:
            times = whole.facts.seconds
            last = times[video.first + video.length - 1]
            stop = float(last) + 1e-6
            start = float(times[video.first])
            notes = notes.cut(start, stop, video.first, video.first + video.length)
        folders = (root / key, path.parent)
        beside = _cameras.load(folders)
        width, height = video.size
        camera = _cameras.camera(beside, VIEW, (width, height), video.length, {})
        boxes = {t: of for t, of in notes.boxes.items() if 0 <= t < video.length}
        view = CameraView(camera, video.rgb, hands=boxes)
        still = np.zeros((video.length, 0))
        at = video.facts.seconds[video.first : video.first + video.length]
        robot = Robot(still, still, None, None, {"seconds": (at - at[0])[:, None]})
        stated = notes.descriptions
        source = VideoSource(video, view, notes, beside, stated)
        return Episode(key, {VIEW: view}, robot, stated, video.length, source)

    def write(self, episode: Episode, root: Path, key: str, side: Side) -> None:
        recorded = episode.source
        if not isinstance(recorded, VideoSource):
            reason = "the layout holds videos as they were recorded, and this is none"
            raise Unsupported(f"{episode.key}: {reason}")
        if any((root / key).with_suffix(ending).exists() for ending in ENDINGS):
            raise BadInput(root / key, "output", found="an episode", expected="a key that is free")
        view, video = episode.views[VIEW], recorded.video
        with atomic_folder(root / key) as work:
            path = work / (STAGED + video.path.suffix.lower())
            if view.rgb is recorded.view.rgb and video.whole:
                shutil.copyfile(video.path, path)
            else:
                _ego4d_encode.write(path, video, view.rgb)
            stated = recorded.notes.described()
            if episode.descriptions != recorded.descriptions:
                stated["narrations"] = _ego4d_notes.told_anew(recorded.notes, episode.descriptions)
            files = {SAID: _json(stated)}
            if _measured(view, recorded):
                files |= _cameras.moved(episode, {VIEW: recorded.view}, recorded.beside)
            for name, data in {**files, **side()}.items():
                (work / name).write_bytes(data)

    def key_at(self, like: str, index: int) -> str:
        parts = PurePosixPath(like).parts
        above = parts[:-2] if re.fullmatch(r"cut_\d+", parts[-1]) else parts[:-1]
        if above and above[-1] == "full_scale" and above != parts[:-1]:
            above = (*above[:-1], "clips")
        return PurePosixPath(*above, f"video_{index}").as_posix()

    def finish(self, source: Path, target: Path) -> None:
        """Videos out of their folders, and the annotations of each folder of videos in Ego4D's own files."""
        homes: dict[Path, list[str]] = {}
        for key in self.episodes(target):
            folder = target / key
            for path in folder.glob(f"{STAGED}.*"):
                os.replace(path, folder.with_suffix(path.suffix))
            homes.setdefault(_home(target, folder), []).append(key)
        for home, keys in homes.items():
            given = [
                (Path(key).name, _ego4d_notes.own(target / key / SAID), _facts(target, key))
                for key in keys
                if (target / key / SAID).is_file()
            ]
            for name, held in _ego4d_notes.merged(given).items():
                write_atomic(home / name, _json(held))


def _place(root: Path, key: str) -> tuple[Path, tuple[Path, int] | None]:
    """The file of an episode, and which cut of it. Raises BadInput."""
    if root.is_file():
        return root, None
    for held in (root / key / STAGED, root / key):
        for ending in ENDINGS:
            for path in (
                held.with_name(held.name + ending),
                held.with_name(held.name + ending.upper()),
            ):
                if path.is_file():
                    return path, None
    above, _, last = key.rpartition("/")
    if above and re.fullmatch(r"cut_\d+", last):
        path, _ = _place(root, above)
        return path, (path.parent, int(last.removeprefix("cut_")))
    raise BadInput(root / key, "video", found="none", expected="a video file")


def _cuts(folder: Path) -> list[Cut]:
    """What `clips.yaml` in a folder asks for. Raises BadInput."""
    path = folder / CUTS
    if not path.is_file():
        return []
    return read_yaml(path, Cuts, MOST).clips


def _part(whole: Video, notes: Notes, folder: Path, number: int) -> Video:
    """The frames that a cut asks for: those shown from its start on and before its end. Raises BadInput."""
    cut = _cuts(folder)[number]
    where, seconds = folder / CUTS, whole.facts.seconds
    start, end = cut.start, cut.end
    if cut.annotation is not None:
        at = notes.when(cut.annotation)
        if at is None:
            found = cut.annotation
            raise BadInput(
                where, f"clips.{number}.annotation", found=found, expected="one of its narrations"
            )
        start, end = max(0.0, at[0] - cut.margin), at[1] + cut.margin
    first = int(np.searchsorted(seconds, (start or 0.0) - 1e-6))
    stop = len(seconds) if end is None else int(np.searchsorted(seconds, end - 1e-6))
    if stop <= first:
        found = f"no frame between {start} and {end} s of {seconds[-1]:.2f}"
        raise BadInput(where, f"clips.{number}", found=found, expected="a part of the video")
    return Video(whole.path, first, stop)


def _notes(root: Path, path: Path) -> Notes:
    """What is said of a video: in its own file, as rpaug writes it, or in Ego4D's."""
    for stated in (path.parent / SAID, path.with_suffix("") / SAID):
        if stated.is_file():
            return _ego4d_notes.own(stated)
    top = root.parent if root.is_file() else root
    return _ego4d_notes.library(_home(top, path)).of(path.stem)


def _home(root: Path, path: Path) -> Path:
    """The folder of a version: above `full_scale` or `clips`, else the one that the video is in."""
    inside = path.relative_to(root).parts[:-1]
    for depth, name in enumerate(inside):
        if name in PARTS:
            return root.joinpath(*inside[:depth])
    return path.parent


def _measured(view: CameraView, recorded: VideoSource) -> bool:
    """Whether the view's camera is known by now and was not as recorded."""
    return view.camera is not recorded.view.camera and not view.camera.assumed


def _facts(root: Path, key: str) -> dict[str, Any]:
    """What `ego4d.json` says of a video file."""
    path, _ = _place(root, key)
    given = Video(path).facts
    seconds = given.seconds
    rate = float(given.rate) if given.rate else 0.0
    return {
        "duration_sec": float(seconds[-1]) + (1 / rate if rate else 0.0),
        "video_metadata": {
            "fps": rate,
            "num_frames": len(seconds),
            "video_codec": given.codec,
            "display_resolution_width": given.width,
            "display_resolution_height": given.height,
        },
        "synthetic": True,
    }


def _json(value: Any) -> bytes:
    return (json.dumps(value, indent=1, ensure_ascii=False) + "\n").encode()
