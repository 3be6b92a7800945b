"""LeRobot v2.1: files of its own for each episode, and one object a line in `meta`, as lerobot 0.3.3 writes them."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")

import pyarrow as pa
import pyarrow.parquet as pq
from lerobot_samples import HEIGHT, WIDTH, WORDS, halved, picture
from rpaug_adapters.lerobot import LeRobot, tables
from rpaug_adapters.shared import video

from rpaug import BadInput
from rpaug.pipeline.contracts import AdapterContract
from rpaug.pipeline.convert import convert
from rpaug.pipeline.verify import verify

LENGTHS = (4, 3)
FRONT, WRIST = "observation.images.front", "observation.images.wrist"
DATA = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
VIDEO = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"
COUNTED = ("frame_index", "episode_index", "index", "task_index")
ANNOTATION = "annotation.human.action.task_description"
PARTS = [{"start": 0, "end": 2, "text": "reach for it"}]


def put(path: Path, given: Any) -> None:
    """JSON: an object, or several, one a line."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = given if isinstance(given, list) else [given]
    path.write_text("".join(json.dumps(one) + "\n" for one in lines))


def features() -> dict[str, Any]:
    sides, shape = ["height", "width", "channels"], [HEIGHT, WIDTH, 3]
    given: dict[str, Any] = {
        FRONT: {"dtype": "video", "shape": shape, "names": sides, "info": {"video.fps": 10.0}},
        WRIST: {"dtype": "image", "shape": shape, "names": sides},
        "action": {"dtype": "float32", "shape": [2], "names": ["x", "y"]},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
        ANNOTATION: {"dtype": "int64", "shape": [1], "names": None},
    }
    return given | {name: {"dtype": "int64", "shape": [1], "names": None} for name in COUNTED}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two episodes in two chunks; the words of the second change on the way. With GR00T's file, and its statistics."""
    root = tmp_path_factory.mktemp("v21")
    folder, at = root / "toy", 0
    for number, length in enumerate(LENGTHS):
        tasks = [min(t // 2, number) for t in range(length)]
        small = [cv2.imencode(".png", picture(t, number)[..., ::-1])[1] for t in range(length)]
        columns = {
            WRIST: [{"bytes": one.tobytes(), "path": f"{t}.png"} for t, one in enumerate(small)],
            "action": pa.array([[t / 7, number] for t in range(length)], pa.list_(pa.float32())),
            "timestamp": pa.array(np.arange(length, dtype=np.float32) / np.float32(10)),
            "frame_index": list(range(length)),
            "episode_index": [number] * length,
            "index": list(range(at, at + length)),
            "task_index": tasks,
            ANNOTATION: [1 - i for i in tasks],
        }
        path = folder / DATA.format(episode_chunk=number, episode_index=number)
        path.parent.mkdir(parents=True)
        pq.write_table(pa.table(columns), path)
        place = {"episode_chunk": number, "episode_index": number, "video_key": FRONT}
        film = folder / VIDEO.format(**place)
        film.parent.mkdir(parents=True)
        shown = (picture(5 + number, t) for t in range(length))
        video.encode(shown, film, 10, None)
        at += length
    info = {
        "codebase_version": "v2.1", "robot_type": "toy", "total_episodes": 2, "total_frames": 7,
        "total_tasks": 2, "total_videos": 2, "total_chunks": 2, "chunks_size": 1, "fps": 10,
        "splits": {"train": "0:2"}, "data_path": DATA, "video_path": VIDEO, "features": features(),
    }  # fmt: skip
    put(folder / "meta/info.json", info)
    listed = [WORDS[:1], WORDS]
    rows = [
        {"episode_index": i, "tasks": listed[i], "length": n, "sub_tasks": PARTS, "trial": i + 7}
        for i, n in enumerate(LENGTHS)
    ]
    put(folder / "meta/episodes.jsonl", rows)
    put(folder / "meta/tasks.jsonl", [{"task_index": i, "task": s} for i, s in enumerate(WORDS)])
    annotation = {"human.action.task_description": {}}
    put(
        folder / "meta/modality.json",
        {"action": {"arm": {"start": 0, "end": 2}}, "annotation": annotation},
    )
    put(folder / "meta/stats.json", {"action": {"mean": [0, 0]}})
    return root


class TestContract(AdapterContract):
    @pytest.fixture(autouse=True)
    def _recorded(self, recorded: Path) -> None:
        self.recorded = recorded

    def adapter(self) -> LeRobot:
        return LeRobot()

    def dataset(self, folder: Path) -> Path:
        return Path(shutil.copytree(self.recorded, folder))


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_it_is_read(recorded: Path) -> None:
    adapter = LeRobot()
    assert adapter.episodes(recorded) == ["toy/train/0", "toy/train/1"]
    read = adapter.read(recorded, "toy/train/1")
    assert (read.length, read.descriptions) == (3, (*WORDS, "reach for it"))
    assert np.array_equal(read.views["wrist"].rgb(2), picture(2, 1))
    assert np.abs(read.views["front"].rgb(2).astype(int) - picture(6, 2)).mean() < 3
    assert np.allclose(read.robot.extra["action"][:, 0], np.arange(3) / 7)


def test_it_is_written_as_it_came(recorded: Path, tmp_path: Path) -> None:
    adapter = LeRobot()
    for number in range(2):
        read = adapter.read(recorded, f"toy/train/{number}")
        adapter.write(read, tmp_path, f"toy/train/{number}", dict)
    adapter.finish(recorded, tmp_path)
    read = adapter.read(tmp_path, "toy/train/1")  # grown from here, as a resumed run does
    edited = replace(read, views={**read.views, "front": halved(read.views["front"])})
    adapter.write(edited, tmp_path, "toy/train/2", dict)
    adapter.finish(recorded, tmp_path)
    old, new = recorded / "toy", tmp_path / "toy"
    for number in range(2):
        place = {"episode_chunk": number, "episode_index": number, "video_key": FRONT}
        before, after = (pq.read_table(one / DATA.format(**place)) for one in (old, new))
        assert after.select(before.column_names).equals(before)
        shown = [
            video.Frames(video.Span(one / VIDEO.format(**place), 0, LENGTHS[number], 10))
            for one in (old, new)
        ]
        for t in range(LENGTHS[number]):
            assert np.array_equal(shown[0](t), shown[1](t))
    made = adapter.read(tmp_path, "toy/train/2")
    assert (
        np.abs(made.views["front"].rgb(1).astype(int) - read.views["front"].rgb(1) // 2).mean() < 3
    )
    assert np.array_equal(made.views["wrist"].rgb(1), read.views["wrist"].rgb(1))
    was, info = (json.loads((one / "meta/info.json").read_text()) for one in (old, new))
    totals = {"total_episodes": 3, "total_frames": 10, "total_videos": 3, "total_chunks": 3}
    assert info == was | totals | {"splits": {"train": "0:3"}}
    assert lines(new / "meta/tasks.jsonl") == lines(old / "meta/tasks.jsonl")
    assert lines(new / "meta/episodes.jsonl")[:2] == lines(old / "meta/episodes.jsonl")
    counted = lines(new / "meta/episodes_stats.jsonl")
    assert [one["episode_index"] for one in counted] == [0, 1, 2]
    assert counted[2]["stats"]["index"]["max"] == [9]
    assert counted[1]["stats"]["action"].keys() == {"min", "max", "mean", "std", "count"}
    assert np.shape(counted[1]["stats"][WRIST]["mean"]) == (3, 1, 1)
    for path in (new / "data").rglob("*.parquet"):  # or v2.1's loader takes images for plain values
        stated = json.loads(pq.read_schema(path).metadata[b"huggingface"])
        assert stated["info"]["features"] == {WRIST: {"_type": "Image"}}
    modality = "meta/modality.json"
    assert (new / modality).read_bytes() == (old / modality).read_bytes()
    counted_by_groot = json.loads((new / "meta/stats.json").read_text())
    actions = [[t / 7, number] for number in (0, 1, 1) for t in range(LENGTHS[number])]
    given = counted_by_groot["action"]
    assert np.allclose(given["q99"], np.quantile(np.float32(actions), 0.99, 0))
    assert np.allclose(given["std"], np.std(actions, 0))
    assert not adapter.faults(tmp_path)


def test_all_words_follow_an_edit(recorded: Path, tmp_path: Path) -> None:
    """GR00T's annotations number tasks, and the tables of episodes have words of their own."""
    adapter = LeRobot()
    read = adapter.read(recorded, "toy/train/1")
    adapter.write(read, tmp_path, "toy/train/0", dict)
    new = ("lift it", WORDS[1], "grope for it")
    adapter.write(replace(read, descriptions=new), tmp_path, "toy/train/1", dict)
    adapter.finish(recorded, tmp_path)
    folder = tmp_path / "toy"
    tasks = {one["task_index"]: one["task"] for one in lines(folder / "meta/tasks.jsonl")}
    assert tasks == {0: WORDS[0], 1: WORDS[1], 2: new[0]}  # as they were numbered
    for number, words in enumerate((WORDS, new)):
        rows = pq.read_table(folder / DATA.format(episode_chunk=number, episode_index=number))
        assert [tasks[i] for i in rows["task_index"].to_pylist()] == [words[0], words[0], words[1]]
        said = [tasks[i] for i in rows[ANNOTATION].to_pylist()]
        assert said == [words[1], words[1], words[0]]
    before, after = lines(folder / "meta/episodes.jsonl")
    assert after["tasks"] == list(new[:2])
    assert (before["sub_tasks"], after["sub_tasks"]) == (PARTS, [{**PARTS[0], "text": new[2]}])
    assert (before["trial"], after["trial"]) == (8, 8)
    assert adapter.read(tmp_path, "toy/train/1").descriptions == new


def everything(root: Path, folder: str) -> dict[str, Any]:
    """All that a dataset holds, wherever it holds it."""
    adapter, found = LeRobot(), {}
    for key in adapter.episodes(root):
        read = adapter.read(root, key)
        frames = {
            name: [view.rgb(t).tobytes() for t in range(read.length)]
            for name, view in read.views.items()
        }
        counted = tables.statistics(root / folder, read.source.number)
        found[key] = frames, adapter.untouched(read, False), read.descriptions, counted
    info = json.loads((root / folder / "meta/info.json").read_text())
    beside = {path.name: path.read_bytes() for path in (root / folder / "meta").glob("mod*.json")}
    return {**found, "info": info, "beside": beside, "tasks": tables.tasks(root / folder)}


def test_versions_round_trip(recorded: Path, tmp_path: Path) -> None:
    """v2.1 to v3 and back, and the other way round: all but the statistics that v2.1 cannot hold, which are counted
    anew."""
    shutil.copytree(recorded, source := tmp_path / "a", dirs_exist_ok=True)
    (source / "toy/meta/stats.json").unlink()
    first = tmp_path / "filled"  # with the statistics of every feature
    adapter = LeRobot()
    for key in adapter.episodes(source):
        adapter.write(adapter.read(source, key), first, key, dict)
    adapter.finish(source, first)
    names = ("v3.0", "v2.1", "v3.0")
    roots = [first, *(tmp_path / f"{i}" for i in range(3))]
    for i, version in enumerate(names):
        done = convert(roots[i], roots[i + 1], f"lerobot@{version}")
        assert (done.exit_code, done.failures) == (0, {})
        assert bool(done.lost) == (version == "v2.1")
        assert verify(roots[i + 1], roots[i]).passed
        assert not adapter.faults(roots[i + 1])
    assert len(list((roots[1] / "toy/videos").rglob("*.mp4"))) == 1
    for one, other in ((0, 2), (1, 3)):
        before, after = (everything(roots[i], "toy") for i in (one, other))
        sizes = ("data_files_size_in_mb", "video_files_size_in_mb") if one == 0 else ()
        assert all(after["info"].pop(name) for name in sizes)
        for key in before:
            assert before[key] == after[key], key
    assert not (roots[1] / "toy/meta/episodes.jsonl").exists()
    with pytest.raises(BadInput, match=r"lerobot@v3\.0 or lerobot@v2\.1"):
        convert(first, tmp_path / "no", "lerobot@v1.6")
    with pytest.raises(BadInput, match="lerobot@v2"):
        convert(first, tmp_path / "no", "lerobot")


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("episodes.jsonl", '{"episode_index": 0, "length": 4}\n[', "line 2"),
        ("episodes.jsonl", '{"episode_index": 1, "length": 4}', "episode_index"),
        ("tasks.jsonl", "7", "line 1"),
    ],
)
def test_spoilt_lines_are_named(
    recorded: Path, tmp_path: Path, name: str, text: str, words: str
) -> None:
    root = Path(shutil.copytree(recorded, tmp_path / "in"))
    (root / "toy/meta" / name).write_text(text)
    with pytest.raises(BadInput, match=words):
        LeRobot().read(root, "toy/train/1")


def test_files_that_lie_elsewhere_come_to_the_usual_places(recorded: Path, tmp_path: Path) -> None:
    """A recorder may call them as it likes; what is gathered lies where loaders of the version look by default."""
    root, out = tmp_path / "in", tmp_path / "out"
    shutil.copytree(recorded, root)
    (root / "toy/data").rename(root / "toy/frames")
    (root / "toy/videos").rename(root / "toy/films")
    info = root / "toy/meta/info.json"
    given = json.loads(info.read_text())
    given["data_path"] = given["data_path"].replace("data/", "frames/")
    given["video_path"] = given["video_path"].replace("videos/", "films/")
    put(info, given)
    for place, odd in ((recorded, False), (root, True)):
        for number in range(2):
            read = LeRobot().read(place, f"toy/train/{number}")
            LeRobot().write(read, out / str(odd), f"toy/train/{number}", dict)
        LeRobot().finish(place, out / str(odd))
    assert everything(out / "False", "toy") == everything(out / "True", "toy")
