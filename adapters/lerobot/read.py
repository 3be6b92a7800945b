"""Reading a LeRobot episode: its rows, and its videos, every frame of which is found before it is believed."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from glob import escape
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float64
from rpaug_adapters.lerobot import codes, staged, tables, tiff, words
from rpaug_adapters.lerobot.codes import Scale
from rpaug_adapters.lerobot.tables import COUNTED, INFO, LINKED, ROW, STAGED, Info
from rpaug_adapters.shared import cameras, episodes, video
from rpaug_adapters.shared.cameras import Beside
from rpaug_adapters.shared.folders import see_no_link_out
from rpaug_adapters.shared.images import image_size, lazy_colors, lazy_depth
from rpaug_adapters.shared.texts import read_json
from rpaug_adapters.shared.video import Frames, Span

from rpaug import BadInput, Camera, CameraView, Episode, files

IMAGES = ("observation.images.", "observation.")
DEPTH = "_depth"  # ending of the feature with a camera's depth, where no side file names it
MASK = "masks."  # before a camera's name: handles, as rpaug writes them


@dataclass(frozen=True)
class DepthFeature:
    """The feature of a camera's depth: metres of one unit of it, and, if it is a video, the scale of its codes."""

    key: str
    metres: float
    scale: Scale | None


@dataclass(frozen=True)
class LeRobotSource:
    """Where an episode came from: its rows, its videos, and which features its views are."""

    root: Path  # of the dataset as it was given, which may hold several
    info: Info
    own: Path  # what lies beside this episode alone
    number: int | None  # in the gathered dataset; None in a folder of its own
    rows: Any  # a pyarrow table
    spans: dict[str, Span]
    views: dict[str, CameraView]
    images: dict[str, str]
    depths: dict[str, DepthFeature]
    ids: dict[str, str]
    beside: Beside
    tasks: tuple[str, ...]  # of each frame
    row: dict[str, Any]  # what the table of episodes says and no one counts
    descriptions: tuple[str, ...]


Gathered = tuple[Any, tuple[str, ...], dict[str, Any], dict[str, Span]]


def read_episode(root: Path, folder: Path, split: str, number: int, key: str) -> Episode:
    """Episode `number` of a split, images lazy. Raises BadInput."""
    about = tables.info(folder)
    own = folder / split / str(number)
    if own.is_dir():
        see_no_link_out(folder, own)
    at = None if (own / STAGED).is_file() else _place(about, split, number)
    rows, tasks, row, spans = _staged(about, own) if at is None else _gathered(about, at)
    length = rows.num_rows
    where = f"{folder}: {split}/{number}"
    beside = cameras.load(root, (own, folder))
    images = _found(about, beside)
    sizes = {name: _size(where, about, rows, spans, image) for name, image in images.items()}
    tracks = _tracks(where, about, rows)
    depths = _depths(about, beside, images)
    ids = {name: MASK + name for name in images if MASK + name in about.features}
    for name, given in beside.cameras.items():
        if given.ids is not None and name in images:
            cameras.known(beside, f"cameras.{name}.ids", given.ids, about.features)
            ids[name] = given.ids
    descriptions = words.distinct(about, rows, tasks, row)

    def view(name: str, camera: Camera) -> CameraView:
        depth, mask = depths.get(name), ids.get(name)
        return _view(where, about, rows, spans, images[name], depth, mask, camera)

    def recorded(views: dict[str, CameraView]) -> LeRobotSource:
        return LeRobotSource(
            root,
            about,
            own,
            at,
            rows,
            spans,
            views,
            images,
            depths,
            ids,
            beside,
            tasks,
            row,
            descriptions,
        )

    made = episodes.episode(key, beside, sizes, tracks, length, descriptions, view, recorded)
    return replace(made, rate=about.rate)


def _place(about: Info, split: str, number: int) -> int:
    """The number of an episode of a split in the whole dataset."""
    span = about.splits.get(split, range(0))
    if number >= len(span):
        where, found = f"splits.{split}", f"{len(span)} episodes"
        raise BadInput(about.folder / INFO, where, found=found, expected=f"number {number}")
    return span[number]


