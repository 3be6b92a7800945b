"""Tiers beside each other: rows that make sense on scenes known in closed form."""

import json

import numpy as np
import pytest
from analytic import scene
from rollouts import SAMPLE
from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.core.errors import RpaugError, Unsupported
from rpaug.pipeline import left_out, speed_error

EYES = {"front": (1.6, 0.3, 1.0), "side": (1.3, 1.0, 1.0), "overhead": (0.1, -0.9, 1.5)}


@pytest.fixture(scope="module")
def episode():
    return scene(EYES, length=2).episode


def test_a_camera_that_was_left_out_is_shown_from_the_others(episode) -> None:
    known, sights = left_out.left_out(episode, "front", every=1)
    assert "front" not in known.episode.views
    assert {sight.t for sight in sights} == {0, 1}
    assert 0.3 < sights[0].covisible.mean() <= 1
    assert left_out.anchor(sights[0]) == "side"
    (row,) = speed_error.run("front left out", [(known, sights)], speed_error.chosen(["surfels"]))
    assert row.covisible_db > 25
    assert row.depth_median_mm < 1
    assert row.gaussians == 0


def test_every_tier_has_a_row_on_the_same_views(episode) -> None:
    """Two recordings taken together; a fit of three steps shows something, and nothing bends."""
    pairs = [left_out.left_out(episode, "front", every=2) for _ in range(2)]
    done = []
    rows = speed_error.run(
        "front left out", pairs, steps=3, threads=1, progress=lambda: done.append(1)
    )
    assert [row.method for row in rows] == list(speed_error.METHODS)
    assert {(row.recordings, row.views) for row in rows} == {(2, 2)}
    assert len(done) == 2 * len(speed_error.METHODS)
    by_name = {row.method: row for row in rows}
    rigid, bending = by_name["Gaussians"], by_name["Gaussians, also in time"]
    assert bending.covisible_db == rigid.covisible_db
    assert bending.prepare_seconds > rigid.prepare_seconds
    assert by_name["Gaussians of each moment"].gaussians > 500
    assert all(row.covisible_db > 15 for row in rows)


def test_holes_take_the_gaussians_where_they_show_something(monkeypatch) -> None:
    hole = np.array([[True, True, False]])
    base = speed_error.TierView(np.full((1, 3, 3), 10, np.uint8), np.ones((1, 3), np.float32), hole)
    over = speed_error.TierView(
        np.full((1, 3, 3), 200, np.uint8),
        np.full((1, 3), 2, np.float32),
        np.array([[False, True, False]]),
    )
    monkeypatch.setattr(speed_error, "by_surfels", lambda made, sight: base)
    monkeypatch.setattr(speed_error, "by_gaussians", lambda made, sight: over)
    shown = speed_error.by_both(None, None)  # type: ignore[arg-type]
    assert shown.rgb[0, :, 0].tolist() == [200, 10, 10]
    assert shown.depth[0].tolist() == [2, 1, 1]
    assert shown.hole[0].tolist() == [False, True, False]


def test_names_nobody_knows_are_refused(episode) -> None:
    with pytest.raises(RpaugError, match="surfels"):
        speed_error.chosen(["meshes"])
    with pytest.raises(Unsupported, match="another camera"):
        left_out.left_out(scene({"front": EYES["front"]}, length=2).episode, "front", 1)


def test_the_command_leaves_cameras_of_a_dataset_out(tmp_path) -> None:
    asked = ["bench", "tiers", str(SAMPLE), "--leave-out", "front", "--every", "20", "--json"]
    methods = ["--method", "surfels", "--method", "Gaussians", "--steps", "3"]
    done = CliRunner().invoke(app, [*asked, *methods, "--out", str(tmp_path / "o")])
    assert done.exit_code == 0, done.output
    printed = json.loads(done.stdout)
    assert [row["method"] for row in printed["rows"]] == ["surfels", "Gaussians"]
    (views_of, best), = printed["unbeaten"].items()  # fmt: skip
    assert views_of == "front left out"
    assert min(printed["rows"], key=lambda row: row["total_seconds"])["method"] == best[0]
    written = json.loads((tmp_path / "o" / "bench.json").read_text())
    assert written["rows"] == printed["rows"]
    assert {path.name for path in (tmp_path / "o").iterdir()} >= {"bench.csv", "bench.json"}
    wrong = CliRunner().invoke(
        app, ["bench", "tiers", str(SAMPLE), "--leave-out", "rear", "--out", str(tmp_path / "p")]
    )
    assert wrong.exit_code == 2
    assert "the cameras are" in wrong.output
