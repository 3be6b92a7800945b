"""Videos of one camera, Ego4D's among them: one view called `ego`, moving, its place unknown until it is worked out.

`<root>/[v1|v2]/{full_scale,clips}/<uid>.mp4`, `ego4d.json` there or above, `annotations/`; or just videos in folders,
or one file. A `clips.yaml` in the folder of the videos says what to cut. What rpaug writes is `<key>/video.mp4` with
its annotations and report; at the end of a run videos become `<key>.mp4`, the annotations Ego4D's own files. Traps:

- no camera poses are recorded, and none are made up: cameras are `assumed` until they are worked out from the images;
- clips have an uid of their own and hold part of a video, whose narrations are timed by the video;
- rates vary, and phones store portrait videos on their side: frames keep their times and the header its rotation.
"""

import os
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import ClassVar

import numpy as np
from rpaug_adapters.shared import cameras
from rpaug_adapters.shared.folders import walk, write_files
from rpaug_adapters.shared.texts import json_bytes
from rpaug_adapters.video import cuts, ego4d, encode
from rpaug_adapters.video.ego4d import Notes
from rpaug_adapters.video.stream import Video

from rpaug import Adapter, BadInput, CameraView, Episode, Robot, Side, Unsupported, files

ENDINGS = (".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi")
STAGED, ANNOTATIONS = "video", "annotations.json"
VIEW = "ego"
BROKEN = "the last {} frames of the video do not decode and are left out"
FOREIGN = ("meta/info.json",)  # datasets that hold videos and are not made of them


@dataclass(frozen=True)
class VideoSource:
    """Where an episode came from: the video, its view as read, and what is said of it."""

    video: Video
    view: CameraView
    notes: Notes
    beside: cameras.Beside
    descriptions: tuple[str, ...]


class Videos(Adapter):
    """Reads and writes videos of one camera that someone wears or carries."""

    name: ClassVar[str] = "video"
    gathers: ClassVar[bool] = True
    loose: ClassVar[bool] = True

    def episodes(self, root: Path) -> Sequence[str]:
        if root.is_file():
            return [root.stem] if root.suffix.lower() in ENDINGS else []
        keys = []
        for here, subfolders, names in walk(root):
            if any((here / name).exists() for name in FOREIGN):
                subfolders.clear()
                continue
            files.see_inside(root, here / cuts.NAME)
            parts = cuts.load(here, names)
            for name in sorted(names):
                path = here / name
                if path.suffix.lower() not in ENDINGS or name.startswith("."):
                    continue
                at = here if path.stem == STAGED and here != root else path.with_suffix("")
                key = at.relative_to(root).as_posix()
                mine = [n for n, cut in enumerate(parts) if cut.video == path.stem]
                keys += [f"{key}/cut_{n}" for n in mine] or [key]
        return sorted(set(keys), key=files.natural)

    def read(self, root: Path, key: str) -> Episode:
        path, cut = _place(root, key)
        files.see_inside(root, path)
        whole = Video(path)
        notes = _notes(root, path)
        video = whole if cut is None else cuts.part(whole, notes, *cut)
        if cut is not None:
            times = whole.facts.seconds
            last = times[video.first + video.length - 1]
            stop = float(last) + 1e-6
            start = float(times[video.first])
            notes = notes.cut(start, stop, video.first, video.first + video.length)
        folders = (root / key, path.parent)
        beside = cameras.load(_top(root), folders)
        width, height = video.size
        camera = cameras.camera(beside, VIEW, (width, height), video.length, {})
        boxes = {t: of for t, of in notes.boxes.items() if 0 <= t < video.length}
        view = CameraView(camera, video.rgb, hands=boxes)
        still = np.zeros((video.length, 0))
        at = video.facts.seconds[video.first : video.first + video.length]
        robot = Robot(still, still, None, None, {"seconds": (at - at[0])[:, None]})
        stated = notes.descriptions
        source = VideoSource(video, view, notes, beside, stated)
        broken = video.facts.broken
        unread = (BROKEN.format(broken),) if broken and video.reaches_end else ()
        return Episode(key, {VIEW: view}, robot, stated, video.length, source, unread=unread)

    def write(self, episode: Episode, root: Path, key: str, side: Side) -> None:
        recorded = episode.source
        if not isinstance(recorded, VideoSource):
            reason = "the layout holds videos as they were recorded, and this is none"
            raise Unsupported(f"{episode.key}: {reason}")
        if any((root / key).with_suffix(ending).exists() for ending in ENDINGS):
            raise BadInput(root / key, "output", found="an episode", expected="a key that is free")
        view, video = episode.views[VIEW], recorded.video
        with files.atomic_folder(root / key) as work:
            path, said = work / (STAGED + video.path.suffix.lower()), ()
            if view.rgb is recorded.view.rgb and video.whole:
                files.pass_on(video.path, path)
            else:
                said = encode.write(path, video, view.rgb)
            stated = recorded.notes.described()
            if episode.descriptions != recorded.descriptions:
                stated["narrations"] = ego4d.reworded(recorded.notes, episode.descriptions)
            extra = {ANNOTATIONS: json_bytes(stated)}
            if _is_measured(view, recorded):
                extra |= cameras.moved(episode, {VIEW: recorded.view}, recorded.beside)
            write_files(work, {**extra, **side(*said)})

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
            homes.setdefault(ego4d.home_of(target, folder), []).append(key)
        for home, keys in homes.items():
            given = [
                (Path(key).name, ego4d.own(stated), Video(_place(target, key)[0]))
                for key in keys
                if (stated := target / key / ANNOTATIONS).is_file()
            ]
            like = ego4d.library(source, source / home.relative_to(target))
            for name, held in ego4d.merged(given, like).items():
                files.write_atomic(home / name, json_bytes(held))

    def scatter(self, root: Path, spoilt: Collection[Path]) -> None:
        """Videos back into their folders; Ego4D's own files are made from those again."""
        for key in self.episodes(root):
            path, _ = _place(root, key)
            if path in spoilt:
                path.unlink()
            elif path.parent != root / key:
                (root / key).mkdir(exist_ok=True)
                os.replace(path, root / key / (STAGED + path.suffix))


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


def _top(root: Path) -> Path:
    """The folder of a dataset, also of a single video."""
    return root.parent if root.is_file() else root


def _notes(root: Path, path: Path) -> Notes:
    """What is said of a video: in its own file, as rpaug writes it, or in Ego4D's. Raises BadInput."""
    top = _top(root)
    for stated in (path.parent / ANNOTATIONS, path.with_suffix("") / ANNOTATIONS):
        if stated.is_file():
            files.see_inside(top, stated)
            return ego4d.own(stated)
    library = ego4d.library(top, ego4d.home_of(top, path))
    return replace(library.of(path.stem), file=path.name)


def _is_measured(view: CameraView, recorded: VideoSource) -> bool:
    """Whether the view's camera is known by now and was not as recorded."""
    return view.camera is not recorded.view.camera and not view.camera.assumed
