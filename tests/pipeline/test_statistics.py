"""What a run made of a dataset, in numbers."""

import json
from pathlib import Path

import numpy as np
import pytest
from runs import GROUP, augment
from typer.testing import CliRunner

import rpaug
from rpaug.cli import app
from rpaug.core import sampling
from rpaug.core.errors import BadInput
from rpaug.pipeline import recipe, report
from rpaug.pipeline.statistics import FRAMES, statistics

WANTED = recipe.build(
    {
        "version": 1,
        "copies": 2,
        "edits": [
            {"op": "light_color", "range": [[0.4, 0.4, 0.4], [0.6, 0.6, 0.6]]},
            {"op": "recolor", "target": {"text": "the purple thing"}, "color": "red"},
        ],
    }
)


@pytest.fixture(scope="module")
def out(template: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("numbers") / "out"
    augment(template, WANTED, path)
    return path


def test_factors_are_those_of_the_reports(template: Path, out: Path) -> None:
    found = statistics(out, template, 10)
    keys = rpaug.episodes(out)
    assert found.copies == len(keys) == 4
    drawn = [
        draw["edit"]
        for key in keys
        for draw in json.loads((out / key / report.NAME).read_text())["draws"]
        if draw["op"] == "light_color" and not draw.get("left_out")
    ]
    light = found.factors["light_color"]
    assert light.drawn == 4
    gains = np.array([edit["gain"] for edit in drawn])
    for k in range(3):
        expected = gains[:, k].min(), gains[:, k].mean(), gains[:, k].max()
        np.testing.assert_allclose(light.numbers[f"gain[{k}]"], expected)
    lacked = found.factors["recolor"]
    assert (lacked.drawn, lacked.left_out) == (0, 4)


def test_data_are_means_over_pixels_and_states(template: Path, out: Path) -> None:
    found = statistics(out, template, 10)
    assert found.recorded is not None
    assert (found.recorded.episodes, found.written.episodes) == (2, 4)
    episodes = [rpaug.read(template, key) for key in rpaug.episodes(template)]
    joints = np.concatenate([one.robot.joint_positions for one in episodes])
    np.testing.assert_allclose(found.recorded.robot["joint_positions"][0], joints.mean(0))
    np.testing.assert_allclose(found.recorded.robot["joint_positions"][1], joints.std(0), atol=1e-9)
    np.testing.assert_allclose(
        found.written.robot["joint_positions"], found.recorded.robot["joint_positions"]
    )
    for name, (mean, spread) in found.written.images.items():
        images = [
            one.views[name].rgb(t)
            for one in (rpaug.read(out, key) for key in rpaug.episodes(out))
            for t in sampling.frames(one.length, FRAMES)
        ]
        np.testing.assert_allclose(mean, np.mean(images, (0, 1, 2)))
        np.testing.assert_allclose(spread, np.std(images, (0, 1, 2)))
        np.testing.assert_allclose(found.written.depth[name], found.recorded.depth[name])


def test_it_is_told_in_words_and_refused_without_an_output(
    template: Path, out: Path, tmp_path: Path
) -> None:
    said = CliRunner().invoke(app, ["stats", str(out), "--against", str(template)])
    assert said.exit_code == 0, said.output
    assert "light_color: in 4 of them" in said.output
    assert "recolor: in 0 of them, left out of 4 more" in said.output
    assert "recorded, 2 episodes" in said.output
    plain = json.loads(CliRunner().invoke(app, ["stats", str(out), "--json"]).output)
    assert plain["recorded"] is None
    assert plain["copies"] == 4
    with pytest.raises(BadInput):
        statistics(tmp_path, None, 1)
    assert (out / GROUP).is_dir()
