"""RLDS episodes: bytes kept, shards and counts right, depth and cameras by the side file, refusals."""

import json
import os
import shutil
import tracemalloc
from dataclasses import replace
from pathlib import Path

import crashing
import cv2
import numpy as np
import pytest
import yaml
from rlds_samples import SIDE, STEPS, dataset
from rpaug_adapters.rlds import RLDS, shards, tfrecord
from rpaug_adapters.rlds.example import Example

from rpaug import BadInput, CameraView, Episode
from rpaug.pipeline.contracts import AdapterContract

KEY = "toy/1.0.0/train/0"


class TestContract(AdapterContract):
    def adapter(self) -> RLDS:
        return RLDS()

    def dataset(self, folder: Path) -> Path:
        return dataset(folder)


def files(root: Path) -> dict[str, bytes]:
    return {
        path.name: path.read_bytes() for path in (root / "toy/1.0.0").iterdir() if path.is_file()
    }


def copied(source: Path, target: Path, keys: list[str]) -> None:
    for key in keys:
        RLDS().write(RLDS().read(source, key), target, key, lambda: {"note.txt": b"hello"})
    RLDS().finish(source, target)


def calibrated(root: Path, depth: str, metres: float = 1.0) -> Path:
    pose = [[1, 0, 0, 0.1], [0, 1, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1]]
    camera = {"field_of_view": 60, "cam_to_world": pose, "depth": depth, "metres": metres}
    given = {
        "version": 1,
        "cameras": {"image": camera},
        "gripper": {"key": "observation/state"},
    }
    (root / "toy/1.0.0/cameras.yaml").write_text(yaml.safe_dump(given))
    return root


