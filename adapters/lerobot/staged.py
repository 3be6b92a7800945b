"""An episode's own table while its dataset grows: whole, or without the columns that a shared file holds of it already.

So that no more than one shared file lies there twice while episodes are gathered. What is left out, and where it lies,
stands in the table's metadata; put together the table is what it was.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rpaug_adapters.lerobot import tables
from rpaug_adapters.lerobot.tables import STAGED

from rpaug import BadInput, files

LENT = b"rpaug.lent"  # key of the metadata: the shared file, the episode's number in it, all columns in order


def write(rows: Any, own: Path) -> None:
    """Write a table into an episode's own folder; equal rows give equal bytes, however they were read."""
    pa, pq = tables.arrow()
    stream = pa.BufferOutputStream()
    pq.write_table(rows.combine_chunks(), stream, compression="snappy")
    files.write_atomic(own / STAGED, stream.getvalue().to_pybytes(), durable=True)


def read(own: Path) -> Any:
    """The whole table of an episode's own folder. Raises BadInput."""
    rows = tables.table(own / STAGED)
    given = _lent(own, rows.schema)
    if given is None:
        return rows
    pa, _ = tables.arrow()
    path, number, names = given
    missing = [name for name in names if name not in rows.column_names]
    held = tables.table(path, ["episode_index", *missing], number)
    if held.num_rows != rows.num_rows or not {*missing} <= {*held.column_names}:
        found, expected = f"{held.num_rows} rows", f"{rows.num_rows}, with {', '.join(missing)}"
        raise BadInput(path, f"episode {number}", found=found, expected=expected)
    parts = [held if name in missing else rows for name in names]
    metadata = {key: one for key, one in rows.schema.metadata.items() if key != LENT}
    fields = [part.schema.field(name) for part, name in zip(parts, names, strict=True)]
    columns = [part[name] for part, name in zip(parts, names, strict=True)]
    return pa.table(columns, schema=pa.schema(fields, metadata or None))


def lend(own: Path, rows: Any, columns: Sequence[str], path: Path, number: int) -> None:
    """Leave out the columns of an episode's own table that a shared file holds under its number there."""
    place = path.relative_to(_dataset(own)).as_posix()
    given = json.dumps([place, number, rows.column_names]).encode()
    rest = rows.drop_columns(list(columns))
    write(rest.replace_schema_metadata({**(rows.schema.metadata or {}), LENT: given}), own)


def lender(own: Path) -> Path | None:
    """The shared file that holds what the own table lacks; None for a whole table. Raises BadInput."""
    pa, pq = tables.arrow()
    try:
        given = _lent(own, pq.read_schema(own / STAGED))
    except (pa.ArrowException, OSError) as error:
        found = str(error).split("\n")[0][:120]
        raise BadInput(own / STAGED, "parquet", found=found, expected="a table") from None
    return given and given[0]


def _lent(own: Path, schema: Any) -> tuple[Path, int, list[str]] | None:
    data = (schema.metadata or {}).get(LENT)
    if data is None:
        return None
    try:
        place, number, names = json.loads(data)
        path = _dataset(own) / place
        usable = tables.below(path, _dataset(own))
        if usable and isinstance(number, int) and all(isinstance(name, str) for name in names):
            files.see_inside(_dataset(own), path)
            return path, number, names
    except (ValueError, TypeError):
        pass
    expected = "a file of the dataset, a number and names"
    raise BadInput(own / STAGED, "metadata", found=repr(data)[:80], expected=expected)


def _dataset(own: Path) -> Path:
    return own.parent.parent
