"""All texts of a LeRobot episode follow an edit: subtasks, lerobot's language columns, columns of instructions, and the
several instructions of a converted episode. Nothing else changes."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")

import pyarrow as pa
import pyarrow.parquet as pq
from lerobot_samples import episode
from rpaug_adapters.lerobot import LeRobot, describe, tables

from rpaug import Unsupported

LANGUAGE = pa.list_(
    pa.struct(
        [
            pa.field("role", pa.string(), nullable=False),
            pa.field("content", pa.string()),
            pa.field("style", pa.string()),
            pa.field("tool_calls", pa.list_(pa.json_())),
        ]
    )
)
SUBTASKS = ("reach", "lift the red cup")
KEY = "toy/train/0"


def said(content: str) -> dict[str, object]:
    return {
        "role": "user",
        "content": content,
        "style": "plan",
        "tool_calls": ['{"say":"red cup"}'],
    }


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    """One episode with every kind of text."""
    adapter, root = LeRobot(), tmp_path / "in"
    made = replace(episode(1, 3), descriptions=("pick the red cup", "take the red cup"))
    adapter.write(made, root, KEY, dict)
    adapter.finish(root, root)
    folder = root / "toy"
    (path,) = (folder / "data").glob("*/*.parquet")
    rows = pq.read_table(path)
    content = [[{**said("grab the red cup"), "tool_calls": None}], [], [said("done")]]
    stored = pa.list_(
        pa.struct([*[LANGUAGE.value_type.field(i) for i in range(3)],
                   pa.field("tool_calls", pa.list_(pa.string()))])
    )  # fmt: skip
    columns = {
        "subtask_index": pa.array([0, 1, 1]),
        "language_events": pa.array(content, stored).cast(LANGUAGE),
        "language_instruction_2": pa.array(["fetch the red cup"] * 3),
        "note": pa.array(["fetch the red cup"] * 3),
    }
    for name, column in columns.items():
        rows = rows.append_column(name, column)
    pq.write_table(rows, path)
    describe.write_words(
        folder / tables.SUBTASKS, "subtask", {text: i for i, text in enumerate(SUBTASKS)}
    )
    given = json.loads((folder / tables.INFO).read_text())
    kinds = dict(zip(columns, ("int64", "language", "string", "string"), strict=True))
    given["features"] |= {
        name: {"dtype": kind, "shape": [1], "names": None} for name, kind in kinds.items()
    }
    given["features"]["observation.images.front"]["info"]["camera.intrinsics"] = [[50, 0, 24]]
    (folder / tables.INFO).write_text(json.dumps(given))
    return root


def copied(root: Path, out: Path, new: tuple[str, ...] | None = None) -> tuple[dict, pa.Table]:
    """The episode written with such words; its row and its rows."""
    adapter = LeRobot()
    read = adapter.read(root, KEY)
    adapter.write(replace(read, descriptions=new or read.descriptions), out, KEY, dict)
    adapter.finish(root, out)
    (path,) = (out / "toy/data").glob("*/*.parquet")
    return tables.episode(out / "toy", 0), pq.read_table(path)


def test_all_texts_are_instructions(recorded: Path) -> None:
    assert LeRobot().read(recorded, KEY).descriptions == (
        "pick the red cup", "take the red cup", *SUBTASKS, "grab the red cup", "done",
        "fetch the red cup",
    )  # fmt: skip


def test_every_text_follows(recorded: Path, tmp_path: Path) -> None:
    before = LeRobot().read(recorded, KEY).descriptions
    new = tuple(text.replace("red", "blue") for text in before)
    row, rows = copied(recorded, tmp_path / "out", new)
    words = tables.vocabulary(tmp_path / "out/toy" / tables.SUBTASKS)
    assert row["tasks"] == ["pick the blue cup", "take the blue cup"]
    assert [words[i] for i in rows["subtask_index"].to_pylist()] == [
        "reach",
        *["lift the blue cup"] * 2,
    ]
    assert rows["language_events"].type == LANGUAGE
    events = rows["language_events"].to_pylist()
    assert [one["content"] for frame in events for one in frame] == ["grab the blue cup", "done"]
    assert rows["language_instruction_2"].to_pylist() == ["fetch the blue cup"] * 3
    assert rows["note"].to_pylist() == ["fetch the red cup"] * 3
    assert LeRobot().read(tmp_path / "out", KEY).descriptions == new


def test_without_an_edit_all_is_as_it_was(recorded: Path, tmp_path: Path) -> None:
    row, rows = copied(recorded, tmp_path / "out")
    (path,) = (recorded / "toy/data").glob("*/*.parquet")
    assert rows.select(pq.read_schema(path).names).equals(pq.read_table(path))
    assert row["tasks"] == ["pick the red cup", "take the red cup"]
    given, made = (
        json.loads((root / "toy" / tables.INFO).read_text())
        for root in (recorded, tmp_path / "out")
    )
    assert made == given | {"total_tasks": 2}  # calibration and all


@pytest.mark.parametrize("column", ["action", "observation.joint_positions", "timestamp"])
def test_verify_sees_what_no_edit_reaches(recorded: Path, tmp_path: Path, column: str) -> None:
    adapter = LeRobot()
    copied(recorded, tmp_path / "out")
    (path,) = (tmp_path / "out/toy/data").glob("*/*.parquet")
    rows = pq.read_table(path)
    values = rows[column].to_pylist()
    values[0] = values[2]
    at = rows.schema.get_field_index(column)
    pq.write_table(rows.set_column(at, column, pa.array(values, rows[column].type)), path)
    before, after = (
        adapter.untouched(adapter.read(root, KEY), False) for root in (recorded, tmp_path / "out")
    )
    found = {name for name in before if before[name] != after[name]}
    assert found == {column}


def test_rows_that_are_no_json_are_refused(recorded: Path, tmp_path: Path) -> None:
    read = LeRobot().read(recorded, KEY)
    odd = replace(read, source=replace(read.source, row={"when": b"\0"}))
    with pytest.raises(Unsupported, match="table of episodes"):
        LeRobot().write(odd, tmp_path / "out", KEY, dict)
