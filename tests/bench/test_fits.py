"""Fits beside each other: rows that make sense on a scene known in closed form."""

import json

import pytest
from analytic import scene
from rollouts import SAMPLE
from typer.testing import CliRunner

from rpaug.core.errors import RpaugError
from tools.bench.fits import app
from tools.bench.harness import fits

EYES = {"front": (1.6, 0.3, 1.0), "side": (1.3, 1.0, 1.0), "overhead": (0.1, -0.9, 1.5)}


@pytest.fixture(scope="module")
def episode():
    return scene(EYES, length=2).episode


def test_names_nobody_knows_are_refused() -> None:
    with pytest.raises(RpaugError, match="adam"):
        fits.FitSetting(optimisers=("sgd",))
    with pytest.raises(RpaugError, match="numba/float32"):
        fits.FitSetting(engines=("cuda",))


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
    neither = CliRunner().invoke(app, ["--out", str(tmp_path / "p")])
    assert neither.exit_code == 2
    assert "name a dataset" in neither.output
