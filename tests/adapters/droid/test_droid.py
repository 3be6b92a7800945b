"""Raw episodes of DROID: what was not edited stays, and what was is edited wherever the episode shows it."""

import json
from dataclasses import replace
from pathlib import Path

import droid_samples
import h5py
import numpy as np
import pytest
import yaml
from droid_samples import FIRST, FOLDER, SECOND, STEPS, UUID, WIDTH, WORDS, WRIST
from hypothesis import given, settings
from hypothesis import strategies as st
from rpaug_adapters.droid import DROID
from rpaug_adapters.droid.read import _poses
from rpaug_adapters.droid.write import euler
from rpaug_adapters.video.stream import Video
from runs import augment

from rpaug import BadInput, Episode, Unsupported
from rpaug.core import registry
from rpaug.pipeline import recipe
from rpaug.pipeline.contracts import AdapterContract
from rpaug.pipeline.convert import convert
from rpaug.pipeline.verify import verify

ADAPTER = DROID()
LIGHT = {"op": "light_color", "range": [[0.5, 0.5, 0.5], [0.6, 0.6, 0.6]]}
VIEWS = [
    f"{name}_{side}"
    for name in ("exterior_image_1", "exterior_image_2", "wrist_image")
    for side in ("left", "right")
]


class TestStereo(AdapterContract):
    def adapter(self) -> DROID:
        return ADAPTER

    def dataset(self, folder: Path) -> Path:
        return droid_samples.droid(folder)


class TestMonoWithDepth(TestStereo):
    def dataset(self, folder: Path) -> Path:
        return with_depth(folder)


def with_depth(folder: Path) -> Path:
    root = droid_samples.droid(folder, stereo=False, raw=False, depth=True, annotated=False)
    given = {
        f"{name}_left": {
            "K": droid_samples.K.tolist(),
            "depth": f"recordings/Depth/{serial}",
            "metres": 0.001,
        }
        for name, serial in (("exterior_image_1", FIRST), ("wrist_image", WRIST))
    }
    (root / "cameras.yaml").write_text(json.dumps({"version": 1, "cameras": given}))
    return root


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return droid_samples.droid(tmp_path / "in")


def darker(episode: Episode, *names: str) -> Episode:
    """Halved color in the left third of some views, depth a centimetre nearer."""

    def at(image, t):
        made = image(t).copy()
        made[:, : WIDTH // 3] //= 2
        return made

    views = dict(episode.views)
    for name in names:
        view = views[name]
        depth = view.depth and (
            lambda t, view=view: view.depth(t) - np.float32(0.01) * (view.depth(t) > 0)
        )
        views[name] = replace(view, rgb=lambda t, view=view: at(view.rgb, t), depth=depth)
    return replace(episode, views=views)


def test_all_of_an_episode_is_read(root: Path) -> None:
    assert registry.adapter_for(root).name == "droid"
    assert registry.adapter_for(root / FOLDER).name == "droid"
    (key,) = ADAPTER.episodes(root)
    episode = ADAPTER.read(root, key)
    assert key == FOLDER
    assert [*episode.views] == VIEWS
    assert episode.descriptions == tuple(WORDS.values())
    assert episode.rate == 15
    assert episode.length == STEPS
    assert any("SVO" in words for words in episode.unread)
    for name, serial in (
        ("exterior_image_1", FIRST),
        ("exterior_image_2", SECOND),
        ("wrist_image", WRIST),
    ):
        for side in ("left", "right"):
            view = episode.views[f"{name}_{side}"]
            assert view.camera.placed
            assert np.array_equal(view.camera.K, droid_samples.K)
            for t in (4, 0, 2):
                shown = droid_samples.picture(serial, side, t).astype(int)
                assert np.abs(view.rgb(t) - shown).mean() < 8
    assert episode.views["exterior_image_1_left"].camera.fixed
    assert not episode.views["wrist_image_left"].camera.fixed
    robot = episode.robot
    assert np.allclose(robot.joint_positions[3], np.linspace(0, 1, 7) + 0.03)
    assert np.allclose(robot.gripper_to_world[2, :3, 3], [0.4, 0.1, 0.32])
    assert np.allclose(robot.gripper_open, 0.75)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-3.1, 3.1), min_size=3, max_size=3))