def brighter(view: CameraView, only: int) -> CameraView:
    return replace(view, rgb=lambda t: view.rgb(t) // 2 if t == only else view.rgb(t))


def test_episodes_are_numbered_within_their_split(tmp_path: Path) -> None:
    assert list(RLDS().episodes(dataset(tmp_path))) == [
        *(f"toy/1.0.0/train/{i}" for i in range(3)),
        "toy/1.0.0/val/0",
    ]
    assert RLDS().episodes(tmp_path / "toy/1.0.0") == ["train/0", "train/1", "train/2", "val/0"]


def test_an_unedited_dataset_has_the_bytes_of_its_source(tmp_path: Path) -> None:
    root = dataset(tmp_path / "in")
    copied(root, tmp_path / "out", list(RLDS().episodes(root)))
    assert files(tmp_path / "out") == files(root)


def test_shards_that_hold_other_numbers_than_stated_are_found(tmp_path: Path) -> None:
    folder = dataset(tmp_path, train=(2, 1), val=()) / "toy/1.0.0"
    assert list(shards.faults(folder)) == []
    path = folder / shards.INFO
    path.write_text(
        path.read_text().replace('"2"', '"x"').replace('"1"', '"2"').replace('"x"', '"1"')
    )
    (fault,) = shards.faults(folder)
    assert "shardLengths: found [1, 2]; expected [2, 1]" in fault


def test_shards_and_counts_follow_what_was_written(tmp_path: Path) -> None:
    root = dataset(tmp_path / "in", train=(2, 2), val=())
    keys = [f"toy/1.0.0/train/{i}" for i in range(3)]
    copied(root, tmp_path / "out", keys)
    info = json.loads(files(tmp_path / "out")["dataset_info.json"])
    (split,) = info["splits"]
    assert split["shardLengths"] == ["2", "1"]
    sizes = [len(RLDS().read(root, key).source.example.data) for key in keys]
    assert split["numBytes"] == str(sum(sizes))
    assert list(RLDS().episodes(tmp_path / "out")) == keys
    assert (tmp_path / "out" / keys[2] / "note.txt").is_file()


def test_a_finished_output_can_grow(tmp_path: Path) -> None:
    root = dataset(tmp_path / "in")
    keys = list(RLDS().episodes(root))
    copied(root, tmp_path / "out", keys[:2])
    copied(root, tmp_path / "out", keys[2:])
    assert files(tmp_path / "out") == files(root)


def test_one_episode_is_in_memory_however_many_there_are(tmp_path: Path) -> None:
    peaks = []
    for count in (4, 80):
        root, out = dataset(tmp_path / f"in{count}", train=(count,)), tmp_path / f"out{count}"
        keys = list(RLDS().episodes(root))
        copied(root, tmp_path / "warm", keys[:1])  # what is loaded and remembered once
        shutil.rmtree(tmp_path / "warm")
        tracemalloc.start()
        for key in keys:
            episode = RLDS().read(root, key)
            views = {name: brighter(view, 1) for name, view in episode.views.items()}
            RLDS().write(replace(episode, views=views), out, key, dict)
        RLDS().finish(root, out)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    record = len(RLDS().read(root, keys[0]).source.example.data)
    assert peaks[1] - peaks[0] < 2 * record  # 76 more episodes: their keys and numbers


@pytest.mark.parametrize("grown", [False, True])
def test_killed_anywhere_while_packing_it_comes_to_the_same(grown: bool, tmp_path: Path) -> None:
    root, out = dataset(tmp_path / "in"), tmp_path / "out"
    (root / "toy/1.0.0/toy.labels.txt").write_text("cup")
    for number, key in enumerate(RLDS().episodes(root)):
        side = dict if number % 2 else lambda: {"note.txt": b""}
        RLDS().write(RLDS().read(root, key), out, key, side)
        if grown and number == 1:
            RLDS().finish(root, out)
    every = 1 if "RPAUG_EVERY_POINT" in os.environ else 3
    found = crashing.points("rlds", root, out, tmp_path / "work", every)
    assert len(found) > 10
    assert [one for one in found if one["again"] or one["differ"]] == []


def test_packing_takes_a_shard_of_disk_beside_the_episodes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root, out = dataset(tmp_path / "in", train=(1,) * 8, val=(1,)), tmp_path / "out"
    for key in RLDS().episodes(root):
        RLDS().write(RLDS().read(root, key), out, key, dict)
    staged = sum(path.stat().st_size for path in out.rglob(shards.STAGED))
    most, replace_ = [0], os.replace

    def replaced(one: Path, other: Path) -> None:
        replace_(one, other)
        held = (path.stat().st_size for path in out.rglob("*tfrecord*") if path.is_file())
        most.append(sum(held))

    monkeypatch.setattr(os, "replace", replaced)
    RLDS().finish(root, out)
    assert staged < max(most) < 1.3 * staged
    assert files(out) == files(root)


def test_only_changed_images_are_encoded_anew(tmp_path: Path) -> None:
    root = dataset(tmp_path / "in")
    episode = RLDS().read(root, KEY)
    views = {name: brighter(view, 1) for name, view in episode.views.items()}
    RLDS().write(replace(episode, views=views), tmp_path / "out", KEY, dict)
    before = episode.source.example
    after = RLDS().read(tmp_path / "out", KEY).source.example
    assert list(after.features) == list(before.features)
    for name, feature in before.features.items():
        old, new = (
            before.data[slice(*feature.entry)],
            after.data[slice(*after.features[name].entry)],
        )
        if name in ("steps/observation/image", "steps/observation/wrist"):
            same = [a == b for a, b in zip(before.blobs(name), after.blobs(name), strict=True)]
            assert same == [True, False, True]
        else:
            assert old == new, name
    shown = RLDS().read(tmp_path / "out", KEY)
    assert np.array_equal(shown.views["wrist"].rgb(1), views["wrist"].rgb(1))  # PNG
    off = shown.views["image"].rgb(1).astype(int) - views["image"].rgb(1)  # JPEG
    assert np.abs(off).max() <= 3


def test_the_instruction_is_written_where_it_was(tmp_path: Path) -> None:
    episode = RLDS().read(dataset(tmp_path / "in"), KEY)
    assert episode.descriptions == ("put the cup away",)
    RLDS().write(replace(episode, descriptions=("put the mug away",)), tmp_path / "out", KEY, dict)
    again = RLDS().read(tmp_path / "out", KEY)
    assert again.source.example.blobs("steps/language_instruction") == [b"put the mug away"] * STEPS


def test_cameras_are_stand_ins_unless_told(tmp_path: Path) -> None:
    root = dataset(tmp_path)
    assert all(view.camera.assumed for view in RLDS().read(root, KEY).views.values())
    episode = RLDS().read(calibrated(root, "observation/depth", 0.001), KEY)
    camera = episode.views["image"].camera
    assert not camera.assumed
    assert camera.K[0, 0] == pytest.approx(SIDE / 2 / np.tan(np.pi / 6))
    assert camera.cam_to_world[2, :3, 3] == pytest.approx([0.1, 0, 0.5])
    assert episode.views["wrist"].camera.assumed
    assert episode.robot.gripper_to_world is not None
    assert episode.robot.gripper_open is not None


def test_a_dataset_is_called_what_it_says_whatever_its_folder(tmp_path: Path) -> None:
    """Copies of Bridge in another folder lost their gripper, and `verify` called them bad."""
    folder = tmp_path / "augmented" / "1.0.0"
    folder.mkdir(parents=True)
    assert shards.called(folder) == "augmented"
    described = {"name": "bridge_dataset", "splits": []}
    (folder / shards.INFO).write_text(json.dumps(described))
    assert shards.called(folder) == "bridge_dataset"


@pytest.mark.parametrize(("name", "metres"), [("depth", 0.001), ("far", 1.0), ("near", 1.0)])
def test_depth_comes_back_as_it_was_written(tmp_path: Path, name: str, metres: float) -> None:
    root = calibrated(dataset(tmp_path / "in"), f"observation/{name}", metres)
    episode = RLDS().read(root, KEY)
    view = episode.views["image"]
    assert view.depth is not None
    assert 0.19 < view.depth(0).min() < view.depth(0).max() < 2.01
    half = replace(view, depth=lambda t: view.depth(t) / 2)  # type: ignore[misc]
    edited: Episode = replace(episode, views={**episode.views, "image": half})
    RLDS().write(edited, tmp_path / "out", KEY, dict)
    again = RLDS().read(tmp_path / "out", KEY).views["image"]
    assert again.depth is not None
    for t in range(STEPS):
        assert np.abs(again.depth(t) - view.depth(t) / 2).max() <= 0.501 * metres * (
            name == "depth"
        )


def test_a_moved_camera_is_written_beside_its_episode(tmp_path: Path) -> None:
    episode = RLDS().read(calibrated(dataset(tmp_path / "in"), "observation/far"), KEY)
    view = episode.views["image"]
    track = view.camera.cam_to_world.copy()
    track[:, 0, 3] += 0.25
    moved = replace(view, camera=replace(view.camera, cam_to_world=track))
    RLDS().write(
        replace(episode, views={**episode.views, "image": moved}), tmp_path / "out", KEY, dict
    )
    again = RLDS().read(tmp_path / "out", KEY).views["image"].camera
    assert np.array_equal(again.cam_to_world, track)
    assert np.array_equal(again.K, view.camera.K)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("cameras: {nobody: {field_of_view: 60}}", "one of: image, wrist"),
        ("cameras: {image: {field_of_view: 0}}", "cameras.image.field_of_view"),
        ("cameras: {image: {}}", "one of K and field_of_view"),
        ("cameras: {image: {field_of_view: 60, depth: nowhere}}", "found nowhere"),
        ("gripper: {key: observation/state, rotation: [3, 4, 9]}", "columns"),
        ("speed: 3", "speed"),
        ("!!python/object/apply:os.system [ls]", "line 1: found the type"),
    ],
)
def test_a_wrong_side_file_is_refused_in_words(tmp_path: Path, text: str, wanted: str) -> None:
    root = dataset(tmp_path)
    (root / "toy/1.0.0/cameras.yaml").write_text(text)
    with pytest.raises(BadInput) as caught:
        RLDS().read(root, KEY)
    assert "cameras.yaml" in str(caught.value)
    assert wanted in str(caught.value)


