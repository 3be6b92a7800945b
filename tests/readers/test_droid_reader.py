"""What the droid adapter writes is read by DROID's own parser and the builder of its RLDS, each image at its step."""

import sys
from dataclasses import replace
from pathlib import Path

import drivers
import numpy as np

from rpaug.core import registry

sys.path.insert(0, str(Path(__file__).parents[1] / "adapters/droid"))
import droid_samples
from droid_samples import FIRST, FOLDER, SECOND, WRIST


def test_droids_own_readers_read_an_edited_episode(tmp_path: Path) -> None:
    droid, builder = drivers.reader("droid"), drivers.reader("droid_dataset_builder")
    python = drivers.reader("rdt/bin/python")
    root = droid_samples.droid(tmp_path / "in", raw=False)
    for path in (root / FOLDER / "recordings/MP4").glob("*-stereo.mp4"):
        path.replace(path.with_name(path.name.replace("-stereo", "")))  # as the builder wants it
    adapter = registry.adapter("droid")
    episode = adapter.read(root, FOLDER)
    bright = {
        name: replace(view, rgb=lambda t, view=view: view.rgb(t) // 2)
        for name, view in episode.views.items()
    }
    made = replace(
        episode, views={**episode.views, "wrist_image_right": bright["wrist_image_right"]}
    )
    adapter.write(made, tmp_path / "out", "LAB/success/2023-07-07/episode_0", dict)
    (folder,) = (tmp_path / "out").glob("LAB/success/*/*")
    stated = drivers.run(
        python,
        "read_with_droid.py",
        droid,
        builder,
        tmp_path / "out",
        folder,
        tmp_path / "frames.npz",
    )
    assert stated["known"]
    record, frames = stated["record"], np.load(tmp_path / "frames.npz")
    assert (record["wrist_cam_serial"], record["ext1_cam_serial"]) == (WRIST, FIRST)
    assert record["trajectory_length"] == episode.length
    assert np.array_equal(frames["joints"], episode.robot.joint_positions)
    assert np.array_equal(frames["action"], episode.robot.extra["action/cartesian_velocity"])
    names = {WRIST: "wrist_image", FIRST: "exterior_image_1", SECOND: "exterior_image_2"}
    for serial, name in names.items():
        for side in ("left", "right"):
            for t in range(episode.length):
                wanted = made.views[f"{name}_{side}"].rgb(t).astype(int)
                # OpenCV and we upsample chroma differently.
                assert np.abs(frames[f"{serial}_{side}"][t] - wanted).mean() < 5
