"""Where a LeRobot dataset keeps what: its description, its table of episodes, and episodes not gathered yet.

A finished dataset of v3 has `meta/{info.json, stats.json, tasks.parquet, episodes/*/*.parquet}`, `data/*/*.parquet` and
`videos/<key>/*/*.mp4`, many episodes in one file. One of v2.1 has `meta/{info.json, tasks.jsonl, episodes.jsonl,
episodes_stats.jsonl}` and for each episode a table and a video a camera (huggingface/lerobot, v0.3.3). While it grows
each episode is a folder `<split>/<number>/` with one table, one video a camera, and its statistics, so that it can
appear by one rename.
"""

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

from rpaug_adapters.shared.texts import read_json

from rpaug import BadInput, MissingExtra, files

INFO = "meta/info.json"
STATS = "meta/stats.json"
TASKS = "meta/tasks.parquet"
SUBTASKS = "meta/subtasks.parquet"
EPISODES = "meta/episodes"
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
EPISODES_PATH = EPISODES + "/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
STAGED = "episode.parquet"  # an episode's own rows, while the dataset grows
STATISTICS = "episode_stats.json"
LINKED = "linked.json"  # videos of the folder that are recorded files, by key: seconds where the episode begins
ROW = "episode.json"  # `row`: what the table of episodes says of it, but for what is counted; `encoded`: new images
COUNTED = {"timestamp": "float32", "frame_index": "int64", "episode_index": "int64",
           "index": "int64", "task_index": "int64"}  # fmt: skip
VERSION, OLD = "v3.", "v2.1"
EMPTY = {"total_episodes": 0, "total_frames": 0, "total_tasks": 0, "splits": {}}
VERSIONS = ("v3.0", OLD)  # written
OLD_TOTALS = ("total_videos", "total_chunks")
OLD_DATA_PATH = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
OLD_VIDEO_PATH = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"
OLD_PLACES = {"data_path": OLD_DATA_PATH, "video_path": OLD_VIDEO_PATH}
OLD_TASKS = "meta/tasks.jsonl"
OLD_EPISODES = "meta/episodes.jsonl"
OLD_STATISTICS = "meta/episodes_stats.jsonl"
# Bytes of one table, unpacked: more is taken for damage, before anything is allocated.
LARGEST = 2**31
MOST = 2**20  # episodes, likewise
# Of a table with many episodes: rows, and bytes of a column, that are looked at in one go.
ROWS, BUFFER = 256, 2**20
FILES = 1000  # in a chunk, where nothing is told


