"""What Ego4D says of its videos: `ego4d.json`, narrations and FHO's hands, cut to one clip and named anew.

Times and frames count from the start of the video, or, in `clip_frame`, of the clip. Cut to a clip they count from its
first frame, and what lies outside is left out. Fields not known here survive.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rpaug_adapters.shared.texts import read_json
from rpaug_adapters.video.stream import Video

from rpaug import BadInput, files

INDEX = "ego4d.json"
FOLDER = "annotations"
PARTS = ("full_scale", "clips")  # folders of videos
NARRATIONS = ("narration.json", "narrations.json", "all_narrations_redacted.json")
HANDS = "fho_hands*.json"
PASSES = ("narration_pass_1", "narration_pass_2")
SECONDS = ("timestamp_sec", "start_sec", "end_sec", "action_start_sec", "action_end_sec")
FRAMES = ("timestamp_frame", "start_frame", "end_frame", "action_start_frame", "action_end_frame")
LISTS = ("narrations", "summaries", "frames", "boxes")
NUMBERS = frozenset({*SECONDS, *FRAMES, "frame"})
LARGEST = 2**31  # bytes: all of Ego4D's narrations are a tenth of it
TAG = re.compile(
    r"^\s*#\w+\s+(?:C\b\s*)?"
)  # "#C C ": who does it; the wearer is not named in a command


@dataclass(frozen=True)
class Notes:
    """All that is said of one clip, frames and seconds counted from its start.

    `video` is its entry in `ego4d.json`, `passes` the narrations by pass, `hands` the FHO clip's entry if there is one,
    `about` what else its narrations' entry says, `file` the recorded video's name.
    """

    video: Mapping[str, Any]
    passes: Mapping[str, Any]
    hands: Mapping[str, Any] | None = None
    about: Mapping[str, Any] = field(default_factory=dict)
    file: str = ""

    @property
    def descriptions(self) -> tuple[str, ...]:
        """The narrations in words that tell someone what to do, in order."""
        given = [
            (float(one.get("timestamp_sec") or 0), instruction(str(one.get("narration_text", ""))))
            for name in PASSES
            for one in self.passes.get(name, {}).get("narrations", ())
        ]
        return tuple(dict.fromkeys(text for _, text in sorted(given, key=lambda p: p[0]) if text))

    @property
    def boxes(self) -> dict[int, tuple[tuple[float, float, float, float], ...]]:
        """Boxes of hands by frame, each left, top, right, bottom, left hands first."""
        found: dict[int, dict[str, tuple[float, float, float, float]]] = {}
        for action in (self.hands or {}).get("frames", ()):
            for moment in action.values():
                if not isinstance(moment, Mapping) or not isinstance(moment.get("frame"), int):
                    continue
                for named in moment.get("boxes") or ():
                    for name, box in named.items() if isinstance(named, Mapping) else ():
                        if name.endswith("hand") and _is_box(box):
                            left, top, right, bottom = map(float, box)
                            at = found.setdefault(moment["frame"], {})
                            at.setdefault(name, (left, top, right, bottom))
        return {frame: tuple(of[name] for name in sorted(of)) for frame, of in found.items()}

    def when(self, uid: str) -> tuple[float, float] | None:
        """Start and end, in seconds, of a narration or of an FHO action; None if there is none of that name."""
        for of in self.passes.values():
            for note in of.get("narrations", ()):
                if note.get("annotation_uid") == uid:
                    return _second(note), _second(note)
        for note in (self.hands or {}).get("frames", ()):
            if note.get("action_uid", note.get("uid")) == uid and "action_start_sec" in note:
                return float(note["action_start_sec"]), float(note["action_end_sec"])
        return None

    def cut(self, start: float, stop: float, first: int, last: int) -> "Notes":
        """Between two times in seconds, and the frames there (`last` not included)."""
        passes = {
            name: {
                key: [_earlier(n, start, first) for n in held if start <= _second(n) < stop]
                if key in ("narrations", "summaries")
                else held
                for key, held in of.items()
            }
            for name, of in self.passes.items()
        }
        hands = self.hands
        if hands is not None:
            kept = [_hands_from(one, start, first, last) for one in hands.get("frames", ())]
            hands = {**hands, "frames": [one for one in kept if one is not None]}
        return replace(self, passes=passes, hands=hands)

    def described(self) -> dict[str, Any]:
        """Plain values, as one file beside an episode has them."""
        return {
            "file": self.file,
            "video": dict(self.video),
            "narrations": {**self.about, **self.passes},
            "fho": self.hands,
        }


def instruction(narration: str) -> str:
    """A narration without the tags that say who does it: `#C C opens the door` is `opens the door`."""
    return TAG.sub("", narration).replace("#unsure", "").strip().rstrip(".").strip()


def reworded(notes: Notes, descriptions: Iterable[str]) -> dict[str, Any]:
    """The passes with the narrations' words replaced, in order, by others; more than there were follow at the start."""
    words = list(descriptions)
    old = list(notes.descriptions)
    named = dict(zip(old, words, strict=False))
    passes = {
        name: {
            **of,
            "narrations": [
                {**n, "narration_text": _said(str(n["narration_text"]), stated, named[stated])}
                if (stated := instruction(str(n.get("narration_text", "")))) in named
                else n
                for n in of.get("narrations", ())
            ],
        }
        for name, of in notes.passes.items()
    }
    added = [
        {"timestamp_sec": 0.0, "timestamp_frame": 0, "narration_text": "#C C " + text}
        for text in words[len(old) :]
    ]
    if added:
        first = passes.setdefault(PASSES[0], {"narrations": []})
        first["narrations"] = [*added, *first["narrations"]]
    return {**notes.about, **passes}


