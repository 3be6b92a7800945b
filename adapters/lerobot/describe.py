"""What a gathered LeRobot dataset says of itself: its table of episodes, their statistics, its words; and where what
one says is not so."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rpaug_adapters.lerobot import stats, tables, words
from rpaug_adapters.lerobot.tables import (
    EPISODES_PATH,
    INFO,
    OLD_EPISODES,
    OLD_STATISTICS,
    OLD_TASKS,
    STATS,
    TASKS,
    Info,
    filled,
)

from rpaug import BadInput, files


def episodes(
    about: Info,
    work: Path,
    rows: list[dict[str, Any]],
    tasks: dict[str, int],
    counted: list[dict[str, Any]],
) -> None:
    """Write the episodes' `rows`, their statistics `counted`, and the numbers of the tasks. Raises BadInput."""
    (_old_episodes if about.old else _episodes)(work, rows, tasks, counted)


def low_dimensional(about: Info, work: Path) -> None:
    """The statistics that GR00T's loader wants, of the tables that are in their place."""
    found = {}
    for key, feature in about.features.items():
        if "float" in feature["dtype"] and len(feature["shape"]) == 1:
            found[key] = stats.low_dimensional(_column(about.folder, key))
    files.write_atomic(work / STATS, json.dumps(found, indent=4).encode())


def _old_episodes(
    work: Path, rows: list[dict[str, Any]], tasks: dict[str, int], counted: list[dict[str, Any]]
) -> None:
    """Episodes, their statistics and the tasks, an object a line, as v2.1 has them: of images the statistics of three
    channels alone, since its loader refuses others."""
    kept = [
        {key: one for key, one in statistics.items() if "image" not in key or len(one["mean"]) == 3}
        for statistics in counted
    ]
    listed = {
        OLD_EPISODES: [
            {name: row[name] for name in ("episode_index", "tasks", "length")} | words.beside(row)
            for row in rows
        ],
        OLD_STATISTICS: [{"episode_index": i, "stats": one} for i, one in enumerate(kept)],
        OLD_TASKS: [{"task_index": index, "task": text} for text, index in tasks.items()],
    }
    (work / "meta").mkdir()
    for name, objects in listed.items():
        text = "".join(json.dumps(one, ensure_ascii=False) + "\n" for one in objects)
        (work / name).write_text(text, encoding="utf-8")


def _episodes(
    work: Path, rows: list[dict[str, Any]], tasks: dict[str, int], counted: list[dict[str, Any]]
) -> None:
    """The table of episodes with their statistics, those of all, and the tasks with their words as pandas' index."""
    pa, pq = tables.arrow()
    for row, statistics in zip(rows, counted, strict=True):
        for key, one in statistics.items():
            row |= {f"stats/{key}/{name}": value for name, value in one.items()}
    every = stats.plain(stats.together(counted))
    files.write_atomic(work / STATS, json.dumps(every, indent=4).encode())
    place = {"chunk_index": 0, "file_index": 0}
    here = {f"meta/episodes/{name}": value for name, value in place.items()}
    target = work / filled(EPISODES_PATH, place)
    target.parent.mkdir(parents=True, exist_ok=True)
    names = dict.fromkeys(name for row in rows for name in row)
    columns = {name: [row.get(name) for row in rows] for name in names}
    columns |= {name: [value] * len(rows) for name, value in here.items()}
    try:
        every_row = pa.table(columns)
    except (pa.ArrowException, TypeError) as error:
        found, expected = str(error).split("\n")[0][:120], "values of one kind a column"
        raise BadInput(target, "table of episodes", found=found, expected=expected) from None
    pq.write_table(every_row, target, compression="snappy")
    write_words(work / TASKS, "task", tasks)


def write_words(path: Path, name: str, numbers: dict[str, int]) -> None:
    """Numbers, and the words as pandas' index."""
    pa, pq = tables.arrow()
    column = {"metadata": None, "numpy_type": "object", "pandas_type": "unicode"}
    index = f"{name}_index"
    pandas = {
        "index_columns": [name],
        "column_indexes": [],
        "columns": [
            {
                **column,
                "name": index,
                "field_name": index,
                "numpy_type": "int64",
                "pandas_type": "int64",
            },
            {**column, "name": name, "field_name": name},
        ],
        "pandas_version": "2.0.0",
    }
    listed = pa.table({index: list(numbers.values()), name: list(numbers)})
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(listed.replace_schema_metadata({"pandas": json.dumps(pandas)}), path)


def faults(folder: Path) -> Iterator[str]:
    """Where a gathered dataset's description or statistics are not those of its rows."""
    about = tables.info(folder)
    if not about.given.get("total_episodes"):
        return
    rows = tables.episodes(folder)
    at = 0
    for number in range(about.given["total_episodes"]):
        row = rows.get(number, {})
        if (row.get("dataset_from_index"), row.get("dataset_to_index")) != (
            at,
            at + (row.get("length") or 0),
        ):
            found = row.get("dataset_from_index")
            place = f"{folder / 'meta/episodes'}: episode {number}: dataset_from_index"
            yield f"{place}: found {found}; expected {at}, and as many rows as its length"
            return
        at = row["dataset_to_index"]
    if about.given.get("total_frames") != at:
        found = about.given.get("total_frames")
        yield f"{folder / INFO}: total_frames: found {found}; expected {at}, as the episodes have"
    given = json.loads(files.read_bytes(folder / STATS)) if (folder / STATS).is_file() else {}
    for key, feature in about.features.items():
        if feature["dtype"].startswith("float") and len(feature["shape"]) == 1 and key in given:
            values = _column(folder, key)
            found = stats.plain({key: stats.of_numbers(values)})[key]
            for name in (*stats.MOMENTS, *(() if about.old else ("count",))):
                if not np.allclose(given[key].get(name, np.nan), found[name], atol=1e-4, rtol=1e-3):
                    stated = (
                        f"found {given[key].get(name)}; expected {found[name]}, as the rows have"
                    )
                    yield f"{folder / STATS}: {key}: {name}: {stated}"
                    break


def _column(folder: Path, key: str) -> np.ndarray:
    """A feature's numbers of all frames."""
    parts = [tables.table(path, [key]) for path in sorted((folder / "data").glob("*/*.parquet"))]
    return np.asarray([value for held in parts for value in held[key].to_pylist()], np.float64)