def test_damage_is_named_by_file_and_record(tmp_path: Path) -> None:
    root = dataset(tmp_path)
    path = root / "toy/1.0.0/toy-train.tfrecord-00000-of-00002"
    whole = path.read_bytes()
    (start, length), second = tfrecord.places(path)
    for at, words in ((3, "record 0, length"), (second[0] + 5, "record 1, data")):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        with pytest.raises(BadInput) as caught:
            RLDS().read(root, "toy/1.0.0/train/1")
        assert words in str(caught.value)
        assert path.name in str(caught.value)
    path.write_bytes(whole[: start + length])
    with pytest.raises(BadInput, match="what the file still holds"):
        RLDS().read(root, KEY)


def test_a_count_that_differs_from_the_description_is_refused(tmp_path: Path) -> None:
    root = dataset(tmp_path)
    path = root / "toy/1.0.0/toy-train.tfrecord-00000-of-00002"
    start, length = tfrecord.places(path)[0]
    path.write_bytes(path.read_bytes()[: start + length + 4])
    with pytest.raises(BadInput, match=r"expected 2, as dataset_info\.json says"):
        RLDS().read(root, KEY)


def test_an_image_cut_off_inside_a_valid_record_is_refused(tmp_path: Path) -> None:
    root = dataset(tmp_path, train=(1,), val=())
    path = root / "toy/1.0.0/toy-train.tfrecord-00000-of-00001"
    whole = Example("", tfrecord.read(path, 0))
    images = whole.blobs("steps/observation/wrist")
    path.write_bytes(
        tfrecord.frame(whole.replaced({"steps/observation/wrist": [images[0][:-9], *images[1:]]}))
    )
    with pytest.raises(BadInput, match="steps/observation/wrist, step 0"):
        RLDS().read(root, KEY)


