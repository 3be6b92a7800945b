"""Writing a LeRobot episode into a folder of its own: rows and videos with only what changed encoded anew."""

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rpaug_adapters.lerobot import codes, fresh, staged, stats, tables, tiff, words
from rpaug_adapters.lerobot.read import LeRobotSource, blobs, is_depth
from rpaug_adapters.lerobot.tables import COUNTED, LINKED, ROW, STATISTICS, Info
from rpaug_adapters.shared import cameras, splice, video
from rpaug_adapters.shared.images import reencoded
from rpaug_adapters.shared.texts import read_json
from rpaug_adapters.shared.video import Frames, Span

from rpaug import Episode, Unsupported

OF_THE_WHOLE = ("index", "episode_index", "task_index")  # columns that count in the whole dataset
Image = Callable[[int], np.ndarray]
Shown = dict[
    str, tuple[Image, float]
]  # of each video, and what its values are divided by in statistics


def write_episode(
    episode: Episode, recorded: LeRobotSource | None, about: Info, work: Path
) -> tuple[dict[str, bytes], list[str]]:
    """Fill a folder; returns the files to lay beside, and what could not be had, in words."""
    said: list[str] = []
    kept: dict[str, Any] = {}
    changed: set[str] = set()
    if recorded is None:
        episode = fresh.plain(episode)
        rows = fresh.rows(episode)
        row = {"tasks": list(episode.descriptions or [""])}
        extra = {cameras.NAME: fresh.beside(episode)}
        shown = {fresh.IMAGE + name: (view.rgb, 255.0) for name, view in episode.views.items()}
        for key, (image, _) in shown.items():
            every = (image(t) for t in range(episode.length))
            video.encode(every, work / f"{key}.mp4", about.rate, None)
    else:
        now = words.changed(recorded.descriptions, episode)
        row = words.row_replaced(recorded.row, now)
        rows, changed = _edited(episode, recorded, now)
        extra = cameras.moved(episode, recorded.views, recorded.beside, recorded.own)
        shown, filmed, said = _videos(episode, recorded, about, work)
        kept = _kept(recorded, about, changed | filmed)
    staged.write(rows, work)
    counted = stats.plain(_statistics(episode, about, rows, shown, kept))
    statistics = kept | (stats.old(counted) if about.old else counted)
    (work / STATISTICS).write_text(json.dumps(statistics))
    pictures = set(about.of_kind("image"))
    encoded = sorted(pictures if recorded is None else pictures & changed)
    (work / ROW).write_text(_json(episode, {"row": row, "encoded": encoded}), encoding="utf-8")
    return extra, said


def _json(episode: Episode, stated: Mapping[str, Any]) -> str:
    """What the table of episodes says. Raises Unsupported."""
    try:
        return json.dumps(stated, ensure_ascii=False)
    except (TypeError, ValueError) as error:
        reason = f"the table of episodes holds what JSON does not: {error}"
        raise Unsupported(f"{episode.key}: {reason}") from None


def _edited(
    episode: Episode, recorded: LeRobotSource, now: Mapping[str, str]
) -> tuple[Any, set[str]]:
    """The recorded rows with new images, depth, handles and words where they changed, and the columns that did."""
    pa, _ = tables.arrow()
    rows, length = recorded.rows, episode.length
    new: dict[str, Any] = {"task": pa.array([now.get(text, text) for text in recorded.tasks])}
    for key in words.columns(recorded.info, rows) if now else ():
        new[key] = words.column_replaced(rows[key], now)
    for name, view in episode.views.items():
        before, key = recorded.views[name], recorded.images[name]
        if key not in recorded.spans and view.rgb is not before.rgb:
            encoded = reencoded(blobs("", rows, key), view, before)
            new[key] = fresh.images(encoded)
        depth = recorded.depths.get(name)
        if depth is not None and depth.scale is None and view.depth is not before.depth:
            new[recorded.depths[name].key] = _depth(episode, recorded, name)
        if name in recorded.ids and view.ids is not before.ids:
            assert view.ids is not None
            new[recorded.ids[name]] = fresh.whole([view.ids(t) for t in range(length)])
    for key in OF_THE_WHOLE:
        if key in rows.column_names:
            rows = rows.drop_columns([key])
    for key, column in new.items():
        rows = with_column(rows, key, column)
    return rows, {*new}


def with_column(rows: Any, name: str, column: Any) -> Any:
    """A table with a column in the place of the one of that name, or at its end."""
    at = rows.schema.get_field_index(name)
    return rows.append_column(name, column) if at < 0 else rows.set_column(at, name, column)