def _gathered(about: Info, number: int) -> Gathered:
    """Rows, words, row and videos of an episode among others."""
    folder = about.folder
    given = tables.episode(folder, number)
    path = about.path(number, given, "data")
    rows = tables.table(path, episode=None if about.old else number)
    length = _length(f"{path}: episode {number}", rows, given.get("length"))
    known_words = tables.tasks(folder)
    column = rows["task_index"].to_pylist() if "task_index" in rows.column_names else []
    known = (known_words.get(index, "") if isinstance(index, int) else "" for index in column)
    tasks = tuple(known) or ("",) * length
    spans = {}
    for key in about.of_kind("video"):
        prefix = f"videos/{key}"
        file = about.path(number, given, prefix, video_key=key)
        start = 0.0 if about.old else given.get(f"{prefix}/from_timestamp")
        where = f"episode {number}, {prefix}/from_timestamp"
        start = _seconds(folder / tables.EPISODES, where, start)
        spans[key] = Span(file, start, length, about.rate)
    return words.spoken(about, rows), tasks, words.beside(given), spans


def _seconds(path: Path, where: str, start: Any) -> float:
    """Where an episode begins in a video. Raises BadInput."""
    if not isinstance(start, (int, float)) or not 0 <= start < 1e7:
        raise BadInput(path, where, found=repr(start)[:40], expected="seconds")
    return float(start)


def _staged(about: Info, own: Path) -> Gathered:
    """Rows, words, row and videos of an episode that is not gathered yet."""
    rows = staged.read(own)
    length = _length(str(own / STAGED), rows, rows.num_rows)
    tasks = tuple(str(text) for text in rows["task"].to_pylist())
    spans = {}
    for key in about.of_kind("video"):
        path, start = own_video(own, key)
        spans[key] = Span(path, start or 0.0, length, about.rate)
    return rows, tasks, read_row(own), spans


def read_row(own: Path) -> dict[str, Any]:
    """What the table of episodes is to say of an episode that is not gathered yet, but for what is counted. Raises
    BadInput."""
    row = _stated(own).get("row", {})
    if not isinstance(row, dict):
        raise BadInput(own / ROW, "row", found=repr(row)[:40], expected="an object")
    return row


def encoded(own: Path) -> list[str]:
    """The features of such an episode whose images were encoded by us. Raises BadInput."""
    keys = _stated(own).get("encoded", [])
    if not isinstance(keys, list) or not all(isinstance(key, str) for key in keys):
        raise BadInput(own / ROW, "encoded", found=repr(keys)[:40], expected="names of features")
    return keys


def _stated(own: Path) -> dict[str, Any]:
    given = read_json(own / ROW, "an object") if (own / ROW).is_file() else {}
    if not isinstance(given, dict):
        raise BadInput(own / ROW, "JSON", found=repr(given)[:40], expected="an object")
    return given


def decode_images(where: str, rows: Any, key: str) -> None:
    """See that every image of a column decodes. Raises BadInput."""
    for t, data in enumerate(blobs(where, rows, key)):
        place = f"{where}, {key}, frame {t}"
        if not tiff.is_one(data):
            files.check_image(place, data)
        if cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) is None:
            raise BadInput(place, "image", found="undecodable data", expected="an image")


def linked(own: Path) -> dict[str, float]:
    """The videos of an episode's own folder that are recorded files: seconds where the episode begins in each."""
    path = own / LINKED
    if not path.is_file():
        return {}
    given = read_json(path, "seconds by video")
    if not isinstance(given, dict):
        raise BadInput(path, "JSON", found=repr(given)[:40], expected="seconds by video")
    return {key: _seconds(path, key, start) for key, start in given.items()}


def lent(own: Path, key: str) -> tuple[Path, float] | None:
    """The file that an episode's own video was gathered into with others, if it was, and where it begins there."""
    for path in own.glob(f"{escape(key)}@*.mp4"):
        return path, float(path.stem.rpartition("@")[2])
    return None


