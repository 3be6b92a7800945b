"""What we write is read by RLBench's own reader, in its own process, with the values that were recorded."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import drivers
import numpy as np
import pytest

from rpaug import Scene
from rpaug.core import geometry, registry
from rpaug.operators.camera_pose import CameraPose
from rpaug.scene.recorded import surfels

KEYS = ("all_variations/episodes/episode0", "all_variations/episodes/episode5")


@pytest.fixture(scope="module")
def source(samples: Path) -> Path:
    return samples / "rlbench_open_drawer"


@pytest.fixture(scope="module")
def read():
    """Runs the driver on (root, key) twice and returns what it says."""
    python, library = drivers.reader("venv/bin/python"), drivers.reader("peract_colab")

    def run(root: Path, key: str, other_root: Path, other_key: str, *more: str) -> dict:
        places = []
        for place in (root / key, other_root / other_key):
            places += [str(place.parent), place.name.removeprefix("episode")]
        strict = ("-W", "error")
        return drivers.run(
            python, "read_with_rlbench.py", *places, *more, options=strict, PYTHONPATH=str(library)
        )

    return run


def assert_same_demo(stated: dict) -> None:
    """Another process read both, and a trainer would take the same frames and words from them."""
    assert stated["numpy"].startswith("1.")
    assert stated["values_compared"] > 70
    assert stated["frames"][0] == stated["frames"][1] > 90
    assert stated["instructions"][0] == stated["instructions"][1] != ""
    assert stated["key_frames"][0] == stated["key_frames"][1]
    assert len(stated["key_frames"][0]) >= 3


@pytest.mark.parametrize("key", KEYS)
def test_a_recording_equals_itself(read, source, key):
    stated = read(source, key, source, key)
    assert_same_demo(stated)
    assert stated["differs"] == {}


def test_the_driver_notices_differences(read, source):
    """Two different recordings differ in nearly everything: an empty answer is not for want of looking."""
    stated = read(source, KEYS[0], source, KEYS[1])
    assert stated["frames"] == [125, 96]
    assert stated["key_frames"][0] != stated["key_frames"][1]
    assert {"front_rgb", "wrist_depth", "joint_positions", "low_dim_data"} <= set(stated["differs"])
    assert {"misc.wrist_camera_extrinsics", "extract_obs.front_point_cloud"} <= set(
        stated["differs"]
    )


def test_an_unedited_copy_is_equal_in_every_bit(read, source, tmp_path):
    adapter = registry.adapter("rlbench")
    adapter.write(
        adapter.read(source, KEYS[0]),
        tmp_path,
        "new/episodes/episode0",
        lambda: {"rpaug.json": b"{}"},
    )
    stated = read(source, KEYS[0], tmp_path, "new/episodes/episode0")
    assert_same_demo(stated)
    assert stated["differs"] == {}


def test_edited_colors_change_nothing_else(read, source, tmp_path):
    adapter = registry.adapter("rlbench")
    episode = adapter.read(source, KEYS[0])
    front = episode.views["front"]
    inverted = replace(front, rgb=lambda t: 255 - front.rgb(t))
    adapter.write(
        replace(episode, views={**episode.views, "front": inverted}), tmp_path, KEYS[0], dict
    )
    stated = read(source, KEYS[0], tmp_path, KEYS[0])
    assert_same_demo(stated)
    everywhere = list(range(episode.length))
    assert stated["differs"] == {"front_rgb": everywhere, "extract_obs.front_rgb": everywhere}


def test_a_moved_camera_reads_as_points_in_the_same_world(read, source, tmp_path):
    """Depth and matrices of a moved camera give the reader point clouds that lie where the view says they do."""
    adapter = registry.adapter("rlbench")
    episode = adapter.read(source, KEYS[0])
    scene = Scene(
        episode=episode, cameras={n: v.camera for n, v in episode.views.items()}, bodies=(), roles={},
        antialiased=False, descriptions=episode.descriptions,
    )  # fmt: skip
    operator = CameraPose(camera="front")
    moved = operator.apply(scene, operator.sample(scene, np.random.default_rng(0)))
    drawn = surfels.view(surfels.build(moved), moved, "front", 0)
    view = replace(
        episode.views["front"], camera=moved.cameras["front"],
        rgb=lambda _: drawn.image, depth=lambda _: drawn.depth, ids=lambda _: drawn.ids,
    )  # fmt: skip
    adapter.write(replace(episode, views={**episode.views, "front": view}), tmp_path, KEYS[0], dict)
    clouds = tmp_path / "clouds.npz"
    stated = read(source, KEYS[0], tmp_path, KEYS[0], "--clouds", str(clouds))
    assert_same_demo(stated)
    planes = ("front_rgb", "front_depth", "front_point_cloud")
    matrix = {"misc.front_camera_extrinsics", "extract_obs.front_camera_extrinsics"}
    assert (
        set(stated["differs"]) == {*planes, *(f"extract_obs.{plane}" for plane in planes)} | matrix
    )
    points = geometry.world_points(drawn.depth.astype(np.float64), moved.cameras["front"], 0)
    near = drawn.depth < 4  # metres: the far plane cuts the rest off
    # A depth step is 0.2 um; the reader inverts recorded matrices, orthonormal to 1e-6, which we transpose.
    assert np.abs(np.load(clouds)["front"] - points)[near].max() < 1e-5


RECIPE = """\
version: 1
seed: 7
copies: 1
edits:
  - op: recolor
    target: {role: manipulated}
    color: blue
  - op: light_color
    range: [[0, 0, 0], [0.5, 0.5, 0.5]]
"""


def test_the_main_job(read, source, tmp_path):
    """Both recordings, recolored and relit by the command: only colors differ, for each episode as recorded."""
    (tmp_path / "recipe.yaml").write_text(RECIPE)
    given = ["augment", str(source), "--recipe", "recipe.yaml", "--out", "out"]
    subprocess.run([sys.executable, "-m", "rpaug", *given], cwd=tmp_path, check=True, timeout=300)
    for recorded, key in zip(KEYS, ("episode0", "episode1"), strict=True):
        stated = read(source, recorded, tmp_path / "out", f"all_variations/episodes/{key}")
        assert_same_demo(stated)
        cameras = ("front", "left_shoulder", "right_shoulder", "wrist")
        colors = {f"{prefix}{camera}_rgb" for camera in cameras for prefix in ("", "extract_obs.")}
        assert set(stated["differs"]) == colors
