"""What a simulator sees in stored states is taken over if its color is the stored one. The simulator here is a stand-in
for robosuite: MuJoCo's model, and images that tell the state."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import sim_samples
import yaml
from rpaug_adapters.hdf5_sim import HDF5Sim
from rpaug_adapters.rlbench import RLBench
from typer.testing import CliRunner

from rpaug import Unsupported
from rpaug.cli import app

ADAPTER = HDF5Sim()
MODEL = """<mujoco><worldbody>
  <geom name="floor" type="plane" size="1 1 1"/>
  <camera name="agentview" pos="0 0 2" fovy="90"/>
  <camera name="robot0_eye_in_hand" pos="0 0 1"/>
  <body name="table"><geom size="1"/></body>
  <body name="robot0_base"><geom size="1"/><body name="robot0_link1"><joint/><geom size="1"/></body></body>
  <body name="cube_main"><freejoint/><geom size="1"/></body>
</worldbody></mujoco>"""
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
ROBOSUITE = """
import sys
from types import SimpleNamespace
import mujoco, numpy as np
print("robosuite prints what is no answer")
BRIGHT = 1

class Sim:
    def __init__(self, xml):
        model = mujoco.MjModel.from_xml_string(xml)
        self.data = SimpleNamespace(_data=mujoco.MjData(model))
        self.model = SimpleNamespace(_model=model, stat=model.stat, vis=model.vis, cam_fovy=model.cam_fovy,
                                     camera_name2id=lambda name: model.camera(name).id,
                                     camera_names=[model.camera(i).name for i in range(model.ncam)])
    def reset(self): pass
    def set_state_from_flattened(self, state): self.data._data.qpos[:] = state[1 : 1 + self.model._model.nq]
    def forward(self):
        mujoco.mj_forward(self.model._model, self.data._data)
        self.data.cam_xmat, self.data.cam_xpos = self.data._data.cam_xmat, self.data._data.cam_xpos
    def render(self, camera_name, width, height, depth=False, segmentation=False):
        if segmentation:
            shown = np.full((height, width, 2), -1, np.int32)
            shown[0, :] = 5, self.model._model.ngeom - 1  # the cube, below in OpenGL's images
            return shown
        light = self.model.vis.headlight.diffuse[0] / 0.4  # 1 as recorded
        color = np.full((height, width, 3), min(round(self.data._data.qpos[1] * 100 * BRIGHT * light), 255), np.uint8)
        return color, np.full((height, width), 0.5, np.float32)

class Env:
    robots = [SimpleNamespace(robot_model=SimpleNamespace(root_body="robot0_base"))]
    def edit_model_xml(self, xml): return xml
    def reset_from_xml_string(self, xml): self.sim = Sim(xml)

def make(name, **settings):
    assert not settings["use_camera_obs"]
    return Env()
