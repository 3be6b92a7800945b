"""Gathering the episodes' own tables into shared files of frames, a row group an episode.

A file takes its place in the dataset as soon as it is whole, and its episodes' own tables leave out then what it holds:
no more than one file lies there twice.
"""

import json
import os
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import numpy as np
from rpaug_adapters.lerobot import staged, stats, tables, words
from rpaug_adapters.lerobot.read import decode_images, encoded, read_row
from rpaug_adapters.lerobot.tables import DATA_PATH, STAGED, Info, filled
from rpaug_adapters.lerobot.write import with_column

from rpaug import files

MIB = 2**20
HUGGING_FACE = b"huggingface"  # key of a table's metadata
Words = dict[str, dict[str, int]]  # numbers of tasks, and of subtasks, by their words


class Files:
    """The file that each episode goes into: one grows for each kind, a new one where it would get larger than told."""

    def __init__(self, most: Any, chunk: int) -> None:
        usable = isinstance(most, (int, float)) and most > 0
        self.most = float(most) * MIB if usable else 100 * MIB
        self.chunk = chunk
        self.begun = 0
        self.growing: dict[Hashable, tuple[int, float]] = {}  # number and size, by kind

    def place(self, size: float, kind: Hashable = None) -> dict[str, int]:
        """Where that many bytes more of a kind go."""
        number, held = self.growing.get(kind, (-1, 0.0))
        if number < 0 or held + size > self.most:
            number, held = self.begun, 0.0
            self.begun += 1
        self.growing[kind] = number, held + size
        return {"chunk_index": number // self.chunk, "file_index": number % self.chunk}


class _SharedFile:
    """A shared file that grows in a folder of its own."""

    def __init__(self, about: Info, work: Path, place: str, schema: Any) -> None:
        self.work, self.target = work / place, about.folder / place
        self.work.parent.mkdir(parents=True, exist_ok=True)
        pq = tables.arrow()[1]
        self.writer = pq.ParquetWriter(self.work, _schema(about, schema), compression="snappy")
        self.held: list[tuple[int, Path]] = []

    def add(self, number: int, own: Path, rows: Any) -> None:
        self.writer.write_table(rows.cast(self.writer.schema))
        self.held.append((number, own))

    def close(self, counted: set[str]) -> None:
        """Take the file's place in the dataset, once its new images were decoded and it is on the disk; then let the
        own tables leave out what it holds: all columns but those that are `counted` anew. Raises BadInput."""
        self.writer.close()
        for number, own in self.held:
            if keys := encoded(own):  # what was recorded is not decoded again
                rows = tables.table(self.work, ["episode_index", *keys], number)
                for key in keys:
                    decode_images(f"{self.work}: episode {number}", rows, key)
        files.flush(self.work)
        self.target.parent.mkdir(parents=True, exist_ok=True)
        os.replace(self.work, self.target)
        shared = {field.name: field for field in self.writer.schema}
        for number, own in self.held:
            rows = tables.table(own / STAGED)
            held = [
                one.name
                for one in rows.schema
                if one.name in shared.keys() - counted and one.equals(shared[one.name], True)
            ]
            staged.lend(own, rows, held, self.target, number)


def gather(
    about: Info,
    work: Path,
    own: list[tuple[str, Path]],
    spoken: Words,
    rows: list[dict[str, Any]],
) -> list[dict[str, dict[str, Any]]]:
    """Write the tables of frames; fills `spoken` and `rows`. New images are decoded before anything is left out.

    Returns, by episode, the statistics of the columns that count in the whole dataset. Raises BadInput.
    """
    pa, _ = tables.arrow()
    shared = Files(about.given.get("data_files_size_in_mb"), about.chunk)
    growing: _SharedFile | None = None
    at, anew, statistics = 0, set[str](), []
    for number, (_, path) in enumerate(own):
        held = tables.table(path / STAGED)
        texts, length = held["task"].to_pylist(), held.num_rows
        row = read_row(path)
        row["tasks"] = list(dict.fromkeys([*words.tasks(row), *texts]))
        _numbers(row["tasks"], spoken["task"])
        counted = {
            "episode_index": [number] * length,
            "index": list(range(at, at + length)),
            **_spoken(about, held, spoken),
        }
        anew |= {"task", *counted}
        held = held.drop_columns(["task"])
        for name, values in counted.items():
            kind = about.features.get(name, {}).get("dtype", "int64")
            held = with_column(held, name, pa.array(values, pa.type_for_alias(kind)))
        size = (path / STAGED).stat().st_size
        row |= {f"data/{name}": value for name, value in shared.place(size).items()}
        place = _data_path(about, number, row)
        if growing is None or growing.target != about.folder / place:
            if growing is not None:
                growing.close(anew)
            growing = _SharedFile(about, work, place, held.schema)
        growing.add(number, path, held)
        span = {"dataset_from_index": at, "dataset_to_index": at + length}
        rows.append({**row, "episode_index": number, "length": length, **span})
        statistics.append(_statistics(about, counted))
        at += length
    if growing is not None:
        growing.close(anew)
    return statistics


def _statistics(about: Info, counted: dict[str, list[int]]) -> dict[str, Any]:
    kept = {name: one for name, one in counted.items() if name in about.features}
    found = stats.plain({name: stats.of_numbers(np.asarray(one)) for name, one in kept.items()})
    return stats.old(found) if about.old else found


def _schema(about: Info, schema: Any) -> Any:
    """The types of the columns. v2.1's loader tells images by what Hugging Face's library writes beside them."""
    images = {key: {"_type": "Image"} for key in about.of_kind("image")}
    given = schema.metadata or {}
    if not about.old or not images or HUGGING_FACE in given:
        return schema
    stated = json.dumps({"info": {"features": images}}).encode()
    return schema.with_metadata({**given, HUGGING_FACE: stated})


def _data_path(about: Info, number: int, row: dict[str, Any]) -> str:
    """Where in the dataset an episode's rows go."""
    if about.old:
        return about.path(number, {}, "data").relative_to(about.folder).as_posix()
    return filled(DATA_PATH, {name: row[f"data/{name}"] for name in ("chunk_index", "file_index")})


def _spoken(about: Info, held: Any, spoken: Words) -> dict[str, list[int]]:
    """The columns that number words."""
    found = {"task_index": _numbers(held["task"].to_pylist(), spoken["task"])}
    for name in words.columns(about, held):
        if about.features[name]["dtype"].startswith("int"):
            kind = "subtask" if name == words.SUBTASK else "task"
            found[name] = _numbers(held[name].to_pylist(), spoken[kind])
    return found


def _numbers(texts: list[str], known: dict[str, int]) -> list[int]:
    """The numbers of words; new ones get new numbers."""
    return [known.setdefault(text, len(known)) for text in texts]
