"""RDT's HDF5 files: colors as its reader takes them, storage kept, nothing followed out of a file."""

import json
import struct
from dataclasses import replace
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
import yaml
from rpaug_adapters.rdt import RDT
from rpaug_adapters.rlbench import RLBench

from rpaug import BadInput, CameraView, Episode, Unsupported, files
from rpaug.pipeline.contracts import AdapterContract

KEY = "pour/episode_0"
STEPS, HEIGHT, WIDTH = 4, 12, 16
WORDS = "expanded_instruction_gpt-4-turbo.json"


def picture(seed: int) -> np.ndarray:
    """Smooth and colorful: what is stored must be told from its mirror in red and blue."""
    rng = np.random.default_rng(seed)
    return cv2.resize(rng.integers(0, 255, (3, 3, 3), np.uint8), (WIDTH, HEIGHT))


def jpeg(rgb: np.ndarray) -> bytes:
    return cv2.imencode(".jpg", rgb, [cv2.IMWRITE_JPEG_QUALITY, 100])[
        1
    ].tobytes()  # as RDT: not turned


def dataset(folder: Path) -> Path:
    """Two episodes among others in one folder, as RDT has them; every way to store images is there."""
    (folder / "pour").mkdir(parents=True)
    given = {
        "instruction": "pour the water",
        "simplified_instruction": ["pour"],
        "expanded_instruction": ["pour it"],
    }
    (folder / "pour" / WORDS).write_text(json.dumps(given))
    for i in range(2):
        with h5py.File(folder / "pour" / f"episode_{i}.hdf5", "w") as file:
            file.attrs["sim"] = False
            rng = np.random.default_rng(i)
            file["observations/qpos"] = rng.normal(size=(STEPS, 14))
            file["action"] = rng.normal(size=(STEPS, 14))
            images = [jpeg(picture(t)) for t in range(STEPS)]
            file["observations/images/cam_high"] = np.array(images, "S")
            width = max(map(len, images)) + 5
            rows = [np.frombuffer(data.ljust(width, b"\0"), np.uint8) for data in images]
            file["observations/images/cam_left_wrist"] = np.stack(rows)
            kind = h5py.vlen_dtype(np.uint8)
            vary = file.create_dataset("observations/images/cam_right_wrist", (STEPS,), kind)
            for t, data in enumerate(images):
                vary[t] = np.frombuffer(data, np.uint8)
            file["observations/images/raw"] = np.stack([picture(t) for t in range(STEPS)])
            file["observations/images_depth/cam_high"] = np.full(
                (STEPS, HEIGHT, WIDTH), 1500, np.uint16
            )
            file["compress_len"] = np.array([[len(data) for data in images]])
            file["observations"].attrs["hand"] = "left"
    return folder


class TestContract(AdapterContract):
    def adapter(self) -> RDT:
        return RDT()

    def dataset(self, folder: Path) -> Path:
        return dataset(folder)