def _kept(recorded: LeRobotSource, about: Info, changed: set[str]) -> dict[str, Any]:
    """The recorded statistics of what no edit changed, as they are."""
    if recorded.number is None:
        path = recorded.own / STATISTICS
        given = read_json(path, "statistics") if path.is_file() else {}
    else:
        given = tables.statistics(recorded.info.folder, recorded.number)
    found = {}
    for key in (
        about.features.keys() - changed - {*OF_THE_WHOLE, *words.columns(about, recorded.rows)}
    ):
        feature = about.features[key]
        channels = feature["shape"][-1] if len(feature["shape"]) == 3 else 1
        shown = feature["dtype"] in ("image", "video")
        one = stats.recorded(given.get(key), (channels, 1, 1) if shown else about.shape(key))
        if one is not None:
            found[key] = one
    return found


def _depth(episode: Episode, recorded: LeRobotSource, name: str) -> Any:
    """A column of depth in its own unit and number type."""
    given, view, before = recorded.depths[name], episode.views[name], recorded.views[name]
    assert view.depth is not None
    assert before.depth is not None
    images = []
    for t, data in enumerate(blobs("", recorded.rows, given.key)[: episode.length]):
        depth = view.depth(t)
        if not np.array_equal(depth, before.depth(t)):
            stored = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
            values = depth / np.float32(given.metres)
            if stored.dtype.kind in "iu":
                values = np.clip(np.rint(values), 0, np.iinfo(stored.dtype).max)
            # What no edit touched keeps its number: a division may miss it.
            values = np.where(depth == before.depth(t), stored, values).astype(stored.dtype)
            encoded = fresh.tiff(values)
            data = encoded if tiff.is_one(data) else cv2.imencode(".png", values)[1].tobytes()
        images.append(data)
    return fresh.images(images)


def _videos(
    episode: Episode, recorded: LeRobotSource, about: Info, work: Path
) -> tuple[Shown, set[str], list[str]]:
    """Write every video of the episode; returns what each shows, which an edit changed (the others are taken as they
    are), and what could not be had."""
    shown: Shown = {}
    said: list[str] = []
    changed: set[str] = set()
    linked: dict[str, float] = {}
    names = {key: name for name, key in recorded.images.items()}
    depths = {given.key: name for name, given in recorded.depths.items()}
    for key, span in recorded.spans.items():
        name, target = names.get(key), work / f"{key}.mp4"
        filmed = key in depths or is_depth(recorded.info.features[key])
        if filmed:
            image, most, before = _metric(episode, recorded, key, depths.get(key))
        else:
            image = before = Frames(span)
            if name is not None:
                image, before = episode.views[name].rgb, recorded.views[name].rgb
            most = 255.0
        shown[key] = image, most
        if not _same(image, before, episode.length):
            changed.add(key)
            if filmed:
                said += _edited_depth(recorded, key, image, before, target)
            else:
                said += _edited_span(span, image, before, video.encode, target)
        # Episodes of v2.1 are to share files in v3.
        elif recorded.info.old > about.old or not link(span.path, target):
            taken_out(span, target, filmed)
        else:
            linked[key] = span.start
    if linked:
        (work / LINKED).write_text(json.dumps(linked))
    return shown, changed, said


def link(path: Path, target: Path) -> bool:
    """One more name for a file, not for a link to it, where the file system has such."""
    try:
        os.link(os.path.realpath(path), target)
    except OSError:
        return False
    return True


def taken_out(span: Span, target: Path, filmed: bool) -> None:
    """A span as a file of its own: its packets, or, where it does not begin with a key frame, encoded anew."""
    if video.cut(span, target):
        return
    stored = Frames(span, video.CODES if filmed else "rgb24")
    encode = video.encode_codes if filmed else video.encode
    encode((stored(t) for t in range(span.length)), target, span.rate, span.path)


def _metric(
    episode: Episode, recorded: LeRobotSource, key: str, name: str | None
) -> tuple[Image, float, Image]:
    """What a video of depth shows, of the view `name` if it is one's, what its values are divided by in statistics, and
    what it showed before."""
    if name is not None:
        depth, before = episode.views[name].depth, recorded.views[name].depth
        assert depth is not None
        assert before is not None
        return depth, recorded.depths[name].metres, before
    feature = recorded.info.features[key]
    scale = codes.scale(recorded.info.folder / tables.INFO, key, feature)
    stored = Frames(recorded.spans[key], video.CODES)
    image: Image = lambda t: scale.metres(stored(t))  # noqa: E731
    return image, codes.unit(feature) or codes.UNITS["mm"], image


