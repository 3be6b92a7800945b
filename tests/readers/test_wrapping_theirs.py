"""`wrap` around the datasets of RVT, RDT and LeRobot themselves: their images become the edited ones, and no more."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import drivers
import numpy as np
from test_rdt_reader import KEY, lengthened
from test_rvt_replay import LIBRARIES, RECIPE

from rpaug.core import registry
from rpaug.pipeline.convert import convert


def stated(
    python: Path | str, script: str, *arguments: object, **environment: str
) -> dict[str, Any]:
    """What a script prints as JSON in its last line, in a process that has rpaug too."""
    done = subprocess.run(
        [python, drivers.HERE / script, *map(str, arguments)],
        env={**os.environ, "HF_HUB_OFFLINE": "1", "OMP_NUM_THREADS": "1", **environment},
        capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


def darker(folder: Path) -> Path:
    """A recipe that shows everything in darker, bluer light."""
    path = folder / "recipe.yaml"
    edits = [{"op": "light_color", "range": [[0.2, 0.3, 0.4], [0.2, 0.3, 0.4]]}]
    path.write_text(json.dumps({"version": 1, "seed": 3, "edits": edits}))
    return path


def test_rdts_own_dataset_is_wrapped(samples: Path, tmp_path: Path) -> None:
    repository = drivers.reader("RoboticsDiffusionTransformer")
    episode = lengthened(
        registry.adapter("rlbench").read(samples / "rlbench_open_drawer", KEY), 140
    )
    root, recipe, out = tmp_path / "out", darker(tmp_path), tmp_path / "frames.npz"
    registry.adapter("rdt").write(episode, root, "open_drawer/episode_0", dict)
    found = stated(sys.executable, "wrap_rdt.py", repository, root, recipe, out)
    frames = dict(np.load(out))
    changed = set(found["names"]) - set(found["same"])
    assert changed == {"cam_high", "cam_right_wrist"}
    for name in changed:
        edited, shown = frames[f"edited/{name}"], frames[f"shown/{name}"]
        assert np.abs(edited.astype(int) - shown).max() <= 1
        assert frames[f"plain/{name}"].mean() > 1.3 * edited.mean()


def test_lerobots_own_dataset_is_wrapped(samples: Path, tmp_path: Path) -> None:
    python = drivers.reader("lerobot_rpaug/bin/python")
    convert(samples / "rlbench_open_drawer", tmp_path / "out", "lerobot", fps=20)
    (place,) = (path.parent.parent for path in (tmp_path / "out").rglob("info.json"))
    recipe, out = darker(tmp_path), tmp_path / "frames.npz"
    found = stated(python, "wrap_lerobot.py", place, recipe, out, HOME=str(tmp_path))
    frames = dict(np.load(out))
    changed = set(found["names"]) - set(found["same"])
    assert found["length"] == 221
    assert changed == {name.partition("/")[2] for name in frames} != set()
    for name in changed:
        edited = 255 * np.moveaxis(frames[f"edited/{name}"], 0, -1)
        assert np.abs(edited - frames[f"shown/{name}"]).max() < 1.5
        assert frames[f"plain/{name}"].mean() > 1.3 * frames[f"edited/{name}"].mean()


def test_rvts_own_replay_buffer_is_wrapped(samples: Path, tmp_path: Path) -> None:
    rvt = drivers.reader("RVT")
    paths = [*(rvt / one for one in LIBRARIES), drivers.reader("peract_colab")]
    paths.append(drivers.reader("rvt_deps"))
    recipe = tmp_path / "recipe.yaml"
    recipe.write_text(json.dumps(RECIPE))
    found = stated(
        sys.executable, "wrap_rvt.py", tmp_path / "replay", samples / "rlbench_open_drawer", recipe,
        PYTHONPATH=os.pathsep.join(map(str, paths)),
    )  # fmt: skip
    front = {f"front_{kind}" for kind in ("rgb", "depth", "point_cloud", "camera_extrinsics")}
    others = {f"{name}_rgb" for name in ("left_shoulder", "right_shoulder", "wrist")}
    assert front <= set(found["changed"]) <= front | others
    assert found["off_m"] < 1e-5
