"""Demonstrations of robomimic, LIBERO and ManiSkill: storage kept, what belongs to one follows its copies."""

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import sim_samples
from rpaug_adapters.hdf5_sim import HDF5Sim
from rpaug_adapters.rlbench import RLBench
from runs import augment
from sim_samples import STEPS

from rpaug import BadInput, CameraView, Episode, Unsupported
from rpaug.core import registry
from rpaug.pipeline import recipe
from rpaug.pipeline.contracts import AdapterContract
from rpaug.pipeline.verify import verify

ADAPTER = HDF5Sim()
LIGHT = {"op": "light_color", "range": [[0.5, 0.5, 0.5], [0.6, 0.6, 0.6]]}


class TestRobomimic(AdapterContract):
    def adapter(self) -> HDF5Sim:
        return ADAPTER

    def dataset(self, folder: Path) -> Path:
        return sim_samples.robomimic(folder / "lift.hdf5").parent


class TestManiSkill(TestRobomimic):
    def dataset(self, folder: Path) -> Path:
        return sim_samples.maniskill(folder / "PickCube-v1/trajectory.rgbd.h5").parent


class TestLibero(TestRobomimic):
    def dataset(self, folder: Path) -> Path:
        return sim_samples.libero(folder / "libero_spatial/bowl_demo.hdf5").parent