def _said(narration: str, old: str, new: str) -> str:
    """A narration with its words replaced and its tags kept."""
    tag = TAG.match(narration)
    at = narration.find(old, tag.end() if tag else 0)
    return "#C C " + new if at < 0 else narration[:at] + new + narration[at + len(old) :]


def _is_box(value: Any) -> bool:
    numbers = isinstance(value, list) and len(value) == 4
    return numbers and all(isinstance(v, (int, float)) and v == v for v in value)


def _second(note: Mapping[str, Any]) -> float:
    return float(note.get("timestamp_sec", note.get("start_sec", 0)) or 0)


def _earlier(note: Mapping[str, Any], seconds: float, frames: int) -> dict[str, Any]:
    shift = dict.fromkeys(SECONDS, seconds) | dict.fromkeys(FRAMES, frames)
    return {
        key: value - shift[key] if key in shift and isinstance(value, (int, float)) else value
        for key, value in note.items()
    }


def _hands_from(
    note: Mapping[str, Any], start: float, first: int, last: int
) -> dict[str, Any] | None:
    """One action's frames, those in [first, last) alone; None if there is none."""
    moments = {k: v for k, v in note.items() if isinstance(v, Mapping) and "frame" in v}
    inside = {k: v for k, v in moments.items() if first <= int(v["frame"]) < last}
    if moments and not inside:
        return None
    kept = _earlier({k: v for k, v in note.items() if k not in moments}, start, first)
    for name, moment in inside.items():
        frame = int(moment["frame"]) - first
        kept[name] = {**moment, "frame": frame, "clip_frame": frame}
    return kept


@dataclass(frozen=True)
class Library:
    """Everything in an Ego4D folder: entries of videos and clips by uid, narrations and hands by uid, their files."""

    videos: Mapping[str, Mapping[str, Any]]
    clips: Mapping[str, Mapping[str, Any]]
    narrations: Mapping[str, Mapping[str, Any]]
    hands: Mapping[str, Mapping[str, Any]]  # by clip
    files: Mapping[str, Path]  # of narrations and hands
    name: str = NARRATIONS[0]  # of the file of narrations
    around: Mapping[str, Any] | None = (
        None  # what that file says beside its `videos`, where it has them
    )

    def of(self, uid: str) -> Notes:
        """What is said of a video or clip file, in its own time. Raises BadInput."""
        for name in (uid, str(self.clips.get(uid, {}).get("video_uid", ""))):
            _check(self.files.get(name), name, self.narrations.get(name))
        for name, clip in self.hands.items():
            if uid in (name, clip.get("video_uid")):
                _check(self.files.get(name), name, clip)
        if uid in self.clips and uid not in self.videos:
            clip = self.clips[uid]
            parent = str(clip.get("video_uid", ""))
            whole = _notes({}, self.narrations.get(parent, {}), self.hands.get(uid))
            start, stop = _span(clip, "sec")
            first, last = _span(clip, "frame")
            return replace(whole.cut(start, stop, int(first), int(last)), video=clip)
        own = [c for u, c in self.hands.items() if c.get("video_uid") == uid]
        hands = {**own[0], "frames": [f for c in own for f in c.get("frames", ())]} if own else None
        return _notes(self.videos.get(uid, {}), self.narrations.get(uid, {}), hands)


def _notes(
    video: Mapping[str, Any],
    narrations: Mapping[str, Any],
    hands: Mapping[str, Any] | None,
    file: str = "",
) -> Notes:
    passes = {
        name: of for name, of in narrations.items() if name in PASSES and isinstance(of, Mapping)
    }
    about = {name: of for name, of in narrations.items() if name not in PASSES}
    return Notes(video, passes, hands, about, file)


def _check(path: Path | None, uid: str, given: Any) -> None:
    """See that lists are lists of objects and times are numbers, wherever they are. Raises BadInput."""
    waiting = [] if path is None else [(uid, given)]
    while waiting:
        at, node = waiting.pop()
        for key, value in node.items() if isinstance(node, Mapping) else ():
            place, wanted = f"{at}.{key}"[:80], None
            if key in LISTS and not _objects(value) and (value is not None or key != "boxes"):
                wanted = "a list of objects"
            elif key in NUMBERS and not _number(value) and (value is not None or key == "frame"):
                wanted = "a number"
            if wanted:
                assert path is not None
                raise BadInput(path, place, found=repr(value)[:40], expected=wanted)
            waiting += (
                [(f"{place}.{i}", one) for i, one in enumerate(value)]
                if key in LISTS and value is not None
                else [(place, value)]
            )


