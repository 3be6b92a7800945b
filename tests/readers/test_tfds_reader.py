"""What the rlds adapter writes is read by stock TFDS under TensorFlow, in its own process."""

import shutil
from pathlib import Path

import drivers
import pytest

from rpaug.pipeline import recipe
from rpaug.pipeline.augment import Run, execute
from rpaug.pipeline.convert import convert

PLACE = "bridge_dataset/1.0.0"


def run_of(source: Path, target: Path, *edits: dict) -> Run:
    given = {"version": 1, "edits": list(edits), "seed": 3}
    return Run(source, recipe.build(given), target)


@pytest.fixture(scope="module")
def read():
    """Runs the driver on two datasets and returns what it says."""
    python = drivers.reader("tfds/bin/python")

    def run(one: Path, other: Path) -> dict:
        return drivers.run(python, "read_with_tfds.py", one, other, HOME="/tmp")

    return run


def test_an_edited_dataset_differs_in_its_images_alone(read, samples: Path, tmp_path: Path) -> None:
    source = samples / "rlds_bridge"
    edits = {"op": "light_color"}, {"op": "sensor_exposure"}
    execute(run_of(source, tmp_path / "out", *edits))
    stated = read(source / PLACE, tmp_path / "out" / PLACE)
    assert stated["counts"] == [{"train": 12, "val": 3}] * 2
    assert stated["steps"] == 150
    assert stated["values"] > 1500
    images = {f"observation/image_{i}" for i in range(3)}  # the fourth is a black dummy
    assert images <= set(stated["differs"]) <= images | {"observation/image_3"}
    assert all(stated["mean_difference"][name] > 3 for name in images)


def test_edits_that_color_images_alone_allow_leave_all_else(
    read, samples: Path, tmp_path: Path
) -> None:
    (tmp_path / "in").mkdir()
    shutil.copytree(samples / "rlds_bridge", tmp_path / "in", dirs_exist_ok=True)
    (tmp_path / "in" / PLACE / "cameras.yaml").write_text("version: 1\nviews: [image_0]\n")
    settled = "version: 1\nroles: {table: {handle: 2}, background: {handle: 3}}\n"
    (tmp_path / "in" / "roles.yaml").write_text(settled)  # color tells neither for sure
    edits = (
        {"op": "recolor", "target": {"role": "table"}, "color": {"sample": "colosseum"}},
        {"op": "background_texture"},
        {"op": "light_color"},
        {"op": "insert", "asset": "die"},
    )
    run = run_of(tmp_path / "in", tmp_path / "trial", *edits)
    left = sorted(execute(run).failures)  # where the support has no room for one more thing
    assert len(left) < 5
    edits = edits[:3] if left else edits
    summary = execute(run_of(tmp_path / "in", tmp_path / "out", *edits))
    assert not summary.failures
    stated = read(tmp_path / "in" / PLACE, tmp_path / "out" / PLACE)
    assert stated["steps"] == 150
    assert set(stated["differs"]) == {"observation/image_0"}


def test_an_unedited_copy_is_the_same(read, samples: Path, tmp_path: Path) -> None:
    source = samples / "rlds_bridge"
    execute(run_of(source, tmp_path / "out"))
    stated = read(source / PLACE, tmp_path / "out" / PLACE)
    assert stated["differs"] == {}
    assert stated["bytes"][0] == stated["bytes"][1]


def test_an_episode_of_another_layout_can_be_read(read, samples: Path, tmp_path: Path) -> None:
    convert(samples / "rlbench_open_drawer", tmp_path / "out", "rlds")
    (place,) = (path.parent for path in (tmp_path / "out").rglob("features.json"))
    stated = read(place, place)
    assert stated["counts"] == [{"train": 2}] * 2
    assert stated["steps"] == 125 + 96
    assert stated["differs"] == {}
    assert {
        "action",
        "observation/front",
        "observation/front_depth",
        "observation/front_mask",
    } <= set(stated["names"])
