"""Writing a LeRobot episode into a folder of its own: rows and videos with only what changed encoded anew."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rpaug_adapters.lerobot import fresh, stats, tables, tiff
from rpaug_adapters.lerobot.read import LeRobotSource, blobs
from rpaug_adapters.lerobot.tables import COUNTED, STAGED, STATISTICS, Info
from rpaug_adapters.shared import cameras, video
from rpaug_adapters.shared.images import reencoded
from rpaug_adapters.shared.video import Frames

from rpaug import Episode, Unsupported

OF_THE_WHOLE = ("index", "episode_index", "task_index")  # columns that count in the whole dataset
Image = Callable[[int], np.ndarray]


def write_episode(
    episode: Episode, recorded: LeRobotSource | None, about: Info, work: Path
) -> dict[str, bytes]:
    """Fill a folder; returns the files to lay beside."""
    if recorded is None:
        episode = fresh.plain(episode)
        rows = fresh.rows(episode)
        extra = {cameras.NAME: fresh.beside(episode)}
        shown = {fresh.IMAGE + name: view.rgb for name, view in episode.views.items()}
        for key, image in shown.items():
            every = (image(t) for t in range(episode.length))
            video.encode(every, work / f"{key}.mp4", about.rate, None)
    else:
        rows = _edited(episode, recorded)
        extra = cameras.moved(episode, recorded.views, recorded.beside, recorded.own)
        shown = _videos(episode, recorded, work)
    pq = tables.arrow()[1]
    pq.write_table(rows, work / STAGED, compression="snappy")
    statistics = _statistics(episode, about, rows, shown)
    (work / STATISTICS).write_text(json.dumps(stats.plain(statistics)))
    return extra


def _edited(episode: Episode, recorded: LeRobotSource) -> Any:
    """The recorded rows with new images, depth, handles and words where they changed."""
    pa, _ = tables.arrow()
    rows, length = recorded.rows, episode.length
    new: dict[str, Any] = {"task": pa.array(_words(episode, recorded))}
    for name, view in episode.views.items():
        before, key = recorded.views[name], recorded.images[name]
        if key not in recorded.spans and view.rgb is not before.rgb:
            encoded = reencoded(blobs("", rows, key), view, before)
            new[key] = fresh.images(encoded)
        if name in recorded.depths and view.depth is not before.depth:
            new[recorded.depths[name].key] = _depth(episode, recorded, name)
        if name in recorded.ids and view.ids is not before.ids:
            assert view.ids is not None
            new[recorded.ids[name]] = fresh.whole([view.ids(t) for t in range(length)])
    for key in OF_THE_WHOLE:
        if key in rows.column_names:
            rows = rows.drop_columns([key])
    for key, column in new.items():
        at = rows.schema.get_field_index(key)
        rows = rows.append_column(key, column) if at < 0 else rows.set_column(at, key, column)
    return rows


def _words(episode: Episode, recorded: LeRobotSource) -> list[str]:
    """The words of each frame: new for old where as many came back, else the instruction."""
    old, new = recorded.descriptions, episode.descriptions
    if old == new:
        return list(recorded.tasks)
    if len(old) == len(new):
        by = dict(zip(old, new, strict=True))
        return [by.get(text, text) for text in recorded.tasks]
    return [episode.instruction] * episode.length


def _depth(episode: Episode, recorded: LeRobotSource, name: str) -> Any:
    """A column of depth in its own unit and number type. Raises Unsupported for a video of depth."""
    given, view, before = recorded.depths[name], episode.views[name], recorded.views[name]
    if given.metres is None:
        reason = "its depth is a video of 12 bits, which would change where no edit does"
        raise Unsupported(f"{episode.key}: {name}: {reason}")
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


def _videos(episode: Episode, recorded: LeRobotSource, work: Path) -> dict[str, Image]:
    """Write every video of the episode; returns what each shows. Frames no edit changed are copied as they are."""
    shown: dict[str, Image] = {}
    names = {key: name for name, key in recorded.images.items()}
    depths = {given.key: name for name, given in recorded.depths.items()}
    for key, span in recorded.spans.items():
        name, target = names.get(key), work / f"{key}.mp4"
        if key in depths:
            view, before = episode.views[depths[key]], recorded.views[depths[key]]
            if view.depth is not before.depth:
                _depth(episode, recorded, depths[key])
            if not video.cut(span, target):
                raise Unsupported(
                    f"{episode.key}: {key}: its depth does not begin with a key frame"
                )
            continue
        image: Image = Frames(span) if name is None else episode.views[name].rgb
        same = name is None or _same(image, recorded.views[name].rgb, episode.length)
        if not same or not video.cut(span, target):
            every = (image(t) for t in range(episode.length))
            video.encode(every, target, span.rate, span.path)
        shown[key] = image
    return shown


def _same(one: Image, other: Image, length: int) -> bool:
    return one is other or all(np.array_equal(one(t), other(t)) for t in range(length))


def _statistics(
    episode: Episode, about: Info, rows: Any, shown: dict[str, Image]
) -> dict[str, stats.Statistics]:
    found = {}
    for key, feature in about.features.items():
        kind = feature["dtype"]
        if kind in ("string", "language") or key in OF_THE_WHOLE:
            continue
        if kind == "video":
            if key in shown:
                found[key] = stats.of_images(shown[key], episode.length)
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