def own_video(own: Path, key: str) -> tuple[Path, float | None]:
    """A video of an episode's own folder; where the episode begins in it, if it is a file that holds others too: one
    that was recorded, or that it was gathered into."""
    return lent(own, key) or (own / f"{key}.mp4", linked(own).get(key))


def _length(where: str, rows: Any, given: Any) -> int:
    if not rows.num_rows or rows.num_rows != given:
        found, expected = f"{rows.num_rows} rows", f"{given}, as the table of episodes says"
        raise BadInput(where, "rows", found=found, expected=expected)
    if "frame_index" in rows.column_names:
        counted = rows["frame_index"].to_pylist()
        if counted != list(range(rows.num_rows)):
            found = str(counted[:5])[:60]
            raise BadInput(where, "frame_index", found=found, expected="0, 1, 2, ...")
    return rows.num_rows


def _found(about: Info, beside: Beside) -> dict[str, str]:
    """The features of color by the names of their views."""
    found, among = {}, about.of_kind("image", "video")
    for key in among:
        if not is_depth(about.features[key]):
            prefix = next((prefix for prefix in IMAGES if key.startswith(prefix)), "")
            found[key.removeprefix(prefix)] = key
    views = cameras.chosen(beside, found, {key: key for key in among})
    if not views:
        where = about.folder / INFO
        raise BadInput(where, "features", found="no images", expected="a color image a step")
    return views


def is_depth(feature: dict[str, Any]) -> bool:
    """Whether a feature is said to be depth."""
    about, old = feature.get("info") or {}, feature.get("video_info") or {}
    return bool(
        about.get("is_depth_map")
        or about.get("video.is_depth_map")
        or old.get("video.is_depth_map")
    )


def _depths(about: Info, beside: Beside, images: dict[str, str]) -> dict[str, DepthFeature]:
    """Each camera's feature of depth: named by the side file, or called after the camera."""
    found = {}
    for name, image in images.items():
        given = beside.cameras.get(name)
        key = given.depth if given is not None else None
        if key is not None:
            cameras.known(beside, f"cameras.{name}.depth", key, about.features)
        elif image + DEPTH in about.features and is_depth(about.features[image + DEPTH]):
            key = image + DEPTH
        if key is None:
            continue
        feature = about.features[key]
        unit = codes.unit(feature)
        metres = unit or (given.metres if given is not None else codes.UNITS["mm"])
        filmed = feature["dtype"] == "video"
        scale = codes.scale(about.folder / INFO, key, feature) if filmed else None
        found[name] = DepthFeature(key, metres, scale)
    return found


def blobs(where: str, rows: Any, key: str) -> list[bytes]:
    """The encoded images of a feature. Raises BadInput."""
    if key not in rows.column_names:
        raise BadInput(where, key, found="nothing", expected="a column of images")
    found = [
        value.get("bytes") if isinstance(value, dict) else value for value in rows[key].to_pylist()
    ]
    odd = next((t for t, data in enumerate(found) if not isinstance(data, bytes)), None)
    if odd is not None:
        raise BadInput(where, f"{key}, frame {odd}", found="no bytes", expected="an encoded image")
    return found


def _size(where: str, about: Info, rows: Any, spans: dict[str, Span], key: str) -> tuple[int, int]:
    """Width and height that all images of a feature share."""
    if key in spans:
        return video.check(spans[key])
    return image_size(blobs(where, rows, key), lambda t: f"{where}, {key}, frame {t}")


