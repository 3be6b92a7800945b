"""RVT's own dataset code fills its replay buffer from what we write: key points and actions are the recording's."""

import os
from pathlib import Path

import drivers

from rpaug.pipeline import recipe
from rpaug.pipeline.augment import Run, execute

LIBRARIES = ("", "rvt/libs/YARR", "rvt/libs/peract_colab")
RECIPE = {
    "version": 1,
    "select": {"limit": 1},
    "edits": [
        {"op": "recolor", "target": {"role": "manipulated"}, "color": "blue"},
        {"op": "camera_pose", "camera": "front", "shift": 0.03},
    ],
}


def test_rvt_trains_on_what_we_write(samples: Path, tmp_path: Path) -> None:
    rvt, library = drivers.reader("RVT"), drivers.reader("peract_colab")
    python, source = drivers.reader("rvt/bin/python"), samples / "rlbench_open_drawer"
    execute(Run(source, recipe.build(RECIPE), tmp_path / "out"))
    episodes = [root / "all_variations/episodes" for root in (source, tmp_path / "out")]
    paths = os.pathsep.join(map(str, [*(rvt / one for one in LIBRARIES), library]))
    stated = drivers.run(
        python, "fill_rvt_replay.py", tmp_path, episodes[0], "1", episodes[1], "1", PYTHONPATH=paths
    )
    assert stated["transitions"][0] == stated["transitions"][1] > 20
    assert len({end for *_, end in stated["points"]}) >= 3
    moved = ("rgb", "depth", "point_cloud", "camera_extrinsics")
    allowed = {f"front_{kind}{late}" for kind in moved for late in ("", "_tp1")}
    allowed |= {
        f"{name}_rgb{late}"
        for name in ("left_shoulder", "right_shoulder", "wrist")
        for late in ("", "_tp1")
    }
    assert {"front_rgb", "front_point_cloud", "front_camera_extrinsics"} <= set(stated["differs"])
    assert set(stated["differs"]) <= allowed
    assert {"trans_action_indicies", "keypoint_frame", "action", "lang_goal"} <= set(
        stated["names"]
    )
