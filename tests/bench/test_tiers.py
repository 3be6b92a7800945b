"""Tiers and fits beside each other: rows that make sense on scenes known in closed form."""

import json

import numpy as np
import pytest
from analytic import scene
from typer.testing import CliRunner

from rpaug.bench import fits, moved, tiers
from rpaug.cli import app
from rpaug.cli.checks import SAMPLE
from rpaug.core.errors import RpaugError, Unsupported

EYES = {"front": (1.6, 0.3, 1.0), "side": (1.3, 1.0, 1.0), "overhead": (0.1, -0.9, 1.5)}


@pytest.fixture(scope="module")
def episode():
    return scene(EYES, length=2).episode


def test_a_camera_that_was_left_out_is_shown_from_the_others(episode) -> None:
    known, sights = moved.left_out(episode, "front", every=1)
    assert "front" not in known.episode.views
    assert {sight.t for sight in sights} == {0, 1}
    assert 0.3 < sights[0].covisible.mean() <= 1
    assert moved.anchor(sights[0]) == "side"
    (row,) = tiers.run("front left out", [(known, sights)], ["surfels"])
    assert row.covisible_db > 25
    assert row.depth_median_mm < 1
    assert row.gaussians == 0
    # Nothing was recorded by a camera that was left out.
    assert tiers.run("front left out", [(known, sights)], ["recorded image unchanged"]) == []


def test_every_tier_has_a_row_on_the_same_views(episode) -> None:
    """Two recordings taken together; a fit of three steps shows something, and nothing bends."""
    pairs = [moved.left_out(episode, "front", every=2) for _ in range(2)]
    done = []
    rows = tiers.run("front left out", pairs, steps=3, threads=1, progress=lambda: done.append(1))
    assert [row.method for row in rows] == list(tiers.METHODS)[1:]
    assert {(row.recordings, row.views) for row in rows} == {(2, 2)}
    assert len(done) == 2 * len(tiers.METHODS)
    by_name = {row.method: row for row in rows}
    rigid, bending = by_name["Gaussians"], by_name["Gaussians, also in time"]
    assert bending.covisible_db == rigid.covisible_db
    assert bending.prepare_seconds > rigid.prepare_seconds
    assert by_name["Gaussians of each moment"].gaussians > 500
    assert all(row.covisible_db > 15 for row in rows)


def test_holes_take_the_gaussians_where_they_show_something(monkeypatch) -> None:
    hole = np.array([[True, True, False]])
    base = tiers.TierView(np.full((1, 3, 3), 10, np.uint8), np.ones((1, 3), np.float32), hole)
    over = tiers.TierView(
        np.full((1, 3, 3), 200, np.uint8),
        np.full((1, 3), 2, np.float32),
        np.array([[False, True, False]]),
    )
    monkeypatch.setattr(tiers, "by_surfels", lambda made, sight: base)
    monkeypatch.setattr(tiers, "by_gaussians", lambda made, sight: over)
    shown = tiers.by_both(None, None)  # type: ignore[arg-type]
    assert shown.rgb[0, :, 0].tolist() == [200, 10, 10]
    assert shown.depth[0].tolist() == [2, 1, 1]
    assert shown.hole[0].tolist() == [False, True, False]


def test_names_nobody_knows_are_refused(episode) -> None:
    with pytest.raises(RpaugError, match="surfels"):
        tiers.check(["meshes"])
    with pytest.raises(RpaugError, match="adam"):
        fits.FitSetting(optimisers=("sgd",))
    with pytest.raises(RpaugError, match="numba/float32"):
        fits.FitSetting(engines=("cuda",))
    with pytest.raises(Unsupported, match="another camera"):
        moved.left_out(scene({"front": EYES["front"]}, length=2).episode, "front", 1)


def test_more_iterations_show_recorded_pixels_better(episode) -> None:
    setting = fits.FitSetting(strides=(4,), iterations=(5, 40), optimisers=("adam",))
    rows, traces, skipped = fits.run(setting, episode, 0)
    assert skipped == {}
    assert rows[1].recorded_db > rows[0].recorded_db
    assert rows[1].held_out_best_db >= rows[1].held_out_db
    assert [len(one["trace"]) for one in traces] == [2, 3]
    assert rows[0].processor_seconds > 0


def test_the_command_sweeps_a_dataset(tmp_path) -> None:
    asked = [
        "bench",
        "fit",
        str(SAMPLE),
        "--stride",
        "8",
        "--iterations",
        "4",
        "--optimiser",
        "adam",
    ]
    done = CliRunner().invoke(app, [*asked, "--out", str(tmp_path / "o"), "--json"])
    assert done.exit_code == 0, done.output
    assert len(json.loads(done.stdout)["rows"]) == 1
    written = json.loads((tmp_path / "o" / "fit.json").read_text())
    assert written["traces"][0]["trace"][-1]["iteration"] == 4
    assert {path.name for path in (tmp_path / "o").iterdir()} == {"fit.csv", "fit.json", "fit.png"}
    neither = CliRunner().invoke(app, ["bench", "tiers", "--out", str(tmp_path / "p")])
    assert neither.exit_code == 2
    assert "name a dataset" in neither.output
