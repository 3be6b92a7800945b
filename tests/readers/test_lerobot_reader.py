"""What the lerobot adapter writes is read by LeRobot's own dataset class, in its own process, frame by frame."""

from dataclasses import replace
from pathlib import Path

import drivers
import numpy as np
import pytest

from rpaug.core import registry
from rpaug.pipeline import recipe
from rpaug.pipeline.augment import Run, execute
from rpaug.pipeline.convert import convert

PLACE = "toy"


@pytest.fixture(scope="module")
def read():
    """Runs the driver on a dataset; returns what it says and the frames it took."""
    python = drivers.reader("lerobot/bin/python")

    def run(folder: Path) -> tuple[dict, dict[str, np.ndarray]]:
        out = folder.parent / "frames.npz"
        home = str(folder.parent)
        stated = drivers.run(python, "read_with_lerobot.py", folder, out, HOME=home)
        return stated, dict(np.load(out))

    return run


def test_a_converted_recording_is_read(read, samples: Path, tmp_path: Path) -> None:
    source = samples / "rlbench_open_drawer"
    convert(source, tmp_path / "out", "lerobot", fps=20)
    (place,) = (path.parent.parent for path in (tmp_path / "out").rglob("info.json"))
    stated, frames = read(place)
    assert (stated["episodes"], stated["frames"], stated["lengths"]) == (2, 221, [125, 96])
    assert stated["tasks"] == {
        str(i): f"open the {'top' if i < 125 else 'bottom'} drawer"
        for i in map(int, stated["tasks"])
    }
    adapter = registry.adapter("rlbench")
    recorded = [adapter.read(source, key) for key in adapter.episodes(source)]
    for index in map(int, stated["tasks"]):
        one, t = (recorded[0], index) if index < 125 else (recorded[1], index - 125)
        for name, view in one.views.items():
            image = np.moveaxis(frames[f"{index}/observation.images.{name}"], 0, -1) * 255
            assert np.sqrt(((image - view.rgb(t)) ** 2).mean()) < 2.5  # 40 dB
            depth = frames[f"{index}/observation.images.{name}_depth"]
            assert np.allclose(depth[0], view.depth(t) * 1000, rtol=1e-6)  # millimetres
            assert np.array_equal(frames[f"{index}/masks.{name}"], view.ids(t))
        joints = frames[f"{index}/observation.joint_positions"]
        assert np.array_equal(joints, one.robot.joint_positions[t].astype(np.float32))
    assert stated["statistics"]["action"]["count"] == [221]


def test_an_edited_dataset_is_read(read, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")
    from lerobot_samples import dataset

    source = dataset(tmp_path / "in")
    edits = [{"op": "light_color", "range": [[0.4, 0.4, 0.4], [0.4, 0.4, 0.4]]}]
    given = {"version": 1, "edits": edits, "copies": 1, "keep_originals": True, "seed": 3}
    execute(Run(source, recipe.build(given), tmp_path / "out"))
    old_said, old = read(source / PLACE)
    stated, new = read(tmp_path / "out" / PLACE)
    assert stated["lengths"] == [5, 3, 5, 3, 4, 4]
    assert (stated["episodes"], stated["frames"]) == (6, 24)
    assert set(old_said["tasks"].values()) == {"pick it up", "put it down"}
    index = stated["statistics"]["index"]  # as LeRobot counts 0 to 23
    assert (index["min"], index["max"], index["count"]) == ([0], [23], [24])
    assert np.allclose([index["mean"], index["std"]], [[11.5], [np.arange(24).std()]])
    for key, value in old.items():
        index, _, name = key.partition("/")
        if int(index) < 8 and name not in ("index",):
            assert np.array_equal(value, new[key]), key  # originals come first, untouched
    assert new["8/observation.images.front"].mean() != old["0/observation.images.front"].mean()
    assert np.array_equal(new["8/action"], old["0/action"])


def test_filmed_depth_is_read(read, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Depth that was edited, as codes in HEVC: LeRobot's loader gives whole millimetres."""
    pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")
    import lerobot_samples

    for side in ("HEIGHT", "WIDTH"):
        monkeypatch.setattr(lerobot_samples, side, 64)
    source, adapter = lerobot_samples.filmed_depth(tmp_path / "in"), registry.adapter("lerobot")
    recorded = adapter.read(source, f"{PLACE}/train/0")
    view = recorded.views["front"]
    nearer = replace(view, depth=lambda t: np.where(view.depth(t) > 1, 0.7, view.depth(t)))
    edited = replace(recorded, views={**recorded.views, "front": nearer})
    adapter.write(edited, tmp_path / "out", f"{PLACE}/train/0", dict)
    adapter.finish(source, tmp_path / "out")
    stated, frames = read(tmp_path / "out" / PLACE)
    assert stated["depth"] == [lerobot_samples.DEPTH]
    for t in range(recorded.length):
        depth = nearer.depth(t)
        theirs = frames[f"{t}/{lerobot_samples.DEPTH}"][0]
        assert np.abs(theirs - depth * 1000)[depth > 0].max() < 1.5  # half a code and a rounding