def test_angles_come_back(angles: list[float]) -> None:
    pose = _poses(np.array([[1.0, 2, 3, *angles]]))
    again = _poses(np.concatenate([pose[:, :3, 3], euler(pose[:, :3, :3])], 1))
    assert np.allclose(pose, again, atol=1e-7)


def test_an_edit_of_the_left_eye_reaches_both_its_videos(root: Path, tmp_path: Path) -> None:
    episode = ADAPTER.read(root, FOLDER)
    made = darker(episode, "exterior_image_1_left")
    ADAPTER.write(made, tmp_path / "out", "AUTOLab/success/2023-07-07/episode_0", dict)
    (key,) = ADAPTER.episodes(tmp_path / "out")
    old, new = root / FOLDER / "recordings", tmp_path / "out" / key / "recordings"
    both = Video(new / f"MP4/{FIRST}-stereo.mp4")
    alone = Video(new / f"MP4/{FIRST}.mp4")
    for t in range(STEPS):
        wanted = made.views["exterior_image_1_left"].rgb(t).astype(int)
        for shown in (alone.rgb(t), both.rgb(t)[:, :WIDTH]):
            assert np.abs(shown - wanted).mean() < 8
            assert (
                np.abs(shown - episode.views["exterior_image_1_left"].rgb(t).astype(int)).mean()
                > 12
            )
    for name in (f"MP4/{SECOND}.mp4", f"MP4/{WRIST}-stereo.mp4", f"SVO/{SECOND}.svo"):
        assert (new / name).read_bytes() == (old / name).read_bytes()
    assert not (new / f"SVO/{FIRST}.svo").exists()
    assert (new.parent / "trajectory.h5").read_bytes() == (
        old.parent / "trajectory.h5"
    ).read_bytes()