def _objects(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(one, Mapping) for one in value)


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and abs(value) < 1e15


def _span(clip: Mapping[str, Any], unit: str) -> tuple[float, float]:
    start, stop = clip.get(f"video_start_{unit}"), clip.get(f"video_end_{unit}")
    return float(start or 0), float("inf") if stop is None else float(stop)


def library(root: Path, home: Path) -> Library:
    """What an Ego4D folder (the one with `full_scale` or `clips`, or the one above) says, which may be above the
    dataset's root. Raises BadInput."""
    given = (home / INDEX, home.parent / INDEX, *(home / FOLDER).glob("*.json"))
    files.see_inside(root, *(path for path in given if path.is_relative_to(root)))
    index = _json(home / INDEX) if (home / INDEX).is_file() else _json(home.parent / INDEX)
    held = home / FOLDER
    narrations: dict[str, Any] = {}
    sources: dict[str, Path] = {}
    first, around = NARRATIONS[0], None
    for name in NARRATIONS:
        whole = _json(held / name)
        if whole and not narrations:
            first = name
            around = (
                {k: v for k, v in whole.items() if k != "videos"} if "videos" in whole else None
            )
        given = whole.get("videos", whole)
        if not isinstance(given, dict):
            raise BadInput(held / name, "videos", found="something else", expected="an object")
        here = {k: v for k, v in given.items() if isinstance(v, Mapping)}
        narrations |= here
        sources |= dict.fromkeys(here, held / name)
    hands = {}
    for path in sorted(held.glob(HANDS)) if held.is_dir() else ():
        for clip in _listed(path, _json(path), "clips"):
            hands[str(clip.get("clip_uid"))] = clip
            sources[str(clip.get("clip_uid"))] = path
    where = home / INDEX
    return Library(
        {str(v.get("video_uid")): v for v in _listed(where, index, "videos")},
        {str(c.get("clip_uid")): c for c in _listed(where, index, "clips")},
        narrations,
        hands,
        sources,
        first,
        around,
    )


def home_of(root: Path, path: Path) -> Path:
    """The folder of a version: above `full_scale` or `clips`, else the one that the video is in."""
    inside = path.relative_to(root).parts[:-1]
    for depth, name in enumerate(inside):
        if name in PARTS:
            return root.joinpath(*inside[:depth])
    return path.parent


def own(path: Path) -> Notes:
    """What a file that rpaug wrote beside an episode says. Raises BadInput."""
    given = _json(path)
    named = str(given.get("file") or "")
    return _notes(given.get("video") or {}, given.get("narrations") or {}, given.get("fho"), named)


def _json(path: Path) -> dict[str, Any]:
    """An object in a file; empty where there is no file."""
    if not path.is_file():
        return {}
    if path.stat().st_size > LARGEST:
        raise BadInput(path, "size", found="more than 2 GiB", expected="annotations")
    given = read_json(path, "JSON")
    if not isinstance(given, dict):
        raise BadInput(path, "JSON", found=type(given).__name__, expected="an object")
    return given


def _listed(path: Path, given: Mapping[str, Any], name: str) -> Iterator[Mapping[str, Any]]:
    held = given.get(name, [])
    if not isinstance(held, list) or not all(isinstance(one, Mapping) for one in held):
        raise BadInput(path, name, found="something else", expected="a list of objects")
    yield from held


def _measured(video: Video) -> dict[str, Any]:
    """What `ego4d.json` says of a video file. Raises BadInput."""
    given = video.facts
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


def merged(clips: Iterable[tuple[str, Notes, Video]], like: Library) -> dict[str, Any]:
    """Ego4D's own files, by name, of clips by their new uids, narrations as the recorded ones lie. Raises BadInput."""
    videos, narrations, hands = [], {}, []
    for uid, notes, video in clips:
        entry = {k: v for k, v in notes.video.items() if k not in ("clip_uid", "clips")}
        entry = {k: v for k, v in entry.items() if not k.startswith("video_")}
        source = notes.video.get("video_uid") or notes.video.get("clip_uid")
        of = {"video_uid": uid, "source_uid": source, "source_file": notes.file}
        videos.append({**entry, **_measured(video), **of})
        if notes.passes:
            narrations[uid] = {"status": "complete", **notes.about, **notes.passes}
        if notes.hands is not None:
            hands.append({**notes.hands, "clip_uid": uid, "video_uid": uid})
    files: dict[str, Any] = {INDEX: {"videos": videos, "clips": []}}
    if narrations:
        lying = narrations if like.around is None else {**like.around, "videos": narrations}
        files[f"{FOLDER}/{like.name}"] = lying
    if hands:
        files[f"{FOLDER}/fho_hands.json"] = {"clips": hands}
    return files