def edited(episode: Episode) -> Episode:
    """Color halved, depth nearer, ids one more, in the upper half of each image."""

    def upper(image, change):
        def at(t: int) -> np.ndarray:
            made = image(t).copy()
            half = made[: len(made) // 2]
            half[...] = change(half)
            return made

        return at

    def change(view: CameraView) -> CameraView:
        return replace(
            view,
            rgb=upper(view.rgb, lambda half: half // 2),
            depth=view.depth and upper(view.depth, lambda half: half - 0.25),
            ids=view.ids and upper(view.ids, lambda half: half + 1),
        )

    return replace(episode, views={name: change(view) for name, view in episode.views.items()})


def gathered(root: Path, out: Path, change=edited) -> Path:
    """Every demonstration of a folder, changed, as a run would write it."""
    for key in ADAPTER.episodes(root):
        ADAPTER.write(change(ADAPTER.read(root, key)), out, key, dict)
    ADAPTER.finish(root, out)
    return out


SAMPLES = {
    "robomimic": (sim_samples.robomimic, "x.hdf5"),
    "libero": (sim_samples.libero, "x.hdf5"),
    "maniskill": (sim_samples.maniskill, "x.h5"),
}


@pytest.mark.parametrize("kind", SAMPLES)
def test_an_edit_changes_pixels_and_nothing_else(kind: str, tmp_path: Path) -> None:
    make, name = SAMPLES[kind]
    source = make(tmp_path / "in" / name)
    out = gathered(source.parent, tmp_path / "out")
    reached = ("image", "rgb", "depth", "segmentation", "segmentation_instance")
    with h5py.File(source) as old, h5py.File(out / name) as new:
        names: list[str] = []
        old.visit(names.append)
        assert {*names} == {*_names(new)}
        for one in names:
            assert dict(old[one].attrs).keys() == dict(new[one].attrs).keys()
            for key, value in old[one].attrs.items():
                assert np.array_equal(value, new[one].attrs[key])
            if not isinstance(old[one], h5py.Dataset):
                assert list(old[one]) == list(new[one]), "order"
                continue
            same = np.array_equal(old[one][()], new[one][()])
            kept = ("dtype", "shape", "chunks", "compression", "compression_opts")
            assert all(getattr(old[one], what) == getattr(new[one], what) for what in kept)
            touched = one.endswith(reached) and not (kind == "libero" and "depth" in one)
            assert same != touched, one
    for key in ADAPTER.episodes(out):
        before, after = ADAPTER.read(source.parent, key), ADAPTER.read(out, key)
        for view, wanted in edited(before).views.items():
            got = after.views[view]
            for t in range(before.length):
                assert np.array_equal(wanted.rgb(t), got.rgb(t))
                if wanted.depth:
                    assert np.allclose(wanted.depth(t), got.depth(t), atol=5.1e-4)
                    half = len(got.depth(t)) // 2
                    assert np.array_equal(wanted.depth(t)[half:], got.depth(t)[half:])
                if wanted.ids:
                    assert np.array_equal(wanted.ids(t), got.ids(t))


def _names(file: h5py.File) -> list[str]:
    names: list[str] = []
    file.visit(names.append)
    return names


def test_next_observations_follow(tmp_path: Path) -> None:
    source = sim_samples.robomimic(tmp_path / "in/lift.hdf5")
    out = gathered(source.parent, tmp_path / "out")
    episode = ADAPTER.read(out, "lift/demo_0")
    assert episode.length == STEPS + 1  # the last image is in next_obs alone
    with h5py.File(out / "lift.hdf5") as file:
        obs, later = (file[f"data/demo_0/{one}/agentview_image"][()] for one in ("obs", "next_obs"))
    assert np.array_equal(obs[1:], later[:-1])
    assert np.array_equal(later[-1], episode.views["agentview"].rgb(STEPS))


def test_next_observations_that_never_followed_are_refused(tmp_path: Path) -> None:
    path = sim_samples.robomimic(tmp_path / "lift.hdf5")
    with h5py.File(path, "r+") as file:
        file["data/demo_0/next_obs/agentview_image"][0] = 0
    episode = ADAPTER.read(tmp_path, "lift/demo_0")
    with pytest.raises(Unsupported, match="one step later"):
        ADAPTER.write(edited(episode), tmp_path / "out", "lift/demo_0", dict)


def test_facts_that_the_files_state(tmp_path: Path) -> None:
    sim_samples.robomimic(tmp_path / "lift.hdf5")
    sim_samples.libero(tmp_path / "bowl.hdf5")
    sim_samples.maniskill(tmp_path / "cube.h5")
    assert registry.adapter_for(tmp_path).name == "hdf5_sim"
    lift, bowl, cube = (
        ADAPTER.read(tmp_path, key) for key in ("lift/demo_0", "bowl/demo_0", "cube/traj_0")
    )
    assert (lift.descriptions, lift.rate) == (("lift the red cube",), 20)
    assert lift.views["agentview"].camera.K[0, 2] == (sim_samples.WIDTH - 1) / 2
    assert lift.views["agentview"].camera.placed
    assert lift.views["robot0_eye_in_hand"].camera.unplaced  # its matrix is no pose
    assert lift.robot.joint_positions.shape == (STEPS + 1, 7)
    assert {*np.unique(lift.robot.gripper_open)} <= {0.0, 1.0}
    with h5py.File(tmp_path / "bowl.hdf5") as file:
        stored = file["data/demo_0/obs/agentview_rgb"][1]
    assert np.array_equal(bowl.views["agentview"].rgb(1), stored[::-1])
    assert bowl.views["agentview"].depth is None
    assert any("agentview_depth" in words for words in bowl.unread)
    assert bowl.descriptions == ("pick up the bowl",)
    assert bowl.length == STEPS
    view = cube.views["base"]
    with h5py.File(tmp_path / "cube.h5") as file:
        assert np.allclose(
            view.depth(2), file["traj_0/obs/sensor_data/base/depth"][2, ..., 0] / 1e3
        )
    assert view.camera.placed
    assert np.allclose(cube.robot.gripper_to_world[0, :3, 3], [0.1, 0.2, 0.3])


def test_words_that_changed_are_the_demonstrations_own(tmp_path: Path) -> None:
    sim_samples.libero(tmp_path / "in/bowl.hdf5")
    sim_samples.robomimic(tmp_path / "in/lift.hdf5")
    out = gathered(
        tmp_path / "in",
        tmp_path / "out",
        lambda one: replace(
            one, descriptions=tuple(t.replace("bowl", "cup") for t in one.descriptions)
        ),
    )
    bowl = ADAPTER.read(out, "bowl/demo_0")
    assert bowl.descriptions == ("pick up the cup",)
    assert any("LIBERO" in words for words in ADAPTER.traps(bowl))
    assert not ADAPTER.traps(ADAPTER.read(out, "lift/demo_0"))


def test_a_moved_camera_is_written_where_the_file_has_it(tmp_path: Path) -> None:
    sim_samples.robomimic(tmp_path / "in/lift.hdf5")
    sim_samples.maniskill(tmp_path / "in/cube.h5")

    def moved(episode: Episode) -> Episode:
        name, view = next((n, v) for n, v in episode.views.items() if v.camera.placed)
        poses = view.camera.cam_to_world.copy()
        poses[:, 0, 3] += 0.5
        camera = replace(view.camera, cam_to_world=poses)
        return replace(episode, views={**episode.views, name: replace(view, camera=camera)})

    out = gathered(tmp_path / "in", tmp_path / "out", moved)
    for key in ADAPTER.episodes(out):
        wanted, got = moved(ADAPTER.read(tmp_path / "in", key)), ADAPTER.read(out, key)
        for name, view in wanted.views.items():
            assert np.allclose(view.camera.cam_to_world, got.views[name].camera.cam_to_world)
            assert np.array_equal(view.camera.K, got.views[name].camera.K)
    assert not list(out.rglob("cameras.yaml"))
    with h5py.File(out / "cube.h5") as file:
        group = file["traj_0/obs/sensor_param/base"]
        world_to_camera = np.vstack([group["extrinsic_cv"][0], [0, 0, 0, 1]])
        assert np.allclose(
            group["cam2world_gl"][0] @ np.diag([1, -1, -1, 1]) @ world_to_camera, np.eye(4)
        )


def test_a_run_numbers_on_and_extends_filter_keys(tmp_path: Path) -> None:
    path = sim_samples.robomimic(tmp_path / "in/lift.hdf5", demos=3)
    sim_samples.maniskill(tmp_path / "in/cube.h5")
    wanted = recipe.build({"version": 1, "copies": 1, "keep_originals": True, "edits": [LIGHT]})
    out = tmp_path / "out"
    assert augment(path.parent, wanted, out).exit_code == 0
    with h5py.File(path) as old, h5py.File(out / "lift.hdf5") as new:
        assert [*new["data"]] == [f"demo_{i}" for i in range(6)]
        assert new["data"].attrs["total"] == 6 * STEPS
        assert {*new["mask/train"]} == {b"demo_0", b"demo_1", b"demo_3", b"demo_4"}
        assert {*new["mask/valid"]} == {b"demo_2", b"demo_5"}
        for i in range(3):
            image, copy = (new[f"data/demo_{n}/obs/agentview_image"][()] for n in (i, i + 3))
            assert np.array_equal(image, old[f"data/demo_{i}/obs/agentview_image"][()])
            assert not np.array_equal(image, copy)
            same = (new[f"data/demo_{n}/actions"][()] for n in (i, i + 3))
            assert np.array_equal(*same)
    about = json.loads((out / "cube.json").read_text())
    assert [one["episode_id"] for one in about["episodes"]] == [0, 1, 2, 3]
    assert [one["reset_kwargs"]["seed"] for one in about["episodes"]] == [40, 41, 40, 41]
    assert not list(out.rglob("episode.*"))
    verdict = verify(out, path.parent)
    assert verdict.passed, verdict.findings
    assert augment(path.parent, wanted, out, resume=True).resumed == 10


def test_verify_sees_what_no_edit_reaches(tmp_path: Path) -> None:
    path = sim_samples.robomimic(tmp_path / "in/lift.hdf5")
    out = tmp_path / "out"
    augment(path.parent, recipe.build({"version": 1, "edits": [LIGHT]}), out)
    made = (out / "lift.hdf5").read_bytes()

    def verdict_of(place: str, attribute: str, value: object) -> set[str]:
        (out / "lift.hdf5").write_bytes(made)
        with h5py.File(out / "lift.hdf5", "r+") as file:
            if attribute:
                file[place].attrs[attribute] = value
            else:
                file[place][0] = value
        return {one.message for one in verify(out, path.parent).findings if one.level == "bad"}

    assert any("actions:" in words for words in verdict_of("data/demo_1/actions", "", 9))
    changed = verdict_of("data/demo_1", "model_file", "<none/>")
    assert any("attribute model_file" in words for words in changed)
    assert any("mask/train" in words for words in verdict_of("mask/train", "", b"demo_7"))
    assert any("mask/valid" in words for words in verdict_of("mask/valid", "", b"demo_0"))
    assert any("total" in words for words in verdict_of("data", "total", 1))


def test_a_run_that_was_killed_before_it_cleaned_up_goes_on(tmp_path: Path) -> None:
    path = sim_samples.robomimic(tmp_path / "in/lift.hdf5")
    out = tmp_path / "out"
    for key in ADAPTER.episodes(path.parent):
        ADAPTER.write(ADAPTER.read(path.parent, key), out, key, dict)
    kept = (out / "lift/demo_0/episode.hdf5").read_bytes()
    ADAPTER.finish(path.parent, out)
    (out / "lift/demo_0/episode.hdf5").write_bytes(kept)
    assert ADAPTER.episodes(out) == ["lift/demo_0", "lift/demo_1"]
    ADAPTER.finish(path.parent, out)
    with h5py.File(out / "lift.hdf5") as file:
        assert file["data"].attrs["total"] == 2 * STEPS
        assert list(file["mask/train"]) == [b"demo_0"]


@pytest.mark.parametrize("libver", [None, "latest"])
def test_an_unedited_copy_has_the_stored_chunks(libver: str | None, tmp_path: Path) -> None:
    path = sim_samples.robomimic(tmp_path / "in/lift.hdf5", libver=libver)
    out = gathered(path.parent, tmp_path / "out", lambda one: one)
    with h5py.File(path) as old, h5py.File(out / "lift.hdf5") as new:
        for name in ("obs/agentview_image", "next_obs/agentview_depth"):
            first, second = (file[f"data/demo_1/{name}"].id for file in (old, new))
            assert first.get_num_chunks() == second.get_num_chunks()
            at = first.get_chunk_info(0).chunk_offset
            assert first.read_direct_chunk(at) == second.read_direct_chunk(at)


@pytest.mark.parametrize(
    ("place", "value", "wanted"),
    [
        ("obs/agentview_image", np.zeros((STEPS - 1, 6, 8, 3), np.uint8), "3 images"),
        ("next_obs/agentview_image", None, "some of the cameras"),
        ("states", h5py.ExternalLink("elsewhere.hdf5", "states"), "a link"),
        ("states", h5py.SoftLink("/data/demo_1/states"), "a link"),
        ("obs/robot0_eef_pos", np.full((STEPS, 3), np.nan), "NaN"),
        ("actions", np.zeros((STEPS + 2, 7)), "num_samples"),
        ("rewards", "reference", "references"),
        ("again", "circle", "in one another"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, place: str, value: object, wanted: str) -> None:
    path = sim_samples.robomimic(tmp_path / "lift.hdf5")
    with h5py.File(path, "r+") as file:
        demo = file["data/demo_0"]
        if isinstance(value, str):
            value = demo if value == "circle" else np.array([demo.ref], h5py.ref_dtype)
        if place in demo:
            del demo[place]
        if value is not None:
            demo[place] = value
    with pytest.raises(BadInput, match=wanted) as caught:
        ADAPTER.read(tmp_path, "lift/demo_0")
    assert "lift.hdf5" in str(caught.value)


def test_states_without_images_say_what_to_do(tmp_path: Path) -> None:
    path = sim_samples.robomimic(tmp_path / "lift.hdf5")
    with h5py.File(path, "r+") as file:
        del file["data/demo_0/obs"], file["data/demo_0/next_obs"]
    with pytest.raises(BadInput, match="replay the states with cameras"):
        ADAPTER.read(tmp_path, "lift/demo_0")


def test_a_file_that_cannot_be_read_is_named_among_others(tmp_path: Path) -> None:
    sim_samples.robomimic(tmp_path / "lift.hdf5")
    (tmp_path / "stack.hdf5").write_bytes((tmp_path / "lift.hdf5").read_bytes()[:700])
    assert ADAPTER.episodes(tmp_path) == ["lift/demo_0", "lift/demo_1", "stack"]
    with pytest.raises(BadInput, match=r"stack\.hdf5"):
        ADAPTER.read(tmp_path, "stack")


def test_an_episode_of_another_source_gets_robomimics_layout(
    template: Path, tmp_path: Path
) -> None:
    episode = RLBench().read(template, RLBench().episodes(template)[0])
    key = ADAPTER.key_for(episode.key, 0)
    ADAPTER.write(replace(episode, rate=20.0), tmp_path, key, dict)
    ADAPTER.finish(template, tmp_path)
    again = ADAPTER.read(tmp_path, key)
    assert again.descriptions == episode.descriptions[:1]
    assert (again.rate, again.length) == (20, episode.length)
    assert np.allclose(again.robot.joint_positions, episode.robot.joint_positions)
    for name, view in episode.views.items():
        assert np.array_equal(view.rgb(0), again.views[name].rgb(0))
        assert np.array_equal(view.depth(0), again.views[name].depth(0))  # type: ignore[misc]
        assert np.array_equal(view.ids(0), again.views[name].ids(0))  # type: ignore[misc]
        assert np.allclose(view.camera.cam_to_world, again.views[name].camera.cam_to_world)
    assert not verify_faults(tmp_path)


def verify_faults(root: Path) -> list[str]:
    return list(ADAPTER.faults(root))