def test_copies_have_names_of_their_own(root: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    episode = ADAPTER.read(root, FOLDER)
    for index in range(2):
        copy = replace(episode, descriptions=(f"copy {index}", "second"))
        ADAPTER.write(copy, out, ADAPTER.key_at(FOLDER, index), dict)
    ADAPTER.rename(
        out, "AUTOLab/success/2023-07-07/episode_1", "AUTOLab/success/2023-07-07/episode_7"
    )
    ADAPTER.finish(root, out)
    listed = json.loads((out / "aggregated-annotations-030724.json").read_text())
    assert listed[f"{UUID}+episode_7"] == {
        "language_instruction1": "copy 1",
        "language_instruction2": "second",
    }
    folder = out / "AUTOLab/success/2023-07-07/episode_7"
    about = json.loads((folder / f"metadata_{UUID}+episode_7.json").read_text())
    assert about["hdf5_path"] == "success/2023-07-07/episode_7/trajectory.h5"
    assert about["ext1_mp4_path"] == f"success/2023-07-07/episode_7/recordings/MP4/{FIRST}.mp4"
    assert not (folder / "language.json").exists()
    assert ADAPTER.read(out, "AUTOLab/success/2023-07-07/episode_0").descriptions == (
        "copy 0",
        "second",
    )


def test_the_task_is_the_instruction_where_there_is_no_annotation(tmp_path: Path) -> None:
    root = droid_samples.droid(tmp_path / "in", annotated=False)
    episode = ADAPTER.read(root, FOLDER)
    assert episode.descriptions == ("Move object into container",)
    ADAPTER.write(replace(episode, descriptions=("other",)), tmp_path / "out", "episode_0", dict)
    with h5py.File(tmp_path / "out/episode_0/trajectory.h5") as file:
        assert file.attrs["current_task"] == "other"
        assert file.attrs["building"] == "main"
    assert ADAPTER.read(tmp_path / "out", "episode_0").descriptions == ("other",)


@pytest.mark.parametrize("name", ["exterior_image_2_left", "wrist_image_left"])
def test_moved_cameras_are_where_droid_has_them(root: Path, tmp_path: Path, name: str) -> None:
    episode = ADAPTER.read(root, FOLDER)
    view = episode.views[name]
    bump = _poses(np.array([[0.02, 0.01, 0.0, 0.1, -0.05, 0.2]]))[0]
    camera = replace(view.camera, cam_to_world=view.camera.cam_to_world @ bump)
    moved = replace(episode, views={**episode.views, name: replace(view, camera=camera)})
    ADAPTER.write(moved, tmp_path / "out", "episode_0", dict)
    after = ADAPTER.read(tmp_path / "out", "episode_0")
    assert np.allclose(after.views[name].camera.cam_to_world, camera.cam_to_world, atol=1e-9)
    assert not (tmp_path / "out/episode_0/cameras.yaml").exists()
    with h5py.File(tmp_path / "out/episode_0/trajectory.h5") as file:
        offset = file[f"observation/camera_extrinsics/{WRIST}_left_gripper_offset"][:]
    carried = (
        np.linalg.inv(episode.robot.gripper_to_world)
        @ after.views["wrist_image_left"].camera.cam_to_world
    )
    assert np.allclose(_poses(offset), carried, atol=0.2 if "exterior" in name else 1e-9)


def test_depth_is_read_and_written_where_its_unit_is_stated(tmp_path: Path) -> None:
    root = with_depth(tmp_path / "in")
    episode = ADAPTER.read(root, FOLDER)
    view = episode.views["wrist_image_left"]
    assert view.camera.placed
    assert np.isclose(view.depth(3)[5, 5], 0.903)
    assert episode.views["exterior_image_2_left"].depth is None
    ADAPTER.write(darker(episode, "wrist_image_left"), tmp_path / "out", "episode_0", dict)
    after = ADAPTER.read(tmp_path / "out", "episode_0")
    assert np.allclose(after.views["wrist_image_left"].depth(3)[5], 0.893)
    assert after.views["wrist_image_left"].depth(3)[0, 0] == 0
    assert np.isclose(ADAPTER.read(root, FOLDER).views["wrist_image_left"].depth(3)[5, 5], 0.903)


def test_a_video_may_show_both_eyes_without_saying_so(tmp_path: Path) -> None:
    root = droid_samples.droid(tmp_path / "in")
    for path in (root / FOLDER / "recordings/MP4").glob("*-stereo.mp4"):
        path.replace(path.with_name(path.name.replace("-stereo", "")))
    assert [*ADAPTER.read(root, FOLDER).views] == VIEWS


def test_svo_alone_is_refused_with_what_to_do(root: Path) -> None:
    for path in (root / FOLDER / "recordings/MP4").glob(f"{SECOND}*"):
        path.unlink()
    with pytest.raises(BadInput, match=r"SVO/26405488\.svo.*svo2mp4"):
        ADAPTER.read(root, FOLDER)
    (root / FOLDER / f"recordings/SVO/{SECOND}.svo").unlink()
    episode = ADAPTER.read(root, FOLDER)
    assert "exterior_image_2_left" not in episode.views
    assert any(SECOND in words for words in episode.unread)


def test_the_shortest_video_ends_an_episode(root: Path) -> None:
    path = root / FOLDER / f"recordings/MP4/{WRIST}"
    for end, width in ((".mp4", 1), ("-stereo.mp4", 2)):
        images = [np.hstack([droid_samples.picture(WRIST, "left", t)] * width) for t in range(3)]
        droid_samples.film(path.with_name(path.name + end), images)
    assert ADAPTER.read(root, FOLDER).length == 3


def test_cameras_without_calibration_or_intrinsics_are_no_measured_ones(tmp_path: Path) -> None:
    root = droid_samples.droid(tmp_path / "in", intrinsics=False)
    with h5py.File(root / FOLDER / "trajectory.h5", "r+") as file:
        file[f"observation/camera_extrinsics/{FIRST}_left"][...] = 0
    episode = ADAPTER.read(root, FOLDER)
    assert all(view.camera.assumed for view in episode.views.values())
    given = {
        name: {"K": droid_samples.K.tolist()}
        for name in ("exterior_image_1_left", "exterior_image_2_left")
    }
    (root / "cameras.yaml").write_text(json.dumps({"version": 1, "cameras": given}))
    views = ADAPTER.read(root, FOLDER).views
    assert views["exterior_image_1_left"].camera.unplaced
    assert views["exterior_image_2_left"].camera.placed


def test_other_recordings_are_not_made_up(root: Path, tmp_path: Path) -> None:
    other = replace(ADAPTER.read(root, FOLDER), source=None)
    with pytest.raises(Unsupported, match="as they were filmed"):
        ADAPTER.write(other, tmp_path / "out", "episode_0", dict)


def test_a_run_is_verified_and_damage_is_seen(root: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    job = recipe.build({"version": 1, "seed": 3, "copies": 2, "edits": [LIGHT]})
    summary = augment(root, job, out)
    assert summary.copies == 2
    assert verify(out, root).passed
    with h5py.File(out / "AUTOLab/success/2023-07-07/episode_1/trajectory.h5", "r+") as file:
        file["action/gripper_velocity"][2] = 9
    assert any(
        "gripper_velocity" in finding.message
        for finding in verify(out, root).findings
        if finding.level == "bad"
    )


def test_in_rlds_it_has_its_cameras_words_and_extrinsics(root: Path, tmp_path: Path) -> None:
    done = convert(root, tmp_path / "rlds", "rlds")
    assert done.episodes == 1
    (stated,) = (tmp_path / "rlds").rglob("cameras.yaml")
    track = "observation/camera_extrinsics/{}_left"
    named = (("exterior_image_1", FIRST), ("exterior_image_2", SECOND), ("wrist_image", WRIST))
    given = {
        f"{name}_left": {"K": droid_samples.K.tolist(), "pose_key": track.format(serial)}
        for name, serial in named
    }
    stated.write_text(json.dumps(yaml.safe_load(stated.read_text()) | {"cameras": given}))
    (key,) = registry.adapter("rlds").episodes(tmp_path / "rlds")
    recorded, made = (
        ADAPTER.read(root, FOLDER),
        registry.adapter("rlds").read(tmp_path / "rlds", key),
    )
    assert made.descriptions == recorded.descriptions
    assert [*made.views] == VIEWS
    for name in given:
        old, new = recorded.views[name], made.views[name]
        assert np.array_equal(old.rgb(2), new.rgb(2))
        assert np.allclose(old.camera.cam_to_world, new.camera.cam_to_world)


@pytest.mark.parametrize("name", ["key.txt", "recordings/more", "model.pkl", "MP4/a.mp4"])
def test_links_out_and_pickles_are_refused_by_name(name: str, tmp_path: Path) -> None:
    root = droid_samples.droid(tmp_path / "in")
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside/secret").write_text("secret")
    path = root / FOLDER / name
    path.parent.mkdir(exist_ok=True)
    if name.endswith("pkl"):
        path.write_bytes(b"cos\nsystem\n.")
    else:
        path.symlink_to(tmp_path / "outside" / ("" if name.endswith("more") else "secret"))
    key = next(key for key in ADAPTER.episodes(root) if FOLDER.endswith(key) or key in FOLDER)
    with pytest.raises(BadInput, match=path.name):
        ADAPTER.write(ADAPTER.read(root, key), tmp_path / "out", "episode_0", dict)
    assert not [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
