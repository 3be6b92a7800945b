"""The examples run: as they stand on the sample, or beside stand-ins for the datasets of other people.

Those for Slurm and Ray run in tests/cli/test_cli.py and tests/pipeline/test_cluster.py, the packages in
tests/pipeline/test_third_party.py and test_third_party_packages.py.
"""

import json
import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import rpaug
from rpaug.cli import app

pytestmark = pytest.mark.usefixtures("tracked_once")
FOLDER = Path(__file__).parent.parent / "examples"
RUN_ELSEWHERE = {"slurm_array.sh", "slurm_ray.sh", "ray_job.sh", "glow", "frames", "pull_push"}
NAME = "observation.images.front"
DARK = {"op": "light_color", "range": [[0.2, 0.2, 0.2], [0.2, 0.2, 0.2]]}
KEYS = [f"roll_ball/all_variations/episodes/episode{n}" for n in range(2)]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder with a recipe that darkens."""
    monkeypatch.chdir(tmp_path)
    recipe = {"version": 1, "edits": [DARK]}
    (tmp_path / "recipe.yaml").write_text(json.dumps(recipe))
    return tmp_path


def run(name: str) -> dict[str, Any]:
    return runpy.run_path(str(FOLDER / name), run_name="__main__")


def installed(monkeypatch: pytest.MonkeyPatch, name: str, **members: Any) -> None:
    """A module that is not there, and the packages it lies in."""
    parts = name.split(".")
    for length in range(1, len(parts)):
        monkeypatch.setitem(sys.modules, ".".join(parts[:length]), ModuleType(parts[length - 1]))
    module = ModuleType(name)
    vars(module).update(members)
    monkeypatch.setitem(sys.modules, name, module)


def test_every_example_is_named_and_run() -> None:
    page = (FOLDER / "README.md").read_text()
    files = {path.name for path in FOLDER.iterdir()} - {"README.md", "__pycache__"}
    assert all(f"[{name}]({name}" in page for name in files)
    source = Path(__file__).read_text()
    assert all(f'"{name}"' in source for name in files)


def test_the_recipe(here: Path) -> None:
    given = ["--recipe", str(FOLDER / "tabletop.yaml"), "--set", "copies=1", "--out", "augmented"]
    done = CliRunner().invoke(app, ["augment", "sample", *given])
    assert done.exit_code == 0, done.output
    report = json.loads(next(Path("augmented").rglob("rpaug.json")).read_text())
    assert "distractors" in {draw.get("op") for draw in report["draws"]}


def test_in_memory(here: Path) -> None:
    run("in_memory.py")
    image = np.asarray(Image.open("side_by_side.png"))
    recorded, edited, *_ = np.split(image, 4, axis=1)
    assert 0.2 < (recorded != edited).any(axis=-1).mean() < 1


def test_training(here: Path, template: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["train.py", str(template), "recipe.yaml"])
    left = run("train.py")
    assert left["episodes"].epoch == left["EPOCHS"] - 1
    assert left["places"].shape[1] == 3
    assert float(left["loss"].detach()) > 0


def darker(edited: np.ndarray, plain: np.ndarray) -> bool:
    return bool(edited.mean() < 0.9 * plain.mean())


def test_rvts_replay_buffer(here: Path, template: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "data").mkdir()
    (here / "data/train").symlink_to(template)
    view = rpaug.read(template, KEYS[1]).views["front"]
    depth = view.depth(2)
    points = rpaug.geometry.transform(
        view.camera.cam_to_world[2], rpaug.geometry.unproject(depth.astype(float), view.camera.K)
    )
    sample = {
        "tasks": ["roll_ball"],
        "episode_idx": np.array([[1]]),
        "sample_frame": np.array([[2]]),
        "front_rgb": view.rgb(2).transpose(2, 0, 1)[None],
        "front_depth": depth[None, None],
        "front_point_cloud": points.transpose(2, 0, 1)[None].astype(np.float32),
        "front_camera_extrinsics": view.camera.cam_to_world[2][None].astype(np.float32),
    }
    installed(monkeypatch, "rvt.utils.get_dataset", get_dataset=lambda *_: ([sample], None))
    installed(monkeypatch, "rvt.utils.peract_utils", CAMERAS=["front"])
    augmented = run("wrap_rvt.py")["augmented"]
    shown = set()
    for epoch in range(8):
        augmented.set_epoch(epoch)
        shown.add(darker(augmented[0]["front_rgb"], sample["front_rgb"]))
    assert shown == {False, True}
    assert np.array_equal(augmented[0]["front_depth"], sample["front_depth"])


def test_rdts_dataset(here: Path, template: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    convert("rdt", template, here / "data/datasets/mine")
    as_aloha_records(Path("data/datasets/mine"))
    views = rpaug.read("data/datasets/mine", rpaug.episodes("data/datasets/mine")[0]).views

    class Theirs:
        def __len__(self) -> int:
            return 1

        def get_item(self, index: int) -> dict[str, Any]:
            return {"meta": {"step_id": 3}} | {
                name: np.stack([view.rgb(t) for t in (2, 3)]) for name, view in views.items()
            }

    installed(monkeypatch, "data.hdf5_vla_dataset", HDF5VLADataset=Theirs)
    plain, edited = Theirs().get_item(0), run("wrap_rdt.py")["augmented"][0]
    for name in ("cam_high", "cam_right_wrist"):
        assert darker(edited[name], plain[name])
    assert edited["episode"] == 0


def test_lerobots_dataset(here: Path, template: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    convert("lerobot", template, here / "data/my_dataset")
    view = rpaug.read("data/my_dataset", rpaug.episodes("data/my_dataset")[1]).views["front"]
    image = view.rgb(2).transpose(2, 0, 1).astype(np.float32) / 255

    class Theirs(list):
        def __init__(self, name: str, root: str) -> None:
            super().__init__([{"episode_index": 1, "frame_index": 2, NAME: image}])
            self.meta = SimpleNamespace(
                camera_keys=[NAME, f"{NAME}_depth"], depth_keys=[f"{NAME}_depth"]
            )

    installed(monkeypatch, "lerobot.datasets.lerobot_dataset", LeRobotDataset=Theirs)
    augmented = run("wrap_lerobot.py")["augmented"]
    assert darker(augmented[0][NAME], image)


def as_aloha_records(dataset: Path) -> None:
    """Two cameras under ALOHA's names, and no file that names them otherwise."""
    for path in dataset.rglob("*.hdf5"):
        with h5py.File(path, "r+") as file:
            del file["observations/images/cam_right_wrist"]
            file["observations/images"].move("overhead", "cam_right_wrist")
    for path in dataset.rglob("cameras.yaml"):
        path.unlink()


def convert(layout: str, source: Path, out: Path) -> None:
    given = ["convert", str(source), "--to", layout, "--out", "converted", "--fps", "10"]
    done = CliRunner().invoke(app, given)
    assert done.exit_code == 0, done.output
    root = (
        next(Path("converted").rglob("info.json")).parents[1]
        if layout == "lerobot"
        else Path("converted")
    )
    out.parent.mkdir(parents=True, exist_ok=True)
    root.rename(out)
