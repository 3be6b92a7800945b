"""Timed renders: what is measured, and how far it is from the reference."""

import json

import pytest
from analytic import scene
from typer.testing import CliRunner

from rpaug.core.errors import RpaugError
from tools.bench.harness import renders
from tools.bench.harness.sources import Origin
from tools.bench.renders import app

SMALL = renders.RenderSetting(sizes=((24, 16),), counts=(50,), engines=renders.ENGINES, repeats=1)


def test_the_kernels_stay_close_to_the_reference_and_the_reference_to_itself() -> None:
    rows, skipped = renders.run(SMALL, renders.strewn_scenes(SMALL))
    found = {row.engine: row for row in rows}
    assert found["numba/float32"].color_worst < 1e-4
    assert found["numba/float32"].gradient_error < 1e-4
    assert found["reference/float64"].color_worst == found["reference/float64"].gradient_error == 0
    assert set(skipped) | set(found) == set(renders.ENGINES)
    if "gsplat/float32" in skipped:
        assert "gsplat" in skipped["gsplat/float32"]


def test_what_the_reference_cannot_afford_is_not_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(renders, "AFFORDABLE", 1_000)
    rows, _ = renders.run(SMALL, renders.strewn_scenes(SMALL))
    found = {row.engine: row for row in rows}
    assert found["reference/float64"].forward_ms is None
    assert found["numba/float32"].color_worst < 1e-4  # on a crop


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


def test_the_command_writes_table_json_and_plot(tmp_path) -> None:  # type: ignore[no-untyped-def]
    arguments = ["--size", "24x16", "--gaussians", "50", "--repeats", "1"]
    engines = ["--engine", "numba/float32", "--engine", "reference/float64"]
    done = CliRunner().invoke(app, [*arguments, *engines, "--out", str(tmp_path / "o"), "--json"])
    assert done.exit_code == 0
    assert len(json.loads(done.stdout)["rows"]) == 2
    assert {path.name for path in (tmp_path / "o").iterdir()} == {
        "render.csv", "render.json", "render.png",
    }  # fmt: skip
    wrong = CliRunner().invoke(app, ["--size", "24", "--out", str(tmp_path)])
    assert wrong.exit_code == 2
    assert "WIDTHxHEIGHT" in wrong.stderr