def test_transparency_survives_an_edit(tmp_path: Path) -> None:
    root = dataset(tmp_path / "in", train=(1,), val=())
    path = root / "toy/1.0.0/toy-train.tfrecord-00000-of-00001"
    whole = Example("", tfrecord.read(path, 0))
    glass = np.random.default_rng(0).integers(0, 255, (SIDE, SIDE, 4), np.uint8)
    data = cv2.imencode(".png", glass)[1].tobytes()
    path.write_bytes(tfrecord.frame(whole.replaced({"steps/observation/wrist": [data] * STEPS})))
    episode = RLDS().read(root, KEY)
    views = {**episode.views, "wrist": brighter(episode.views["wrist"], 1)}
    RLDS().write(replace(episode, views=views), tmp_path / "out", KEY, dict)
    again = RLDS().read(tmp_path / "out", KEY).source.example.blobs("steps/observation/wrist")
    shown = cv2.imdecode(np.frombuffer(again[1], np.uint8), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(shown[..., 3], glass[..., 3])
    assert np.array_equal(shown[..., :3], glass[..., :3] // 2)


def test_real_episodes_come_back_byte_for_byte(samples: Path, tmp_path: Path) -> None:
    root = samples / "rlds_bridge"
    keys = RLDS().episodes(root)
    assert len(keys) == 15
    for key in keys:
        RLDS().write(RLDS().read(root, key), tmp_path / "out", key, dict)
    RLDS().finish(root, tmp_path / "out")
    for path in root.rglob("1.0.0/*"):
        if path.is_file():
            assert (tmp_path / "out" / path.relative_to(root)).read_bytes() == path.read_bytes()


def test_images_may_be_named_by_the_side_file(tmp_path: Path) -> None:
    root = dataset(tmp_path)
    before = RLDS().read(root, RLDS().episodes(root)[0])
    name, leaf = next(iter(before.source.images.items()))
    given = {"images": {"hand": leaf.key.removeprefix("steps/")}, "views": ["hand"]}
    (root / "toy/1.0.0/cameras.yaml").write_text(yaml.safe_dump(given))
    after = RLDS().read(root, RLDS().episodes(root)[0])
    assert list(after.views) == ["hand"]
    assert np.array_equal(after.views["hand"].rgb(0), before.views[name].rgb(0))
    (root / "toy/1.0.0/cameras.yaml").write_text("images: {hand: nowhere}")
    with pytest.raises(BadInput, match=r"images\.hand: found nowhere"):
        RLDS().read(root, RLDS().episodes(root)[0])


def test_statistics_that_trainers_keep_beside_shards_are_theirs_to_count(tmp_path: Path) -> None:
    """Octo and OpenVLA count anew where their file is missing; the source's would tell of other episodes."""
    root = dataset(tmp_path / "in")
    (root / "toy/1.0.0/dataset_statistics_0123abcd.json").write_text('{"num_trajectories": 4}')
    copied(root, tmp_path / "out", [KEY])
    assert {*files(tmp_path / "out")} == {
        *("features.json", "dataset_info.json", "toy-train.tfrecord-00000-of-00001")
    }
