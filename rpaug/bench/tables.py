"""Measured rows as files: CSV for spreadsheets, JSON for programs."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from typing import Any


def as_csv(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """One line a row under the first row's keys; nothing is left for None."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def as_json(setting: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], **more: Any) -> bytes:
    """What was asked for, anything more, and all rows in one document."""
    return (json.dumps({"setting": setting, **more, "rows": rows}, indent=1) + "\n").encode()