def halved(view: CameraView) -> CameraView:
    return replace(view, rgb=lambda t: view.rgb(t) // 2 if t == 1 else view.rgb(t))


def test_colors_are_what_opencv_decodes_unturned(tmp_path: Path) -> None:
    episode = RDT().read(dataset(tmp_path), KEY)
    for name, view in episode.views.items():
        shown = view.rgb(2).astype(int)
        assert np.abs(shown - picture(2)).mean() < 8, name
        assert np.abs(shown - picture(2)[..., ::-1]).mean() > 20, name
    assert episode.descriptions == ("pour the water", "pour", "pour it")


def test_an_unedited_episode_has_its_bytes(tmp_path: Path) -> None:
    root = dataset(tmp_path / "in")
    RDT().write(RDT().read(root, KEY), tmp_path / "out", KEY, dict)
    written = tmp_path / "out" / KEY / "episode_0.hdf5"
    assert written.read_bytes() == (root / f"{KEY}.hdf5").read_bytes()
    assert json.loads((written.parent / WORDS).read_text())["simplified_instruction"] == ["pour"]


def test_an_edit_keeps_how_images_are_stored(tmp_path: Path) -> None:
    root = dataset(tmp_path / "in")
    episode = RDT().read(root, KEY)
    views = {name: halved(view) for name, view in episode.views.items()}
    RDT().write(replace(episode, views=views), tmp_path / "out", KEY, dict)
    again = RDT().read(tmp_path / "out", KEY)
    old, new = h5py.File(root / f"{KEY}.hdf5"), h5py.File(tmp_path / "out" / KEY / "episode_0.hdf5")
    with old, new:
        for name, view in views.items():
            place = f"observations/images/{name}"
            assert old[place].ndim == new[place].ndim
            assert old[place].dtype.kind == new[place].dtype.kind
            for t in range(STEPS):
                off = again.views[name].rgb(t).astype(int) - view.rgb(t)
                assert np.abs(off).max() <= (3 if t == 1 else 0)
        assert (
            new["compress_len"][...] >= new["observations/images/cam_left_wrist"].shape[1]
        ).all()
        assert np.array_equal(old["action"], new["action"])
        assert not new.attrs["sim"]
        assert new["observations"].attrs["hand"] == "left"


def test_depth_and_cameras_by_the_side_file(tmp_path: Path) -> None:
    root = dataset(tmp_path / "in")
    camera = {"field_of_view": 60, "depth": "observations/images_depth/cam_high", "metres": 0.001}
    given = {"cameras": {"cam_high": camera}, "views": ["cam_high", "cam_right_wrist"]}
    (root / "pour/cameras.yaml").write_text(yaml.safe_dump(given))
    episode = RDT().read(root, KEY)
    view = episode.views["cam_high"]
    assert list(episode.views) == ["cam_high", "cam_right_wrist"]
    assert view.depth is not None
    assert view.depth(0) == pytest.approx(1.5)
    near = replace(view, depth=lambda t: view.depth(t) - 0.25)  # type: ignore[misc]
    RDT().write(
        replace(episode, views={**episode.views, "cam_high": near}), tmp_path / "out", KEY, dict
    )
    again = RDT().read(tmp_path / "out", KEY).views["cam_high"]
    assert again.depth is not None
    assert again.depth(3) == pytest.approx(1.25)


def test_links_out_of_a_file_are_not_followed(tmp_path: Path) -> None:
    root = dataset(tmp_path)
    with h5py.File(root / f"{KEY}.hdf5", "a") as file:
        del file["observations/images/raw"]
        file["observations/images/raw"] = h5py.ExternalLink(
            "episode_1.hdf5", "observations/images/raw"
        )
    with pytest.raises(BadInput, match="a link"):
        RDT().read(root, KEY)


@pytest.mark.parametrize(
    ("name", "value", "wanted"),
    [
        ("observations/qpos", np.full((STEPS, 14), np.nan), "finite"),
        ("observations/images/cam_high", np.array([b"no"] * STEPS, "S"), "cam_high[0]"),
        ("observations/images/cam_high", np.array([b"no"] * 2, "S"), "4 images"),
        ("observations/images/cam_high", np.zeros((STEPS, 3, 3, 3, 3)), "encoded images"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, name: str, value: np.ndarray, wanted: str) -> None:
    root = dataset(tmp_path)
    with h5py.File(root / f"{KEY}.hdf5", "a") as file:
        del file[name]
        file[name] = value
    with pytest.raises(BadInput) as caught:
        RDT().read(root, KEY)
    assert wanted in str(caught.value)
    assert "episode_0.hdf5" in str(caught.value)


def test_a_cut_off_file_is_refused(tmp_path: Path) -> None:
    root = dataset(tmp_path)
    path = root / f"{KEY}.hdf5"
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(BadInput, match=r"episode_0\.hdf5"):
        RDT().read(root, KEY)


def recorded_elsewhere(template: Path) -> Episode:
    return RLBench().read(template, RLBench().episodes(template)[0])


def test_an_episode_of_another_source_gets_rdts_layout(template: Path, tmp_path: Path) -> None:
    episode = recorded_elsewhere(template)
    RDT().write(episode, tmp_path, KEY, dict)
    with h5py.File(tmp_path / KEY / "episode_0.hdf5") as file:
        qpos, action = file["observations/qpos"][:], file["action"][:]
        assert qpos.shape == action.shape == (episode.length, 14)
        assert np.array_equal(qpos[:, 7:13], episode.robot.joint_positions[:, :6])
        assert np.array_equal(action[:-1, 7:13], qpos[1:, 7:13])
        opening = episode.robot.gripper_open
        assert np.allclose(qpos[:, 13] / 4.7888, opening)
        assert np.array_equal(file["unified/state"][:, :7], episode.robot.joint_positions[:, :7])
        stored = cv2.imdecode(np.frombuffer(file["observations/images/cam_high"][0], np.uint8), 1)
    (name,) = {"front", "cam_high"} & set(episode.views) or {next(iter(episode.views))}
    assert np.abs(stored.astype(int) - episode.views[name].rgb(0)).max() <= 8
    again = RDT().read(tmp_path, KEY)
    assert again.descriptions == episode.descriptions
    assert set(again.views) == set(episode.views)  # by their own names, and none that is black
    view = again.views[name]
    assert view.depth is not None
    assert np.array_equal(view.depth(0), episode.views[name].depth(0))  # type: ignore[misc]
    assert np.allclose(view.camera.cam_to_world, episode.views[name].camera.cam_to_world)


def test_a_gripper_without_an_opening_has_none_under_a_moved_camera(
    template: Path, tmp_path: Path
) -> None:
    episode = recorded_elsewhere(template)
    shut = replace(episode, robot=replace(episode.robot, gripper_open=None))
    RDT().write(shut, tmp_path / "in", KEY, dict)
    there = RDT().read(tmp_path / "in", KEY)
    assert there.robot.gripper_open is None
    name, view = next(iter(there.views.items()))
    moved = replace(view, camera=replace(view.camera, cam_to_world=view.camera.cam_to_world.copy()))
    RDT().write(replace(there, views={**there.views, name: moved}), tmp_path / "out", KEY, dict)
    assert RDT().read(tmp_path / "out", KEY).robot.gripper_open is None


def test_a_robot_without_joints_cannot_be_written(template: Path, tmp_path: Path) -> None:
    episode = recorded_elsewhere(template)
    none = replace(episode.robot, joint_positions=np.zeros((episode.length, 0)))
    with pytest.raises(Unsupported, match="joint positions"):
        RDT().write(replace(episode, robot=none), tmp_path, KEY, dict)
    assert not list(tmp_path.rglob("*.hdf5"))


def test_colors_that_lie_elsewhere_are_named_by_the_side_file(tmp_path: Path) -> None:
    root = dataset(tmp_path)
    path = root / "pour/episode_0.hdf5"
    with h5py.File(path, "r+") as file:
        file.move("observations/images/cam_high", "observations/rgb/outside")
    given = {
        "images": {"third_person": "observations/rgb/outside"},
        "views": ["third_person", "raw"],
    }
    (root / "pour/cameras.yaml").write_text(yaml.safe_dump(given))
    episode = RDT().read(root, KEY)
    assert list(episode.views) == ["raw", "third_person"]
    dark = replace(episode.views["third_person"], rgb=lambda t: picture(t) // 2)
    edited = replace(episode, views={**episode.views, "third_person": dark})
    RDT().write(edited, tmp_path / "out", KEY, dict)
    again = RDT().read(tmp_path / "out", KEY)
    assert np.abs(again.views["third_person"].rgb(1).astype(int) - picture(1) // 2).mean() < 4
    given["images"] = {"third_person": "observations/rgb/nowhere"}
    (root / "pour/cameras.yaml").write_text(yaml.safe_dump(given))
    with pytest.raises(BadInput, match=r"images\.third_person: found observations/rgb/nowhere"):
        RDT().read(root, KEY)


def test_references_in_place_of_numbers_are_refused(tmp_path: Path) -> None:
    root = dataset(tmp_path)
    with h5py.File(next(root.rglob("*.hdf5")), "r+") as file:
        steps = len(file["action"])
        del file["action"]
        file.create_dataset("action", (steps,), h5py.ref_dtype)
    with pytest.raises(BadInput, match="action: found references to other places"):
        RDT().read(root, KEY)


def test_a_file_that_crashes_the_library_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Extents that do not fit the index of chunks, under a right checksum: libhdf5 2.0 reads beyond its memory."""
    monkeypatch.syspath_prepend(Path(__file__).parents[3] / "tools/fuzz")
    import sealed

    (tmp_path / "bad").mkdir()
    path = tmp_path / "bad/bad.hdf5"
    with h5py.File(path, "w", libver="latest") as file:
        file["observations/qpos"] = np.zeros((STEPS, 14))
        raw = np.stack([picture(t) for t in range(STEPS)])
        chunks = (1, HEIGHT, WIDTH, 3)
        file.create_dataset("observations/images/raw", data=raw, chunks=chunks, compression="gzip")
    assert RDT().read(tmp_path, "bad").length == STEPS
    data, shape = path.read_bytes(), struct.pack("<4Q", STEPS, HEIGHT, WIDTH, 3)
    at, length = next(
        (at, length) for at, length in sealed.parts(data) if 2 * shape in data[at : at + length]
    )
    largest = struct.pack("<4Q", STEPS, 2**56, 2**40, 3)
    part = data[at : at + length].replace(2 * shape, shape + largest)
    seal = struct.pack("<I", sealed.lookup3(part))
    path.write_bytes(data[:at] + part + seal + data[at + length + 4 :])
    with pytest.raises(BadInput, match="HDF5: found"):
        RDT().read(tmp_path, "bad").views["raw"].rgb(1)
    assert RDT().read(dataset(tmp_path / "good"), KEY).length == STEPS  # who reads for us is back


def test_a_single_arm_with_two_rgbd_cameras(tmp_path: Path) -> None:
    """As in docs/formats.md: third-person and wrist camera, depth in millimetres, poses and gripper by a key map."""
    eye = [[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1]]
    K = [[15.0, 0, 8], [0, 15, 6], [0, 0, 1]]
    poses = np.tile(np.eye(4), (STEPS, 1, 1))
    poses[:, 0, 3] = np.arange(STEPS) / 10
    (tmp_path / "arm").mkdir()
    with h5py.File(tmp_path / "arm/episode_0.hdf5", "w") as file:
        file["observations/qpos"] = np.zeros((STEPS, 14))
        file["observations/joints"] = np.arange(STEPS * 7.0).reshape(STEPS, 7)
        file["observations/wrist_pose"] = poses.reshape(STEPS, 16)
        file["observations/eef"] = np.tile([0.1, 0.2, 0.3, 0, 0, 0, 1, 0.5], (STEPS, 1))
        for name in ("cam_high", "cam_right_wrist"):
            images = [jpeg(picture(t)) for t in range(STEPS)]
            file[f"observations/images/{name}"] = np.array(images, "S")
            deep = np.full((STEPS, HEIGHT, WIDTH), 1500, np.uint16)
            file[f"observations/images_depth/{name}"] = deep

    def camera(name: str, **where: object) -> dict:
        return {"K": K, "depth": f"observations/images_depth/{name}", "metres": 0.001, **where}

    given = {
        "version": 1,
        "views": ["cam_high", "cam_right_wrist"],
        "cameras": {
            "cam_high": camera("cam_high", cam_to_world=eye),
            "cam_right_wrist": camera("cam_right_wrist", pose_key="observations/wrist_pose"),
        },
        "gripper": {
            "key": "observations/eef", "position": [0, 1, 2], "rotation": [3, 4, 5, 6],
            "convention": "quaternion_xyzw", "opening": 7,
        },
        "joints": "observations/joints",
    }  # fmt: skip
    (tmp_path / "arm/cameras.yaml").write_text(yaml.safe_dump(given))
    episode = RDT().read(tmp_path, "arm/episode_0")
    wrist = episode.views["cam_right_wrist"]
    assert np.array_equal(wrist.camera.cam_to_world, poses)
    assert np.allclose(wrist.depth(0), 1.5)
    assert episode.robot.joint_positions.shape == (STEPS, 7)
    assert np.allclose(episode.robot.gripper_to_world[0, :3, 3], [0.1, 0.2, 0.3])
    assert np.allclose(episode.robot.gripper_open, 0.5)
    assert any("128 steps" in words for words in RDT().traps(episode))


def test_each_form_of_the_instruction_keeps_its_own_texts(tmp_path: Path) -> None:
    root = dataset(tmp_path / "in")
    given = {
        "instruction": "pour the red cup",
        "simplified_instruction": ["pour red cup", "pour"],
        "expanded_instruction": ["pour the red cup out"],
        "author": "gpt-4-turbo",
    }
    (root / "pour" / WORDS).write_text(json.dumps(given))
    episode = RDT().read(root, KEY)
    words = tuple(text.replace("red", "blue") for text in episode.descriptions)
    RDT().write(replace(episode, descriptions=words), tmp_path / "out", KEY, dict)
    made = json.loads((tmp_path / "out" / KEY / WORDS).read_text())
    assert made == json.loads(json.dumps(given).replace("red", "blue"))


@pytest.mark.parametrize("name", ["action", "observations/qpos"])
def test_what_no_edit_reaches_is_listed_for_verify(tmp_path: Path, name: str) -> None:
    root = dataset(tmp_path)
    before = RDT().untouched(RDT().read(root, KEY), False)
    assert "observations/images/cam_high" not in before
    with h5py.File(root / f"{KEY}.hdf5", "r+") as file:
        file[name][0, 0] += 1
        file.attrs["sim"] = True
    after = RDT().untouched(RDT().read(root, KEY), False)
    assert {one for one in before if before[one] != after[one]} == {name, "/, attribute sim"}


def test_rdts_reader_finds_no_rejected_copy(tmp_path: Path) -> None:
    """It takes every `*.hdf5` below its folder, the rejected copies of a run among them."""
    adapter, out = RDT(), tmp_path / "out"
    episode = adapter.read(dataset(tmp_path / "in"), KEY)
    adapter.write(episode, out, "episode_0", dict)
    adapter.write(episode, out / files.REJECTED, "episode_0", dict)
    adapter.rename(out / files.REJECTED, "episode_0", "episode_1")
    assert [path.stem for path in out.rglob("*.hdf5")] == ["episode_0"]
    assert adapter.episodes(out) == ["episode_0"]
    assert adapter.episodes(out / files.REJECTED) == ["episode_1"]
    again = adapter.read(out / files.REJECTED, "episode_1")
    assert np.array_equal(again.robot.joint_positions, episode.robot.joint_positions)