def _edited_depth(
    recorded: LeRobotSource, key: str, after: Image, before: Image, target: Path
) -> tuple[str, ...]:
    """Write a video of depth; codes of what no edit touched stay as they are."""
    info, span = recorded.info, recorded.spans[key]
    scale = codes.scale(info.folder / tables.INFO, key, info.features[key])
    stored = Frames(span, video.CODES)

    def edited(t: int) -> np.ndarray:
        return np.where(after(t) == before(t), stored(t), scale.codes(after(t)))

    return _edited_span(span, edited, stored, video.encode_codes, target)


def _edited_span(
    span: Span, after: Image, before: Image, encode: Callable[..., None], target: Path
) -> tuple[str, ...]:
    """Write a span of which some frames changed; what could not be had."""
    first = splice.first_frame(span)
    if first is None:
        encode((after(t) for t in range(span.length)), target, span.rate, span.path)
        return ()

    def new(t: int) -> np.ndarray | None:
        image = after(t - first)
        return None if np.array_equal(image, before(t - first)) else image

    def write(frames: splice.New, path: Path) -> None:
        every = (before(t - first) if image is None else image for t, image in frames)
        encode(every, path, span.rate, span.path)

    return splice.write(span.path, range(first, first + span.length), new, write, target)


def _same(one: Image, other: Image, length: int) -> bool:
    return one is other or all(np.array_equal(one(t), other(t)) for t in range(length))


def losses(recorded: LeRobotSource, version: str) -> list[str]:
    """What another version of LeRobot does not hold of an episode."""
    info = recorded.info
    if info.given["codebase_version"] == version:
        return []
    found = []
    if version == tables.OLD:
        found.append(
            "which files episodes share, and sizes of files: in v2.1 each episode has its own"
        )
        if deep := [key for key in info.of_kind("image", "video") if info.shape(key)[-1] != 3]:
            found.append(
                f"{', '.join(deep)}: statistics of one channel, which v2.1's loader refuses"
            )
    elif info.given["data_path"] != tables.OLD_DATA_PATH or (
        info.of_kind("video") and info.given["video_path"] != tables.OLD_VIDEO_PATH
    ):
        found.append("names of files: v3's own")
    return found


def untouched(recorded: LeRobotSource, edited_words: bool) -> dict[str, bytes]:
    """All columns but those of images, depth, instance ids and of what counts in the whole dataset, what the table of
    episodes says, and videos that are no camera's; no words where an edit changed them."""
    shown = {*recorded.images.values(), *recorded.ids.values()}
    shown |= {one.key for one in recorded.depths.values()}
    spoken = {*words.columns(recorded.info, recorded.rows)} if edited_words else set()
    found = {}
    for name in recorded.rows.column_names:
        if name not in shown | spoken | {*OF_THE_WHOLE}:
            column = recorded.rows[name]
            found[name] = repr((str(column.type), column.to_pylist())).encode()
    for key, span in recorded.spans.items():
        if key not in shown:
            found[key] = video.digest(span)
    if not edited_words:
        found["task"] = repr(recorded.tasks).encode()
        tasks = list(dict.fromkeys([*words.tasks(recorded.row), *recorded.tasks]))
        found[tables.EPISODES] = repr(sorted((recorded.row | {"tasks": tasks}).items())).encode()
    return found


def _statistics(
    episode: Episode, about: Info, rows: Any, shown: Shown, kept: Mapping[str, Any]
) -> dict[str, stats.Statistics]:
    """Of the features whose recorded ones are not kept."""
    found, spoken = {}, {*words.columns(about, rows)}
    for key, feature in about.features.items():
        kind = feature["dtype"]
        if kind == "string" or key in OF_THE_WHOLE or key in kept or key in spoken:
            continue
        if kind == "video":
            if key in shown:
                image, most = shown[key]
                found[key] = stats.of_images(image, episode.length, most)
        elif key in rows.column_names and kind == "image":
            found[key] = _of_encoded(rows, key, episode.length)
        elif key in rows.column_names and (key in COUNTED or len(feature["shape"]) == 1):
            values = np.asarray(rows[key].to_pylist(), np.float64)
            found[key] = stats.of_numbers(values)
    return found


def _of_encoded(rows: Any, key: str, length: int) -> stats.Statistics:
    data = blobs("", rows, key)

    def image(t: int) -> np.ndarray:
        pixels = cv2.imdecode(np.frombuffer(data[t], np.uint8), cv2.IMREAD_UNCHANGED)
        return pixels[..., 2::-1] if pixels.ndim == 3 else pixels

    depth = image(0).dtype != np.uint8
    return stats.of_images(image, length, 1.0 if depth else 255.0)
