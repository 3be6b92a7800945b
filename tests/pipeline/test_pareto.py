"""Rows of speed and error: files that can be read again, and which rows nothing beats."""

import csv
import io
import json

import numpy as np

from rpaug.pipeline import pareto


def test_the_front_is_what_nothing_beats() -> None:
    seconds = np.array([1.0, 2.0, 2.0, 3.0, 1.0, np.nan])
    error = np.array([5.0, 3.0, 4.0, 3.0, 5.0, 0.0])
    assert pareto.front(seconds, error).tolist() == [True, True, False, False, True, False]


def test_rows_come_back_from_csv_and_json() -> None:
    rows = [{"a": 1.5, "b": None}, {"a": 2.0, "b": "x"}]
    assert next(iter(csv.DictReader(io.StringIO(pareto.as_csv(rows).decode())))) == {
        "a": "1.5",
        "b": "",
    }
    assert json.loads(pareto.as_json({"seed": 3}, rows))["rows"] == rows


def test_unbeaten_rows_come_the_fastest_first() -> None:
    panel = pareto.Panel("", "seconds", "db", "", "")
    rows = [{"seconds": s, "db": db} for s, db in ((9.0, 30.0), (1.0, 20.0), (5.0, 19.0))]
    assert pareto.unbeaten(rows, panel) == [rows[1], rows[0]]
