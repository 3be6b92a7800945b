"""Datasets of LeRobot v2.1 are read by those who need it: lerobot 0.1.0 as openpi pins it, and GR00T's loader."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import drivers
import numpy as np
import pytest

from rpaug import Episode
from rpaug.core import registry
from rpaug.pipeline import recipe
from rpaug.pipeline.augment import Run, execute
from rpaug.pipeline.convert import convert

MODALITY = {
    "state": {"arm": {"start": 0, "end": 7, "original_key": "observation.joint_positions"}},
    "action": {"hand": {"start": 0, "end": 8}},
    "video": {"front": {"original_key": "observation.images.front"}},
    "annotation": {"human.task_description": {"original_key": "task_index"}},
}


@pytest.fixture(scope="module")
def augmented(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Episode]]:
    """A dataset of v3 made v2.1 and relit, with its originals; and its episodes as we read them, in their order."""
    pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")
    from lerobot_samples import dataset

    root = tmp_path_factory.mktemp("v21")
    source = dataset(root / "in")
    (source / "toy/meta/modality.json").write_text(json.dumps(MODALITY))
    assert convert(source, root / "old", "lerobot@v2.1").exit_code == 0
    edits = [{"op": "light_color", "range": [[0.4, 0.4, 0.4], [0.4, 0.4, 0.4]]}]
    given = {"version": 1, "edits": edits, "copies": 1, "keep_originals": True, "seed": 3}
    execute(Run(root / "old", recipe.build(given), root / "out"))
    adapter = registry.adapter("lerobot")
    read = [adapter.read(root / "out", key) for key in adapter.episodes(root / "out")]
    return root / "out/toy", read


def read_by(
    environment: str, code: str, script: str, augmented: tuple[Path, list[Episode]], work: Path
) -> tuple[dict[str, Any], Mapping[str, np.ndarray]]:
    """What a reader in an environment of its own says of the dataset, and its arrays."""
    folder, episodes = augmented
    python, source = drivers.reader(f"{environment}/bin/python"), drivers.reader(code)
    home = {"HOME": str(work), "PYTHONPATH": str(source)}
    stated = drivers.run(python, script, folder, work / "f.npz", **home)
    assert stated["lengths"] == [one.length for one in episodes]
    return stated, np.load(work / "f.npz")


def test_lerobot_as_openpi_pins_it(augmented: tuple[Path, list[Episode]], tmp_path: Path) -> None:
    script = "read_with_openpi.py"
    stated, frames = read_by("openpi", "lerobot_openpi", script, augmented, tmp_path)
    episodes, at = augmented[1], 0
    for one in episodes:
        assert stated["tasks"][at : at + one.length] == list(one.source.tasks)
        for t in range(one.length):
            for name in ("front", "wrist"):
                theirs = frames[f"{at + t}/observation.images.{name}"] * 255
                ours = np.moveaxis(one.views[name].rgb(t), -1, 0)
                assert np.abs(theirs - ours).max() <= 2  # other conversions of chroma
            depth = one.views["front"].depth
            assert depth is not None
            assert np.allclose(frames[f"{at + t}/observation.images.front_depth"], depth(t))
            action = one.robot.extra["action"][t]
            assert np.array_equal(frames[f"{at + t}/action"], action.astype(np.float32))
        at += one.length
    assert stated["statistics"]["action"]["count"] == [at]
    actions = np.concatenate([one.robot.extra["action"] for one in episodes])
    assert np.allclose(stated["statistics"]["action"]["mean"], actions.mean(0), atol=1e-5)


def test_groot(augmented: tuple[Path, list[Episode]], tmp_path: Path) -> None:
    stated, frames = read_by("gr00t", "Isaac-GR00T", "read_with_gr00t.py", augmented, tmp_path)
    episodes = augmented[1]
    for number, one in enumerate(episodes):
        words = stated["words"][number]["language.annotation.human.task_description"]
        assert words == list(one.source.tasks)
        for name, key in (("state.arm", "observation.joint_positions"), ("action.hand", "action")):
            assert np.allclose(frames[f"{number}/{name}"], one.robot.extra[key], atol=1e-6)
        for t, image in enumerate(frames[f"{number}/video.front"]):
            ours = one.views["front"].rgb(t)[..., ::-1]  # OpenCV's order
            assert np.abs(image.astype(int) - ours).mean() < 2
    actions = np.concatenate([one.robot.extra["action"] for one in episodes])
    given = stated["statistics"]["action"]["hand"]
    assert np.allclose(given["q99"], np.quantile(actions, 0.99, 0), atol=1e-5)
    assert np.allclose(given["std"], actions.std(0), atol=1e-5)


def test_groot_n1(augmented: tuple[Path, list[Episode]], tmp_path: Path) -> None:
    """`LeRobotSingleDataset`, which N1 and N1.5 train with."""
    script = "read_with_gr00t_n1.py"
    stated, frames = read_by("gr00t", "Isaac-GR00T-n1", script, augmented, tmp_path)
    for number, one in enumerate(augmented[1]):
        assert stated["words"][str(number)] == list(one.source.tasks)
        for t in range(one.length):
            at = f"{number}/{t}"
            joints, action = (
                one.robot.extra[key][t] for key in ("observation.joint_positions", "action")
            )
            assert np.allclose(frames[f"{at}/state.arm"], joints, atol=1e-6)
            assert np.allclose(frames[f"{at}/action.hand"], action, atol=1e-6)
            ours = one.views["front"].rgb(t)[..., ::-1]  # OpenCV's order
            assert np.abs(frames[f"{at}/video.front"].astype(int) - ours).mean() < 2
    actions = np.concatenate([one.robot.extra["action"] for one in augmented[1]])
    given = stated["statistics"]["action"]["hand"]
    assert np.allclose(given["q99"], np.quantile(actions, 0.99, 0), atol=1e-5)
