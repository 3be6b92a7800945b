"""LeRobot datasets: slices of shared files, copied where nothing changed; words, splits and statistics kept right."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")

import cv2
import pyarrow as pa
import pyarrow.parquet as pq
from lerobot_samples import DEPTH, HEIGHT, WIDTH, WORDS, dataset, episode, halved, picture
from rpaug_adapters.lerobot import LeRobot, fresh, stats, tables
from rpaug_adapters.lerobot.read import blobs
from rpaug_adapters.lerobot.tables import filled
from rpaug_adapters.lerobot.write import with_column
from rpaug_adapters.shared import video
from rpaug_adapters.shared.folders import unlike

from rpaug import BadInput, MissingExtra, Unsupported
from rpaug.core import registry
from rpaug.pipeline.contracts import AdapterContract

KEY = "toy/train/1"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return dataset(tmp_path_factory.mktemp("lerobot") / "in")


class TestContract(AdapterContract):
    @pytest.fixture(autouse=True)
    def _recorded(self, recorded: Path) -> None:
        self.recorded = recorded

    def adapter(self) -> LeRobot:
        return LeRobot()

    def dataset(self, folder: Path) -> Path:
        return Path(shutil.copytree(self.recorded, folder))


def test_splits_are_slices_of_one_list(recorded: Path) -> None:
    adapter = LeRobot()
    assert adapter.episodes(recorded) == ["toy/train/0", "toy/train/1", "toy/val/0"]
    assert not (recorded / "toy/train/0/episode.parquet").exists()
    assert [adapter.read(recorded, key).length for key in adapter.episodes(recorded)] == [5, 3, 4]
    info = json.loads((recorded / "toy/meta/info.json").read_text())
    assert info["splits"] == {"train": "0:2", "val": "2:3"}
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (3, 12, 2)
    assert len(list((recorded / "toy/data").rglob("*.parquet"))) == 3  # as small as was told


def test_everything_comes_back(recorded: Path) -> None:
    made, read = episode(51, 3), LeRobot().read(recorded, KEY)
    assert read.descriptions == WORDS
    assert np.array_equal(read.views["front"].depth(1), made.views["front"].depth(1))
    assert np.array_equal(read.views["front"].ids(2), made.views["front"].ids(2))
    assert np.array_equal(read.views["image"].rgb(2), picture(2, 0))
    for name in ("front", "wrist"):
        assert np.abs(read.views[name].rgb(2).astype(int) - made.views[name].rgb(2)).mean() < 3
        assert np.array_equal(
            read.views[name].camera.cam_to_world, made.views[name].camera.cam_to_world
        )
    assert np.allclose(read.robot.joint_positions, made.robot.joint_positions, atol=1e-6)
    assert np.allclose(read.robot.gripper_to_world, made.robot.gripper_to_world, atol=1e-6)


def test_frames_come_in_any_order(recorded: Path) -> None:
    view = LeRobot().read(recorded, "toy/train/0").views["wrist"]
    ordered = [view.rgb(t) for t in range(5)]
    again = LeRobot().read(recorded, "toy/train/0").views["wrist"]
    for t in (4, 0, 3, 3, 1, 2):
        assert np.array_equal(again.rgb(t), ordered[t])


def test_an_edit_changes_its_camera_alone(recorded: Path, tmp_path: Path) -> None:
    adapter = LeRobot()
    for number, key in enumerate(["toy/train/0", KEY, KEY]):
        read = adapter.read(recorded, key)
        if number == 2:
            views = {**read.views, "front": halved(read.views["front"])}
            read = replace(read, views=views, descriptions=("take it", "put it down"))
        adapter.write(read, tmp_path, f"toy/train/{number}", lambda: {"note.txt": b"hello"})
    adapter.finish(recorded, tmp_path)
    before, after = adapter.read(recorded, KEY), adapter.read(tmp_path, "toy/train/2")
    assert after.descriptions == ("take it", "put it down")
    for t in range(3):
        dark = after.views["front"].rgb(t).astype(int)
        assert np.abs(dark - before.views["front"].rgb(t) // 2).mean() < 3
        for name in ("wrist", "image"):
            assert np.array_equal(after.views[name].rgb(t), before.views[name].rgb(t))
    stated = json.loads((tmp_path / "toy/meta/stats.json").read_text())
    values = [adapter.read(tmp_path, f"toy/train/{i}").robot.extra["action"] for i in range(3)]
    assert np.allclose(stated["action"]["mean"], np.concatenate(values).mean(0))
    assert np.allclose(stated["action"]["std"], np.concatenate(values).std(0))
    files = sorted((tmp_path / "toy/data").rglob("*.parquet"))
    held = [row for path in files for row in pq.read_table(path).to_pylist()]
    assert [row["index"] for row in held] == list(range(11))
    assert [row["note"] for row in held[8:]] == ["0!", "1!", "2!"]
    assert (tmp_path / "toy/train/2/note.txt").read_bytes() == b"hello"


def test_depth_that_no_edit_reached_keeps_its_numbers(tmp_path: Path) -> None:
    """Metres of float32 millimetres do not all come back by a division: the recorded numbers do."""
    adapter, root, out, key = LeRobot(), tmp_path / "in", tmp_path / "out", "toy/train/0"
    adapter.write(episode(0, 2), root, key, dict)
    path, described = root / key / tables.STAGED, root / "toy" / tables.INFO
    numbers = np.random.default_rng(0).uniform(500, 2000, (2, HEIGHT, WIDTH)).astype(np.float32)
    column = fresh.images([fresh.tiff(one) for one in numbers])
    pq.write_table(with_column(pq.read_table(path), DEPTH, column), path)
    about = json.loads(described.read_text())
    about["features"][DEPTH]["info"] = {"is_depth_map": True, "depth_unit": "mm"}
    described.write_text(json.dumps(about))
    adapter.finish(root, root)
    read = adapter.read(root, key)
    front = read.views["front"]
    nearer = [np.pad(front.depth(t)[4:], ((4, 0), (0, 0)), constant_values=0.3) for t in range(2)]
    view = replace(front, depth=lambda t: nearer[t])
    adapter.write(replace(read, views={**read.views, "front": view}), out, key, dict)
    adapter.finish(root, out)
    written = blobs("", adapter.read(out, key).source.rows, DEPTH)
    for data, recorded in zip(written, numbers, strict=True):
        stored = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        assert np.array_equal(stored[4:], recorded[4:])
        assert np.allclose(stored[:4], 300)


def copied(root: Path, out: Path) -> None:
    """Every episode written as it was read, and gathered."""
    adapter = LeRobot()
    for key in adapter.episodes(root):
        adapter.write(adapter.read(root, key), out, key, dict)
    adapter.finish(root, out)


def test_what_no_edit_changed_costs_a_link(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is decoded, counted or copied: recorded files stay whole, and so do their statistics."""
    copied(recorded, root := tmp_path / "in")  # with statistics of every feature
    for module, name in ((video, "decode_whole"), (stats, "of_images"), (video, "cut")):
        monkeypatch.setattr(module, name, lambda *_: pytest.fail("decoded or copied"))
    copied(root, tmp_path / "out")
    old, new = root / "toy", tmp_path / "out/toy"
    films = sorted(path.relative_to(old) for path in old.rglob("*.mp4"))
    assert films == sorted(path.relative_to(new) for path in new.rglob("*.mp4"))
    assert all((old / film).samefile(new / film) for film in films)
    before, after = (pq.read_table(one / "meta/episodes") for one in (old, new))
    for name in before.column_names:
        assert before[name].to_pylist() == after[name].to_pylist(), name
    given, made = (json.loads((one / "meta/stats.json").read_text()) for one in (old, new))
    assert given == made