"""


@pytest.fixture
def dataset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two demonstrations whose color tells their states."""
    (tmp_path / "packages").mkdir()
    (tmp_path / "packages/robosuite.py").write_text(ROBOSUITE)
    paths = [str(tmp_path / "packages"), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    path = sim_samples.robomimic(tmp_path / "in/lift.hdf5")
    with h5py.File(path, "r+") as file:
        for demo in file["data"].values():
            demo.attrs["model_file"] = MODEL
            states = np.zeros((sim_samples.STEPS, 32))
            states[:, 2] = 0.1 + np.arange(sim_samples.STEPS) / 10  # the cube along x
            states[:, 5] = 1
            demo["states"][...] = states
            for name in ("agentview_image", "robot0_eye_in_hand_image"):
                demo[f"obs/{name}"][...] = (states[:, 2] * 100).astype(np.uint8)[
                    :, None, None, None
                ]
    return path.parent


def reobserved(source: Path, out: Path, *more: str) -> tuple[int, str]:
    given = ["reobserve", str(source), "--simulator", sys.executable, "--out", str(out), *more]
    result = CliRunner().invoke(app, given)
    return result.exit_code, result.output + result.stderr


def test_depth_ids_cameras_and_roles_come_from_the_states(dataset: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    code, words = reobserved(dataset, out)
    assert code == 0
    assert "2 episodes in" in words
    before, after = (ADAPTER.read(root, "lift/demo_1") for root in (dataset, out))
    assert after.length == before.length - 1  # the last of next_obs shows no stored state
    view = after.views["agentview"]
    assert np.array_equal(view.rgb(2), before.views["agentview"].rgb(2))
    assert np.allclose(view.camera.K, [[3, 0, 3.5], [0, 3, 2.5], [0, 0, 1]])
    assert np.allclose(
        view.camera.cam_to_world[1], [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 2], [0, 0, 0, 1]]
    )
    assert after.views["robot0_eye_in_hand"].camera.placed
    assert view.depth is not None
    assert view.ids is not None
    assert view.depth(0).min() > 0
    roles = yaml.safe_load((out / "roles.yaml").read_text())["roles"]
    (cube,) = roles["manipulated"]["handle"]
    assert {*np.unique(view.ids(0)[-1])} == {cube}
    assert not view.ids(0)[:-1].any()
    assert len(roles["robot"]["handle"]) == 2
    with h5py.File(dataset / "lift.hdf5") as old, h5py.File(out / "lift.hdf5") as new:
        assert "next_obs" not in new["data/demo_0"]
        assert np.array_equal(old["data/demo_0/actions"], new["data/demo_0/actions"])
        assert list(new["mask/train"]) == list(old["mask/train"])


def test_light_beyond_white_is_known_until_the_color_is_edited(
    dataset: Path, tmp_path: Path
) -> None:
    package = tmp_path / "packages/robosuite.py"
    package.write_text(package.read_text().replace("BRIGHT = 1", "BRIGHT = 10"))
    out = tmp_path / "out"
    assert reobserved(dataset, out, "--color")[0] == 0
    episode = ADAPTER.read(out, "lift/demo_0")
    assert sorted(episode.views) == ["agentview", "robot0_eye_in_hand"]
    view = episode.views["agentview"]
    assert view.radiance is not None
    assert np.allclose(view.radiance(0), view.rgb(0) / 255, atol=1e-6)  # 0.1 m: 100 levels
    assert view.rgb(2).min() == 255
    assert np.allclose(view.radiance(2), 300 / 255, atol=2.1 / 255)  # 0.3 m
    assert not episode.unread
    edited = replace(view, rgb=lambda t: view.rgb(t) // 2, radiance=None)
    changed = replace(episode, views={**episode.views, "agentview": edited})
    ADAPTER.write(changed, tmp_path / "copy", "lift/demo_0", dict)
    ADAPTER.finish(out, tmp_path / "copy")
    with h5py.File(tmp_path / "copy/lift.hdf5") as file:
        assert "agentview_dimmed" not in file["data/demo_0/obs"]
        assert "robot0_eye_in_hand_dimmed" in file["data/demo_0/obs"]
    again = ADAPTER.read(tmp_path / "copy", "lift/demo_0")
    assert again.views["agentview"].radiance is None
    assert ADAPTER.untouched(again, False) == ADAPTER.untouched(episode, False)


def test_what_looks_otherwise_is_left_out_and_named(dataset: Path, tmp_path: Path) -> None:
    with h5py.File(dataset / "lift.hdf5", "r+") as file:
        file["data/demo_1/obs/agentview_image"][1] += 9
    code, words = reobserved(dataset, tmp_path / "out")
    assert code == 1
    assert "100.0 % of the simulator's pixels are others" in " ".join(words.split())
    assert ADAPTER.episodes(tmp_path / "out") == ["lift/demo_0"]
    with h5py.File(tmp_path / "out/lift.hdf5") as file:
        assert file["data"].attrs["total"] == sim_samples.STEPS
        assert not len(file["mask/valid"])


def test_the_simulators_color_takes_the_place_of_another(dataset: Path, tmp_path: Path) -> None:
    with h5py.File(dataset / "lift.hdf5", "r+") as file:
        recorded = file["data/demo_1/obs/agentview_image"][()]
        file["data/demo_1/obs/agentview_image"][1] += 9
    assert reobserved(dataset, tmp_path / "out", "--color")[0] == 0
    with h5py.File(tmp_path / "out/lift.hdf5") as file:
        assert np.array_equal(file["data/demo_1/obs/agentview_image"][()], recorded)


LIBERO = """
import robosuite
from pathlib import Path

def make(name, bddl_file_name, **settings):
    assert Path(bddl_file_name).read_text() == "(define)"
    env = robosuite.Env()
    env.custom_asset_dir = str(Path(__file__).parent)
    return env

robosuite.make = make
"""


def test_liberos_task_files_and_cameras_are_found(dataset: Path, tmp_path: Path) -> None:
    """Its environments are made by importing it; its files lie elsewhere than where it was recorded."""
    packages = tmp_path / "packages"
    for folder in ("libero/libero/envs", "robosuite/models"):
        (packages / folder).mkdir(parents=True)
    (packages / "robosuite.py").rename(packages / "robosuite/__init__.py")
    (packages / "robosuite/models/__init__.py").write_text("assets_root = '/nowhere'")
    for name in ("libero", "libero/libero"):
        (packages / name / "__init__.py").touch()
    (packages / "libero/libero/envs/__init__.py").write_text(LIBERO)
    (packages / "libero/libero/envs/cube.obj").write_text(TETRAHEDRON)
    mesh = '<asset><mesh name="m" file="/elsewhere/libero/assets/cube.obj"/></asset><worldbody>'
    with h5py.File(dataset / "lift.hdf5", "r+") as file:
        file["data"].attrs["bddl_file_content"] = "(define)"
        for demo in file["data"].values():
            demo.attrs["model_file"] = MODEL.replace("<worldbody>", mesh, 1)
            for group in ("obs", "next_obs"):
                demo.move(f"{group}/robot0_eye_in_hand_image", f"{group}/eye_in_hand_rgb")
    code, words = reobserved(dataset, tmp_path / "out")
    assert code == 0, words
    assert ADAPTER.read(tmp_path / "out", "lift/demo_0").views["eye_in_hand"].camera.placed


def test_maniskills_own_tool_is_named(tmp_path: Path) -> None:
    sim_samples.maniskill(tmp_path / "in/cube.h5")
    code, words = reobserved(tmp_path / "in", tmp_path / "out")
    assert code == 2
    assert "replay_trajectory" in "".join(words.split())


def test_a_simulator_that_fails_is_quoted(dataset: Path, tmp_path: Path) -> None:
    with h5py.File(dataset / "lift.hdf5", "r+") as file:
        file["data/demo_0"].attrs["model_file"] = "<mujoco"
        del file["data/demo_1"].attrs["model_file"]
    code, words = reobserved(dataset, tmp_path / "out")
    assert code == 2
    assert "XML" in words
    assert "model_file" in words
    assert not (tmp_path / "out").exists()


def test_layouts_without_states_are_refused(template: Path, tmp_path: Path) -> None:
    with pytest.raises(Unsupported, match="no states"):
        RLBench().reobserve(
            template, tmp_path / "out", Path(sys.executable), lambda done, total: None
        )
