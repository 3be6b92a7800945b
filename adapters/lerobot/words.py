"""The texts of a LeRobot episode, wherever they are, so that all of them follow an edit.

They are: the task of each frame; the tasks of the episode, of which GR00T draws one; columns that number tasks (GR00T's
annotations, as `meta/modality.json` names them) or subtasks; columns of text; lerobot's language columns; texts in the
table of episodes. A column that numbers words holds the words themselves in an episode's own folder.
"""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from rpaug_adapters.lerobot import tables
from rpaug_adapters.lerobot.tables import Info

from rpaug import BadInput, Episode, files

MODALITY = "meta/modality.json"
SUBTASK = "subtask_index"
NAMES = ("task", "instruction", "language", "annotation")  # in the names of what holds words
COUNTED = ("episode_index", "length", "dataset_from_index", "dataset_to_index")
PLACES = ("data/", "videos/", "stats/", "meta/")  # of the table of episodes: counted anew, too


def spoken(about: Info, rows: Any) -> Any:
    """The rows, with words where a column numbers them; one that numbers none stays."""
    pa, _ = tables.arrow()
    for key, words in _numbered(about).items():
        at = rows.schema.get_field_index(key)
        if at < 0 or not pa.types.is_integer(rows.schema.types[at]):
            continue
        texts = [words.get(index) for index in rows[key].to_pylist()]
        if None not in texts:
            rows = rows.set_column(at, key, pa.array(texts, pa.string()))
    return rows


def _numbered(about: Info) -> dict[str, dict[int, str]]:
    """The columns, but `task_index`, that number words, and the words by number."""
    found = {}
    if SUBTASK in about.features and (about.folder / tables.SUBTASKS).is_file():
        found[SUBTASK] = tables.vocabulary(about.folder / tables.SUBTASKS)
    try:
        annotations = json.loads(files.read_bytes(about.folder / MODALITY))["annotation"]
        keys = {
            (one or {}).get("original_key") or f"annotation.{name}"
            for name, one in annotations.items()
        }
    except (BadInput, ValueError, RecursionError, LookupError, TypeError, AttributeError):
        return found  # none, or GR00T's own loader would not take it
    numbered = tables.tasks(about.folder)
    return found | {key: numbered for key in about.features if key in keys and key != "task_index"}


def columns(about: Info, rows: Any) -> list[str]:
    """The columns of rows that hold words, but the frames' own tasks."""
    pa, _ = tables.arrow()
    return [
        key
        for key, feature in about.features.items()
        if key in rows.column_names
        and (
            feature["dtype"] == "language"
            or (
                pa.types.is_string(rows.schema.field(key).type)
                and (feature["dtype"] != "string" or any(name in key for name in NAMES))
            )
        )
    ]


def beside(row: Mapping[str, Any]) -> dict[str, Any]:
    """What the table of episodes says of one that is not counted anew, its tasks among it."""
    return {
        name: value
        for name, value in row.items()
        if name not in COUNTED and not name.startswith(PLACES) and value is not None
    }


def tasks(row: Mapping[str, Any]) -> list[str]:
    """The tasks that the table of episodes gives one."""
    given = row.get("tasks")
    return [text for text in given if isinstance(text, str)] if isinstance(given, list) else []


def distinct(
    about: Info, rows: Any, said: tuple[str, ...], row: Mapping[str, Any]
) -> tuple[str, ...]:
    """All texts of an episode, once each; those of its frames first."""
    texts = dict.fromkeys(said)
    for name, value in row.items():
        if any(one in name for one in NAMES):
            texts |= dict.fromkeys(_strings(value))
    for key in columns(about, rows):
        fields = rows[key].to_pylist()
        if about.features[key]["dtype"] == "language":
            fields = [
                one.get("content")
                for frame in fields
                for one in frame or ()
                if isinstance(one, dict)
            ]
        texts |= dict.fromkeys(_strings(fields))
    return tuple(text for text in texts if text)


def _strings(value: object) -> Iterator[str]:
    """The texts in plain values."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for one in value.values() if isinstance(value, dict) else value:
            yield from _strings(one)


def changed(old: tuple[str, ...], episode: Episode) -> dict[str, str]:
    """New words by the recorded ones: one for one where as many came back, else the instruction for all."""
    new = episode.descriptions
    if len(old) != len(new):
        return dict.fromkeys(old or ("",), episode.instruction)
    return {before: after for before, after in zip(old, new, strict=True) if before != after}


def replaced(value: Any, now: Mapping[str, str]) -> Any:
    """Plain values with new words in the place of the recorded."""
    if isinstance(value, str):
        return now.get(value, value)
    if isinstance(value, list):
        return [replaced(one, now) for one in value]
    if isinstance(value, dict):
        return {name: replaced(one, now) for name, one in value.items()}
    return value


def row_replaced(row: Mapping[str, Any], now: Mapping[str, str]) -> dict[str, Any]:
    """What the table of episodes says, with new words."""
    return {
        name: replaced(value, now) if any(one in name for one in NAMES) else value
        for name, value in row.items()
    }


def column_replaced(column: Any, now: Mapping[str, str]) -> Any:
    """A column with new words."""
    pa, _ = tables.arrow()
    values = replaced(column.to_pylist(), now)
    return pa.array(values, _stored(column.type)).cast(column.type)


def _stored(kind: Any) -> Any:
    """A type as Arrow stores it: without extensions, which it cannot build."""
    pa, _ = tables.arrow()
    if isinstance(kind, pa.BaseExtensionType):
        return _stored(kind.storage_type)
    if pa.types.is_struct(kind):
        return pa.struct(
            [kind.field(i).with_type(_stored(kind.field(i).type)) for i in range(kind.num_fields)]
        )
    if pa.types.is_list(kind):
        return pa.list_(kind.value_field.with_type(_stored(kind.value_type)))
    return kind