def test_a_part_of_a_recorded_file_is_taken_out_of_it(recorded: Path, tmp_path: Path) -> None:
    adapter, out = LeRobot(), tmp_path / "out"
    read = adapter.read(recorded, "toy/train/1")
    adapter.write(read, out, "toy/train/0", dict)
    for step in ("staged", "gathered"):
        made = adapter.read(out, "toy/train/0")
        for name, view in read.views.items():
            shown = made.views[name].rgb
            assert all(np.array_equal(view.rgb(t), shown(t)) for t in range(read.length)), step
        adapter.finish(recorded, out)
    for path in (out / "toy/videos").rglob("*.mp4"):
        assert video.count(path) == read.length


def test_new_images_are_decoded_before_anything_is_dropped(recorded: Path, tmp_path: Path) -> None:
    adapter, out = LeRobot(), tmp_path / "out"
    read = adapter.read(recorded, KEY)
    adapter.write(read, out, "toy/train/0", dict)
    name = "image"  # of small images in the table
    edited = replace(read, views={**read.views, name: halved(read.views[name])})
    adapter.write(edited, out, "toy/train/1", dict)
    for number in range(2):  # spoilt as a bad disk would
        path = out / f"toy/train/{number}" / tables.STAGED
        rows = pq.read_table(path)
        at = rows.schema.get_field_index("observation.image")
        cut = [{**one, "bytes": one["bytes"][:-9]} for one in rows[at].to_pylist()]
        column = pa.array(cut, rows.schema.field(at).type)
        pq.write_table(rows.set_column(at, "observation.image", column), path)
    with pytest.raises(BadInput, match=r"episode 1, observation\.image, frame 0"):
        adapter.finish(recorded, out)
    assert (out / "toy/train/1" / tables.STAGED).is_file()


