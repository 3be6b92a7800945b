"""An episode's own table: its bytes tell its rows, not the way they came."""

import tempfile
from collections.abc import Mapping
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")

import pyarrow as pa
from hypothesis import given, settings
from hypothesis import strategies as st
from rpaug_adapters.lerobot import staged, tables

ROWS = 24
IMAGE = 100_000  # bytes: the column takes several of Parquet's pages, and where one ends is what may differ


@cache
def rows() -> Any:
    rng = np.random.default_rng(0)
    columns: Mapping[str, Any] = {
        "frame_index": np.arange(ROWS),
        "observation.state": [row.tolist() for row in rng.normal(size=(ROWS, 3))],
        "task": ["pick it up" if t < 5 else None for t in range(ROWS)],
        "image": [{"bytes": rng.bytes(IMAGE + t), "path": None} for t in range(ROWS)],
    }
    return pa.table(dict(columns)).replace_schema_metadata({b"huggingface": b"{}"})


def written(table: Any) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        staged.write(table, Path(folder))
        return (Path(folder) / tables.STAGED).read_bytes()


@settings(max_examples=20, deadline=None)
@given(st.sets(st.integers(1, ROWS - 1)), st.integers(0, 5))
def test_equal_rows_give_equal_bytes_however_they_were_read(cuts: set[int], before: int) -> None:
    """In pieces of any lengths, and as a slice out of a longer table, as shared files give them."""
    whole = rows()
    ends = [0, *sorted(cuts), ROWS]
    pieces = [whole.slice(a, b - a) for a, b in pairwise(ends)]
    longer = pa.concat_tables([whole.slice(0, before), *pieces])
    assert longer.slice(before).equals(whole)
    assert written(longer.slice(before)) == written(whole)