def arrow() -> tuple[Any, Any]:
    """pyarrow and its parquet module. Raises MissingExtra."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise MissingExtra("pyarrow", "lerobot") from None
    return pyarrow, pyarrow.parquet


@dataclass(frozen=True)
class Info:
    """What `meta/info.json` says: `told` is all of it."""

    folder: Path
    given: dict[str, Any]
    rate: float
    features: dict[str, dict[str, Any]]
    splits: dict[str, range]

    @property
    def old(self) -> bool:
        """Whether each episode has files of its own, as in v2.1."""
        return bool(self.given["codebase_version"] == OLD)

    @property
    def chunk(self) -> int:
        """How many files, or in v2.1 episodes, a folder of them holds."""
        stated = self.given.get("chunks_size")
        return stated if isinstance(stated, int) and stated > 0 else FILES

    def path(self, number: int, row: Mapping[str, Any], prefix: str, **more: str) -> Path:
        """The file with an episode's rows (`prefix` is data) or of one of its videos. Raises BadInput."""
        if not self.old:
            where = {name: row.get(f"{prefix}/{name}") for name in ("chunk_index", "file_index")}
        else:
            where = {"episode_chunk": number // self.chunk, "episode_index": number}
        template = self.given.get("video_path" if more else "data_path")
        if all(isinstance(value, int) and 0 <= value < 2**31 for value in where.values()):
            path = self.folder / filled(str(template)[:200], {**where, **more})
            if below(path, self.folder):
                files.see_inside(self.folder, path)
                return path
        found, expected = f"{template!s:.60}, {where}", "a file of the dataset"
        raise BadInput(self.folder / INFO, prefix, found=found, expected=expected)

    def of_kind(self, *kinds: str) -> list[str]:
        """Keys of the features of some dtypes."""
        return [key for key, one in self.features.items() if one["dtype"] in kinds]

    def shape(self, key: str) -> tuple[int, ...]:
        """Shape of one value of a feature."""
        return tuple(self.features[key]["shape"])


def below(path: Path, folder: Path) -> bool:
    """Whether a path that a file of the dataset states stays in the folder; the folder's own may go up."""
    return path.is_relative_to(folder) and ".." not in path.relative_to(folder).parts


def in_version(given: Mapping[str, Any], version: str) -> dict[str, Any]:
    """A description in another version, in which files have other places. Sizes of files stay, for a way back. In the
    same version files have the places of that version, whatever the recorder called them."""
    if given["codebase_version"].startswith(version[: len(VERSION)]):
        return dict(given) | {
            name: place for name, place in OLD_PLACES.items() if version == OLD and given.get(name)
        }
    kept = {name: value for name, value in given.items() if name not in OLD_TOTALS}
    kept["codebase_version"] = version
    if version == OLD:
        return kept | OLD_PLACES
    sizes = {"data_files_size_in_mb": 100, "video_files_size_in_mb": 200}
    return sizes | kept | {"data_path": DATA_PATH, "video_path": VIDEO_PATH}


def info(folder: Path) -> Info:
    """The description of the dataset in a folder. Raises BadInput."""
    path = folder / INFO
    given = read_json(path, "a description")
    if not isinstance(given, dict) or not isinstance(given.get("codebase_version"), str):
        raise BadInput(path, "codebase_version", found="none", expected="a LeRobot dataset")
    if given["codebase_version"] != OLD and not given["codebase_version"].startswith(VERSION):
        expected = "v2.1 or v3.0 (lerobot's convert_dataset_v20_to_v21 makes v2.1 of v2.0)"
        raise BadInput(path, "codebase_version", found=given["codebase_version"], expected=expected)
    rate = given.get("fps")
    if isinstance(rate, bool) or not isinstance(rate, (int, float)) or not 0 < rate < 100_000:
        raise BadInput(path, "fps", found=repr(rate)[:40], expected="frames a second")
    return Info(folder, given, float(rate), _features(path, given), _splits(path, given))


def _features(path: Path, given: dict[str, Any]) -> dict[str, dict[str, Any]]:
    features = given.get("features")
    if not isinstance(features, dict) or not features:
        raise BadInput(path, "features", found="none", expected="a feature by each key")
    for key, one in features.items():
        shape = one.get("shape") if isinstance(one, dict) else None
        whole = isinstance(shape, list) and all(
            isinstance(side, int) and 0 < side < 2**24 for side in shape
        )
        if (
            not whole
            or not isinstance(one.get("dtype"), str)
            or set("/\\\0{}") & set(key)
            or ".." in key
        ):
            found, expected = repr(one)[:80], "a plain name, a dtype and a shape"
            raise BadInput(path, f"features.{key}"[:80], found=found, expected=expected)
        for name in ("info", "video_info"):
            if not isinstance(one.get(name) or {}, dict):
                expected = "what is told of a video"
                raise BadInput(
                    path, f"features.{key}.{name}"[:80], found="no map", expected=expected
                )
    return features


def _splits(path: Path, given: dict[str, Any]) -> dict[str, range]:
    """Episode numbers of each split; all are for training where nothing is said."""
    total = given.get("total_episodes")
    if isinstance(total, bool) or not isinstance(total, int) or not 0 <= total <= MOST:
        raise BadInput(path, "total_episodes", found=repr(total)[:40], expected="a number")
    stated = given.get("splits") or ({"train": f"0:{total}"} if total else {})
    try:
        found = {
            name: range(*(int(part) for part in str(span).split(":", 1)))
            for name, span in stated.items()
        }
    except (AttributeError, TypeError, ValueError):
        raise BadInput(
            path, "splits", found=repr(stated)[:80], expected="name: first:end"
        ) from None
    for name, span in found.items():
        if (
            not name
            or set("/\\\0") & set(name)
            or name.startswith(".")
            or name in ("meta", "data", "videos")
        ):
            raise BadInput(path, "splits", found=repr(name)[:40], expected="a name")
        if span.start < 0 or span.stop > total:
            raise BadInput(
                path, f"splits.{name}", found=f"{stated[name]}", expected=f"within 0:{total}"
            )
    ends = sorted((span.start, span.stop) for span in found.values() if len(span))
    if any(one[1] > other[0] for one, other in pairwise(ends)):
        raise BadInput(path, "splits", found="an episode in two", expected="each in one")
    return found


def table(path: Path, columns: list[str] | None = None, episode: int | None = None) -> Any:
    """A parquet file's rows, or those of one episode, of which a few are in memory that are another's. Raises BadInput
    for what is no parquet or damaged, and for an absurd size."""
    pa, pq = arrow()
    if not path.is_file():
        raise BadInput(path, "file", found="nothing", expected="a parquet file")
    try:
        # Buffered ahead, as by default, a whole row group is in memory while one episode of it is looked for.
        with pq.ParquetFile(path, buffer_size=BUFFER, pre_buffer=False) as file:
            about = file.metadata
            groups = [about.row_group(i) for i in range(about.num_row_groups)]
            size = sum(group.total_byte_size for group in groups)
            if not 0 <= size <= LARGEST or about.num_rows > LARGEST:
                raise BadInput(path, "size", found=f"{size} bytes", expected=f"at most {LARGEST}")
            if episode is None:
                return file.read(columns, use_threads=False)
            wanted = [i for i, group in enumerate(groups) if _may_hold(group, episode)]
            return _rows_of(file, wanted, columns, episode)
    except (pa.ArrowException, OSError, ValueError, KeyError, TypeError) as error:
        found = str(error).split("\n")[0][:120]
        raise BadInput(path, "parquet", found=found, expected="a whole table") from None


def _rows_of(file: Any, groups: list[int], columns: list[str] | None, episode: int) -> Any:
    """The rows of an episode, which lie together: some recorders write all episodes of a file as one row group."""
    pa, _ = arrow()
    import pyarrow.compute as compute

    schema, kept = file.schema_arrow, []
    for batch in file.iter_batches(ROWS, groups, columns, use_threads=False):
        own = batch.filter(compute.equal(batch["episode_index"], episode))
        if own.num_rows:
            kept.append(own)
        elif kept:
            break
    if not kept:
        return schema.empty_table().select(columns or schema.names)
    return pa.Table.from_batches(kept).replace_schema_metadata(schema.metadata)


def _may_hold(group: Any, episode: int) -> bool:
    """Whether rows of an episode may be in a row group, by what the file says of it."""
    for i in range(group.num_columns):
        column = group.column(i)
        if column.path_in_schema == "episode_index" and column.is_stats_set:
            held = column.statistics
            return not held.has_min_max or bool(held.min <= episode <= held.max)
    return True


def lines(path: Path) -> list[dict[str, Any]]:
    """The objects of a file with one a line. Raises BadInput."""
    found = []
    for number, line in enumerate(files.read_bytes(path).splitlines()):
        try:
            one = json.loads(line)
        except (ValueError, RecursionError):
            one = None
        if not isinstance(one, dict):
            raise BadInput(path, f"line {number + 1}", found="something else", expected="an object")
        found.append(one)
    return found


@lru_cache(4)
def _episodes(folder: Path, _: int) -> dict[int, dict[str, Any]]:
    rows: dict[int, dict[str, Any]] = {}
    for row in lines(folder / OLD_EPISODES) if (folder / OLD_EPISODES).is_file() else ():
        number, length = row.get("episode_index"), row.get("length")
        if number != len(rows) or not isinstance(length, int) or not 0 <= length < 2**31:
            found, expected = repr((number, length))[:80], f"{len(rows)} and a length"
            raise BadInput(folder / OLD_EPISODES, "episode_index", found=found, expected=expected)
        at = rows[number - 1]["dataset_to_index"] if number else 0
        rows[number] = row | {"dataset_from_index": at, "dataset_to_index": at + length}
    for path in sorted((folder / EPISODES).glob("*/*.parquet")):
        names = arrow()[1].read_schema(path).names if path.stat().st_size else []
        kept = [name for name in names if not name.startswith("stats/")]
        for row in table(path, kept or None).to_pylist():
            number = row.get("episode_index")
            if not isinstance(number, int) or number in rows:
                found, expected = f"{number!r}, twice or no number", "each episode once"
                raise BadInput(path, "episode_index", found=found, expected=expected)
            rows[number] = row
    return rows


def episodes(folder: Path) -> dict[int, dict[str, Any]]:
    """The table of episodes without their statistics, by number. Raises BadInput."""
    pa, _ = arrow()
    try:
        return _episodes(folder, (folder / INFO).stat().st_mtime_ns)
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        found = str(error).split("\n")[0][:120]
        raise BadInput(folder / EPISODES, "parquet", found=found, expected="a table") from None


def episode(folder: Path, number: int) -> dict[str, Any]:
    """What the table of episodes says of one. Raises BadInput."""
    rows = episodes(folder)
    if number not in rows:
        found = f"{len(rows)} episodes"
        raise BadInput(folder / EPISODES, f"episode {number}", found=found, expected="a row")
    return rows[number]


@lru_cache(4)
def _counted(folder: Path, _: int) -> list[Any]:
    """By number what the dataset holds of each episode's statistics: a line, or the table and the row in it."""
    if (folder / OLD_STATISTICS).is_file():
        return list(files.read_bytes(folder / OLD_STATISTICS).splitlines())
    found = {}
    for path in sorted((folder / EPISODES).glob("*/*.parquet")):
        names = [name for name in arrow()[1].read_schema(path).names if name.startswith("stats/")]
        held = table(path, ["episode_index", *names])
        found |= {number: (held, i) for i, number in enumerate(held["episode_index"].to_pylist())}
    return [found.get(number) for number in range(len(found))]


def statistics(folder: Path, number: int) -> dict[str, Any]:
    """What was recorded as the statistics of an episode, by feature and name, unchecked; nothing where none are."""
    try:
        given = _counted(folder, (folder / INFO).stat().st_mtime_ns)[number]
        if isinstance(given, bytes):
            line = json.loads(given)
            return dict(line["stats"]) if line["episode_index"] == number else {}
        held, i = given
        found: dict[str, Any] = {}
        for name in held.column_names[1:]:
            key, _, what = name.removeprefix("stats/").rpartition("/")
            if (value := held[name][i].as_py()) is not None:
                found.setdefault(key, {})[what] = value
    except (BadInput, OSError, LookupError, ValueError, TypeError, RecursionError):
        return {}
    return found


def tasks(folder: Path) -> dict[int, str]:
    """The words of each task by its index. Raises BadInput."""
    if (folder / OLD_TASKS).is_file():
        listed = [(row.get("task_index"), row.get("task")) for row in lines(folder / OLD_TASKS)]
        return _words(listed)
    return vocabulary(folder / TASKS)


def vocabulary(path: Path) -> dict[int, str]:
    """Words by their numbers, of a table with both. Raises BadInput."""
    held = table(path)
    number = next((name for name in held.column_names if name.endswith("_index")), None)
    words = next((name for name in held.column_names if name != number), None)
    if words is None or number is None:
        found, expected = f"columns {held.column_names}"[:80], "numbers and words"
        raise BadInput(path, "columns", found=found, expected=expected)
    return _words(zip(held[number].to_pylist(), held[words].to_pylist(), strict=True))


def _words(rows: Iterable[tuple[Any, Any]]) -> dict[int, str]:
    return {
        number: text for number, text in rows if isinstance(number, int) and isinstance(text, str)
    }


def filled(template: str, values: dict[str, Any]) -> str:
    """A path from its template: names in braces, with a width of up to nine digits. Nothing else is looked up."""

    def one(match: re.Match[str]) -> str:
        value = values.get(match[1], match[0])
        return str(value).zfill(int(match[2] or 0)) if isinstance(value, int) else str(value)

    return re.sub(r"\{(\w+)(?::0?(\d)d)?\}", one, template)
