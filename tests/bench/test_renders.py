"""Timed renders: what is measured, and how far it is from the reference."""

import csv
import io
import json

import numpy as np
import pytest
from analytic import scene
from typer.testing import CliRunner

from rpaug.bench import pareto, renders, tables
from rpaug.bench.sources import Origin
from rpaug.cli import app
from rpaug.core.errors import RpaugError

SMALL = renders.RenderSetting(sizes=((24, 16),), counts=(50,), engines=renders.ENGINES, repeats=1)


def test_the_kernels_stay_close_to_the_reference_and_the_reference_to_itself() -> None:
    rows, skipped = renders.run(SMALL, renders.strewn_scenes(SMALL))
    found = {row.engine: row for row in rows}
    assert found["numba/float32"].colour_worst < 1e-4
    assert found["numba/float32"].gradient_error < 1e-4
    assert found["reference/float64"].colour_worst == found["reference/float64"].gradient_error == 0
    assert set(skipped) | set(found) == set(renders.ENGINES)
    if "gsplat/float32" in skipped:
        assert "gsplat" in skipped["gsplat/float32"]


def test_what_the_reference_cannot_afford_is_not_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(renders, "AFFORDABLE", 1_000)
    rows, _ = renders.run(SMALL, renders.strewn_scenes(SMALL))
    found = {row.engine: row for row in rows}
    assert found["reference/float64"].forward_ms is None
    assert found["numba/float32"].colour_worst < 1e-4  # on a crop


def test_lifted_gaussians_are_as_many_as_the_pixels_taken() -> None:
    episode = scene({"front": (1.6, 0.3, 1.0), "side": (0.3, 1.6, 1.0)}, length=2).episode
    found = renders.recorded_scenes(episode, 0, [4, 8])
    assert [one.name for one in found] == ["front, ", "side, "] * 2
    assert len(found[0].splats) > 3 * len(found[2].splats) > 0


def test_an_engine_nobody_knows_is_named() -> None:
    with pytest.raises(RpaugError, match="numba/float32"):
        renders.RenderSetting(engines=("cuda",))


def test_a_dataset_or_the_twin_but_not_both() -> None:
    with pytest.raises(RpaugError, match="not both"):
        Origin()


def test_the_front_is_what_nothing_beats() -> None:
    seconds = np.array([1.0, 2.0, 2.0, 3.0, 1.0, np.nan])
    error = np.array([5.0, 3.0, 4.0, 3.0, 5.0, 0.0])
    assert pareto.front(seconds, error).tolist() == [True, True, False, False, True, False]


def test_rows_come_back_from_csv_and_json() -> None:
    rows = [{"a": 1.5, "b": None}, {"a": 2.0, "b": "x"}]
    assert next(iter(csv.DictReader(io.StringIO(tables.as_csv(rows).decode())))) == {
        "a": "1.5",
        "b": "",
    }
    assert json.loads(tables.as_json({"seed": 3}, rows))["rows"] == rows


def test_the_command_writes_table_json_and_plot(tmp_path) -> None:  # type: ignore[no-untyped-def]
    arguments = ["bench", "render", "--size", "24x16", "--gaussians", "50", "--repeats", "1"]
    engines = ["--engine", "numba/float32", "--engine", "reference/float64"]
    done = CliRunner().invoke(app, [*arguments, *engines, "--out", str(tmp_path / "o"), "--json"])
    assert done.exit_code == 0
    assert len(json.loads(done.stdout)["rows"]) == 2
    assert {path.name for path in (tmp_path / "o").iterdir()} == {
        "render.csv", "render.json", "render.png",
    }  # fmt: skip
    wrong = CliRunner().invoke(app, ["bench", "render", "--size", "24", "--out", str(tmp_path)])
    assert wrong.exit_code == 2
    assert "WIDTHxHEIGHT" in wrong.stderr