def test_an_episode_in_one_large_row_group_is_read_alone(tmp_path: Path) -> None:
    """As recorders write it that leave a file to pyarrow's defaults."""
    path, count, length = tmp_path / "data.parquet", 40, 300
    numbers = np.repeat(np.arange(count), length)
    images = [bytes([n]) + os.urandom(3000) for n in numbers]
    pq.write_table(pa.table({"episode_index": numbers, "image": images}), path)
    assert pq.ParquetFile(path).metadata.num_row_groups == 1
    before = pa.total_allocated_bytes()
    for wanted in (0, 17, count - 1):
        held = tables.table(path, episode=wanted)
        assert held.num_rows == length
        assert {data[0] for data in held["image"].to_pylist()} == {wanted}
        assert pa.total_allocated_bytes() - before < 3 * held.nbytes
    assert tables.table(path, episode=count).num_rows == 0
    assert tables.table(path, ["episode_index"], count).column_names == ["episode_index"]


def test_a_finished_dataset_can_grow(recorded: Path, tmp_path: Path) -> None:
    adapter = LeRobot()
    adapter.write(adapter.read(recorded, KEY), tmp_path, "toy/train/0", dict)
    adapter.finish(recorded, tmp_path)
    first = [adapter.read(tmp_path, "toy/train/0").views["front"].rgb(t) for t in range(3)]
    adapter.write(adapter.read(recorded, "toy/val/0"), tmp_path, "toy/val/0", dict)
    assert adapter.episodes(tmp_path) == ["toy/train/0", "toy/val/0"]
    adapter.finish(recorded, tmp_path)
    assert adapter.episodes(tmp_path) == ["toy/train/0", "toy/val/0"]
    again = adapter.read(tmp_path, "toy/train/0").views["front"]
    assert all(np.array_equal(again.rgb(t), first[t]) for t in range(3))


def test_another_kind_of_episode_is_refused(recorded: Path, tmp_path: Path) -> None:
    adapter = LeRobot()
    adapter.write(adapter.read(recorded, KEY), tmp_path, "toy/train/0", dict)
    with pytest.raises(Unsupported, match="one kind"):
        adapter.write(episode(0, 3), tmp_path, "toy/train/1", dict)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"codebase_version": "v2.0"}, "convert_dataset_v20_to_v21"),
        ({"fps": 0}, "fps"),
        ({"splits": {"train": "0:2", "val": "1:3"}}, "in two"),
        ({"splits": {"train": "0:9"}}, "within"),
        ({"data_path": "../{chunk_index:99999999999d}.parquet"}, "a file of the dataset"),
        ({"total_episodes": -1}, "total_episodes"),
        ({"features": {"../x": {"dtype": "video", "shape": [1]}}}, "plain name"),
    ],
)
def test_a_wrong_description_is_named(
    recorded: Path, tmp_path: Path, change: dict, words: str
) -> None:
    root = Path(shutil.copytree(recorded, tmp_path / "in"))
    path = root / "toy/meta/info.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(BadInput, match=words):
        LeRobot().read(root, LeRobot().episodes(root)[0])


