"""A camera that is not where it says it is: named by inspect, in every report and in the summary."""

import json
import os
import shutil
from pathlib import Path

import pytest
from rpaug_adapters.rlbench.pickles import dump, load
from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.core import registry
from rpaug.core.registry import SAMPLE
from rpaug.scene.tracking import calibration

RECIPE = "version: 1\nedits:\n  - {op: recolor, target: {role: manipulated}, color: blue}\n"


def run(*arguments: object) -> tuple[str, str]:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return result.stdout, result.stderr


@pytest.fixture(scope="module")
def shifted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sample, its overhead camera said to be a centimetre along its own y axis from where it is."""
    root = tmp_path_factory.mktemp("data") / "sample"
    shutil.copytree(SAMPLE, root)
    (path,) = root.rglob("low_dim_obs.pkl")
    demo = load(path)
    for observation in demo._observations:
        pose = observation.misc["overhead_camera_extrinsics"].copy()
        pose[:3, 3] += 0.01 * pose[:3, 1]
        observation.misc["overhead_camera_extrinsics"] = pose
    path.write_bytes(dump(demo))
    return root


def test_inspect_names_it_in_text_json_and_html(shifted: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    described = json.loads(run("inspect", shifted, "--html", page, "--json")[0])
    assert list(described["misplaced"]) == ["overhead"]
    assert "10 mm" in described["misplaced"]["overhead"]
    assert described["misplaced"]["overhead"] in page.read_text()
    assert "warning: overhead: what it sees lies 10 mm" in run("inspect", shifted)[0]


def test_augment_warns_in_report_and_summary(shifted: Path, tmp_path: Path) -> None:
    recipe, out = tmp_path / "recipe.yaml", tmp_path / "out"
    recipe.write_text(RECIPE)
    _, shown = run("augment", shifted, "--recipe", recipe, "--out", out)
    assert "warning" in shown
    assert "overhead" in shown
    (report,) = out.rglob("rpaug.json")
    assert "overhead" in json.loads(report.read_bytes())["plan"]["warnings"][0]
    summary = json.loads((out / "rpaug.summary.json").read_bytes())
    assert list(summary["warnings"]) == ["open_drawer/all_variations/episodes/episode0"]


def test_the_sample_as_it_is_gives_no_warning() -> None:
    adapter = registry.adapter_for(SAMPLE)
    assert calibration.check(adapter.read(SAMPLE, adapter.episodes(SAMPLE)[0])) == ()


@pytest.mark.skipif("RPAUG_TEST_DATA" not in os.environ, reason="RPAUG_TEST_DATA is not set")
def test_real_recordings_give_no_warning_though_their_wrist_camera_is_a_pixel_off() -> None:
    root = Path(os.environ["RPAUG_TEST_DATA"]) / "rlbench_open_drawer"
    adapter = registry.adapter_for(root)
    for key in adapter.episodes(root):
        assert calibration.check(adapter.read(root, key)) == ()