def _tracks(where: str, about: Info, rows: Any) -> dict[str, Float64[np.ndarray, "t k"]]:
    """All numbers of the frames, by their features; what counts frames of the whole dataset is left out."""
    found, spoken = {}, {*words.columns(about, rows)}
    for key, feature in about.features.items():
        single = len(feature["shape"]) == 1 and feature["dtype"] not in ("string", "language")
        if key in spoken:
            continue
        if (key in COUNTED and key != "timestamp") or key not in rows.column_names or not single:
            continue
        if feature["dtype"] in ("image", "video"):
            continue
        try:
            values = np.asarray(rows[key].to_pylist(), np.float64).reshape(rows.num_rows, -1)
        except (TypeError, ValueError):
            found_, expected = "rows of several lengths, or gaps", f"{feature['shape']} numbers"
            raise BadInput(where, key, found=found_, expected=expected) from None
        if values.shape[1] != feature["shape"][0]:
            expected = f"{feature['shape'][0]}, as {INFO} says"
            raise BadInput(where, key, found=f"{values.shape[1]} numbers", expected=expected)
        found[key] = values
    return found


def _view(
    where: str,
    about: Info,
    rows: Any,
    spans: dict[str, Span],
    key: str,
    depth: DepthFeature | None,
    ids: str | None,
    camera: Camera,
) -> CameraView:
    shape = camera.height, camera.width
    if ids is not None and rows.column_names.count(ids) != 1:
        found, expected = f"{rows.column_names.count(ids)} such columns", f"one, as {INFO} says"
        raise BadInput(where, ids, found=found, expected=expected)
    recorded: Callable[[int], np.ndarray] = (
        Frames(spans[key])
        if key in spans
        else lazy_colors(blobs(where, rows, key), lambda t: f"{where}, {key}, frame {t}")
    )
    return CameraView(
        camera,
        recorded,
        None if depth is None else _metric(where, about, rows, spans, depth, shape),
        None if ids is None else _whole(where, rows, ids, shape),
        most_id=CameraView.most_id if ids is None else _most_id(rows.schema.field(ids).type),
    )


def _metric(
    where: str,
    about: Info,
    rows: Any,
    spans: dict[str, Span],
    depth: DepthFeature,
    shape: tuple[int, int],
) -> Callable[[int], np.ndarray]:
    """A camera's depth in metres."""
    if (scale := depth.scale) is not None:
        frames = Frames(spans[depth.key], video.CODES)
        if video.check(spans[depth.key]) != shape[::-1]:
            found, expected = "another size", f"{shape[1]}x{shape[0]}, as the color"
            raise BadInput(spans[depth.key].path, "size", found=found, expected=expected)
        return lambda t: scale.metres(frames(t))
    images = blobs(where, rows, depth.key)
    return lazy_depth(
        lambda t: one_channel(f"{where}, {depth.key}, frame {t}", images[t], shape), depth.metres
    )


def one_channel(where: str, data: bytes, shape: tuple[int, int]) -> np.ndarray:
    """A TIFF or PNG of one channel, of any number type. Raises BadInput."""
    size = tiff.size(where, data) if tiff.is_one(data) else files.check_image(where, data)
    if size != shape[::-1]:
        found, expected = f"{size[0]}x{size[1]}", f"{shape[1]}x{shape[0]}, as the color"
        raise BadInput(where, "size", found=found, expected=expected)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.shape != shape:
        raise BadInput(where, "image", found="undecodable data", expected="one value a pixel")
    return image


def _most_id(kind: Any) -> int:
    """The largest id that a column of nested lists of numbers holds."""
    pa, _ = tables.arrow()
    while hasattr(kind, "value_type"):
        kind = kind.value_type
    bits = kind.bit_width - pa.types.is_signed_integer(kind) if pa.types.is_integer(kind) else 24
    return min(2**bits - 1, CameraView.most_id)


def _whole(where: str, rows: Any, key: str, shape: tuple[int, int]) -> Callable[[int], np.ndarray]:
    def whole(t: int) -> np.ndarray:
        try:
            values = np.asarray(rows[key][t].as_py(), np.int32)
        except (TypeError, ValueError, KeyError, OverflowError):
            values = np.zeros(0, np.int32)
        if values.shape != shape:
            expected = f"{shape[0]} rows of {shape[1]} numbers"
            raise BadInput(f"{where}, frame {t}", key, found="another shape", expected=expected)
        return values

    return whole