def test_masks_that_are_described_and_not_there_are_named(recorded: Path, tmp_path: Path) -> None:
    root = Path(shutil.copytree(recorded, tmp_path / "in"))
    path = root / "toy/meta/info.json"
    about = json.loads(path.read_text())
    about["features"]["masks.wrist"] = about["features"]["masks.front"]
    path.write_text(json.dumps(about))
    with pytest.raises(BadInput, match=r"masks\.wrist: found 0 such columns"):
        LeRobot().read(root, LeRobot().episodes(root)[0])


def test_a_video_that_ends_early_is_named(recorded: Path, tmp_path: Path) -> None:
    root = Path(shutil.copytree(recorded, tmp_path / "in"))
    path = next((root / "toy/videos/observation.images.front").rglob("*.mp4"))
    short = tmp_path / "short.mp4"
    assert video.cut(video.Span(path, 0, 9, 10), short) in (True, False)
    video.encode(iter([picture(0, 0)] * 6), short, 10, path)
    shutil.move(short, path)
    with pytest.raises(BadInput, match=r"frame 1: found none at 0\.6"):
        LeRobot().read(root, KEY)


def test_what_an_edit_of_images_leaves_and_counts(recorded: Path, tmp_path: Path) -> None:
    """An image feature (no video) takes an edit exactly; counted columns count on; calibration in info.json stays."""
    root = Path(shutil.copytree(recorded, tmp_path / "in"))
    path = root / "toy" / tables.INFO
    given = json.loads(path.read_text())
    calibration = {
        "intrinsics": [[50.0, 0, 24], [0, 50, 16], [0, 0, 1]],
        "extrinsics": np.eye(4).tolist(),
    }
    for key in ("observation.image", "observation.images.front"):
        given["features"][key]["info"] = (given["features"][key].get("info") or {}) | calibration
    path.write_text(json.dumps(given | {"calibration": calibration}))
    adapter = LeRobot()
    read = adapter.read(root, KEY)
    edited = replace(read, views={**read.views, "image": halved(read.views["image"])})
    for number, one in enumerate([read, edited]):
        adapter.write(one, tmp_path / "out", f"toy/train/{number}", dict)
    adapter.finish(root, tmp_path / "out")
    views = adapter.read(tmp_path / "out", KEY).views
    for t in range(3):
        assert np.array_equal(views["image"].rgb(t), read.views["image"].rgb(t) // 2)
        assert np.array_equal(views["front"].rgb(t), read.views["front"].rgb(t))
    after = json.loads((tmp_path / "out/toy" / tables.INFO).read_text())
    assert after["calibration"] == calibration
    for key in ("observation.image", "observation.images.front"):
        assert after["features"][key] == given["features"][key]
    (table,) = (tmp_path / "out/toy/meta/episodes").rglob("*.parquet")
    first, second = pq.read_table(table).to_pylist()
    for row, index in ((first, range(3)), (second, range(3, 6))):
        for name, value in stats.plain({"index": stats.of_numbers(np.array(index))})[
            "index"
        ].items():
            assert row[f"stats/index/{name}"] == pytest.approx(value), name
    name = "stats/observation.image/mean"
    assert np.allclose(np.array(second[name]), np.array(first[name]) / 2, atol=1 / 255)


def test_found_masks_are_not_written_as_recorded(recorded: Path, tmp_path: Path) -> None:
    adapter = LeRobot()
    read = adapter.read(recorded, KEY)
    assert read.views["wrist"].ids is None
    found = replace(read.views["wrist"], ids=lambda t: np.full((HEIGHT, WIDTH), 7, np.int32))
    changed = {**read.views, "wrist": halved(found)}
    adapter.write(replace(read, views=changed), tmp_path, "toy/train/0", dict)
    adapter.finish(recorded, tmp_path)
    assert adapter.read(tmp_path, "toy/train/0").views["wrist"].ids is None
    features = json.loads((tmp_path / "toy" / tables.INFO).read_text())["features"]
    assert [key for key in features if key.startswith("masks.")] == ["masks.front"]


def test_columns_that_count_have_statistics(recorded: Path) -> None:
    every = json.loads((recorded / "toy/meta/stats.json").read_text())
    assert (every["index"]["min"], every["index"]["max"]) == ([0], [11])
    assert every["episode_index"]["mean"] == [pytest.approx((3 * 1 + 4 * 2) / 12)]
    (path,) = (recorded / "toy/meta/episodes").rglob("*.parquet")
    rows = pq.read_table(path).to_pylist()
    assert [row["stats/index/max"] for row in rows] == [[4], [7], [11]]
    assert rows[0]["stats/task_index/count"] == [5]


def test_without_pyarrow_the_extra_is_named(
    recorded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingExtra, match=r"rpaug\[lerobot\]"):
        LeRobot().read(recorded, KEY)


def test_paths_are_filled_without_being_run() -> None:
    assert filled("a-{n:03d}/{name}", {"n": 7, "name": "x"}) == "a-007/x"
    assert filled("{n.__class__}{n!r}", {"n": 7}) == "{n.__class__}{n!r}"


def test_the_rate_is_the_videos_own(tmp_path: Path) -> None:
    recorded = episode(0, 4)
    assert fresh.rate(recorded) == 10
    unstated = replace(recorded, rate=None)
    with pytest.raises(Unsupported, match="--fps"):
        fresh.rate(unstated)
    times = np.array([[0.0], [1 / 29.97], [2 / 29.97], [3 / 29.97]])
    filmed = replace(unstated, robot=replace(recorded.robot, extra={"seconds": times}))
    assert fresh.rate(filmed) == 30
    still = replace(unstated, robot=replace(recorded.robot, extra={"seconds": 0 * times}))
    with pytest.raises(Unsupported, match="--fps"):
        fresh.rate(still)
    assert fresh.described(filmed)["fps"] == 30
    LeRobot().write(recorded, tmp_path, "toy/train/0", dict)
    with pytest.raises(Unsupported, match="30 frames a second, and the episodes before it have 10"):
        LeRobot().write(filmed, tmp_path, "toy/train/1", dict)


def test_a_dataset_without_its_description_is_not_taken_for_videos(
    recorded: Path, tmp_path: Path
) -> None:
    half = Path(shutil.copytree(recorded, tmp_path / "half"))
    (info,) = half.rglob("info.json")
    info.unlink()
    with pytest.raises(
        BadInput, match=r"info\.json: file: found nothing; expected a whole lerobot"
    ):
        registry.adapter_for(half)


def test_what_differs_between_episodes_is_named() -> None:
    one = {"observation.images.front": {"dtype": "video", "shape": [2, 2, 3], "info": {}}}
    two = one | {"action": {"dtype": "float32", "shape": [7]}}
    assert unlike(one, two) == "it has action, and the episodes before it have not"
    assert unlike(two, one) == "it lacks action, which the episodes before it have"
    tree = {"featuresDict": {"features": {"image": {"image": {"shape": {"dimensions": ["2"]}}}}}}
    assert unlike({"pythonClassName": "x"}, {"pythonClassName": "x"} | tree).startswith(
        "it has image,"
    )
    wide = {"observation.images.front": {"dtype": "video", "shape": [2, 4, 3], "info": {}}}
    assert "observation.images.front is of another kind or size" in unlike(one, wide)


def test_a_pickle_beside_the_description_is_refused_by_name(tmp_path: Path) -> None:
    root = dataset(tmp_path / "in")
    (root / "toy/meta/policy.pkl").write_bytes(b"cos\nsystem\n.")
    adapter = LeRobot()
    with pytest.raises(BadInput, match=r"policy\.pkl: format: found a pickle"):
        adapter.write(adapter.read(root, "toy/train/0"), tmp_path / "out", "toy/train/0", dict)
