"""Videos of a LeRobot dataset are cut and joined without loss, and decoded before anything is dropped."""

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")

import av
import crashing
import lerobot_samples
from lerobot_samples import episode, halved, picture
from pyarrow import parquet as pq
from rpaug_adapters.lerobot import LeRobot, tables
from rpaug_adapters.shared import video

from rpaug import BadInput


def large(seed: int, t: int) -> np.ndarray:
    return np.tile(picture(seed, t), (2, 2, 1))


@pytest.mark.parametrize("codec", ["h264", "av1", "vp9"])
def test_cuts_and_joins_lose_nothing(
    codec: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    like = tmp_path / "like.mp4"
    with av.open(str(like), "w") as made:
        stream = made.add_stream(video.ENCODERS[codec], rate=10)
        stream.width, stream.height, stream.pix_fmt = 96, 64, "yuv420p"
        video.open_encoders(made)
        frame = av.VideoFrame.from_ndarray(large(0, 0), format="rgb24")
        made.mux([*stream.encode(frame), *stream.encode()])
    files = [tmp_path / f"{i}.mp4" for i in range(3)]
    for i, path in enumerate(files):
        video.encode((large(i, t) for t in range(3 + i)), path, 10, like)
    whole = tmp_path / "whole.mp4"
    parts = video.joined(files, whole)
    for i, (start, end) in enumerate(parts):
        assert abs(end - start - (3 + i) / 10) < 1e-4
        span = video.Span(whole, start, 3 + i, 10)
        assert video.check(span) == (96, 64)
        assert video.cut(span, tmp_path / "part.mp4")
        alone = video.Frames(video.Span(files[i], 0, 3 + i, 10))
        part = video.Frames(video.Span(tmp_path / "part.mp4", 0, 3 + i, 10))
        shared = video.Frames(span)
        for t in range(3 + i):
            assert np.array_equal(shared(t), alone(t))
            assert np.array_equal(part(t), alone(t))
    assert capfd.readouterr() == ("", "")  # encoders are quiet


RECORDERS = {  # how somebody else's recorder encodes
    "h264": ("libx264", {"preset": "ultrafast"}),
    "h264, frames stored early": ("libx264", {"bf": "2"}),
    "hevc": ("libx265", {"x265-params": "log-level=none:sao=0"}),
    "av1": ("libsvtav1", {"preset": "12"}),
}


def no_link(*_: object) -> None:
    """A file system without hard links."""
    raise OSError


def recorded(root: Path, recorder: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two episodes by such a recorder, of 4 and 5 frames, a key frame every other one."""
    codec, options = RECORDERS[recorder]
    for side in ("HEIGHT", "WIDTH"):
        monkeypatch.setattr(lerobot_samples, side, video.HEVC_LEAST)
    adapter = LeRobot()
    for number in range(2):
        key = f"toy/train/{number}"
        adapter.write(episode(number, 4 + number), root, key, dict)
        for path in (root / key).glob("*.mp4"):
            with av.open(str(path), "w", format="mp4") as made:
                stream = made.add_stream(codec, rate=10, options={"g": "2", **options})
                stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
                video.open_encoders(made)
                for t in range(4 + number):
                    frame = av.VideoFrame.from_ndarray(picture(number, t), format="rgb24")
                    made.mux(stream.encode(frame))
                made.mux(stream.encode())
    adapter.finish(root, root)
    return root


@pytest.fixture(params=RECORDERS)
def mixed(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[Path, Path]:
    """A dataset by such a recorder, and the staged episodes of an output, every other one edited."""
    adapter, out = LeRobot(), tmp_path / "out"
    root = recorded(tmp_path / "in", request.param, monkeypatch)
    monkeypatch.setattr(
        os, "link", no_link
    )  # the originals are joined with the copies, not kept as they are
    for number in range(4):
        read = adapter.read(root, f"toy/train/{number // 2}")
        if number % 2:
            views = {name: halved(view) for name, view in read.views.items()}
            read = replace(read, views=views)
        adapter.write(read, out, f"toy/train/{number}", dict)
    return root, out


def test_originals_and_copies_stay_decodable(mixed: tuple[Path, Path]) -> None:
    root, out = mixed
    adapter = LeRobot()
    adapter.finish(root, out)
    assert len(list((out / "toy/videos/observation.images.front").rglob("*.mp4"))) == 2
    for number in range(4):
        recorded = adapter.read(root, f"toy/train/{number // 2}")
        made = adapter.read(out, f"toy/train/{number}")
        assert made.length == recorded.length
        for name in ("front", "wrist"):
            for t in range(made.length):
                before, after = (one.views[name].rgb(t) for one in (recorded, made))
                if number % 2:
                    assert np.abs(after.astype(int) - before // 2).mean() < 3
                else:
                    assert np.array_equal(after, before)


@pytest.mark.parametrize("mixed", [name for name in RECORDERS if name != "av1"], indirect=True)
def test_nothing_is_dropped_before_all_is_decoded(
    mixed: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Were unlike streams joined all the same, the run would say so, with every episode still there.

    Not so in AV1, where each key frame has its parameters with it.
    """
    root, out = mixed
    monkeypatch.setattr(video, "stream_format", lambda path: ())
    before = held(out)
    with pytest.raises(BadInput, match=r"video|frame"):
        LeRobot().finish(root, out)
    assert held(out) == before
    monkeypatch.undo()
    LeRobot().finish(root, out)
    assert len(LeRobot().episodes(out)) == 4


def held(root: Path) -> dict[str, tuple[Any, list[bytes]]]:
    """The rows and the images of each episode."""
    found = {}
    for key in LeRobot().episodes(root):
        read = LeRobot().read(root, key)
        shown = [view.rgb(t).tobytes() for view in read.views.values() for t in range(read.length)]
        found[key] = read.source.rows.to_pydict(), shown
    return found


@pytest.mark.parametrize("recorder", RECORDERS)
def test_what_an_edit_of_some_frames_leaves_keeps_its_packets(
    recorder: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    adapter, out = LeRobot(), tmp_path / "out"
    root = recorded(tmp_path / "in", recorder, monkeypatch)
    read = adapter.read(root, "toy/train/1")
    front = read.views["front"]
    edited = replace(front, rgb=lambda t: front.rgb(t) // 2 if t == 3 else front.rgb(t))
    said: list[str] = []

    def side(*words: str) -> dict[str, bytes]:
        said.extend(words)
        return {}

    adapter.write(replace(read, views={**read.views, "front": edited}), out, "toy/train/0", side)
    adapter.finish(root, out)
    assert said == []
    made = adapter.read(out, "toy/train/0")
    before = packets(read.source.spans["observation.images.front"].path)[4:]
    after = packets(made.source.spans["observation.images.front"].path)
    assert len(after) == 5
    assert after[:2] == before[:2]
    for t in range(5):
        shown = made.views["front"].rgb(t)
        if before[t] == after[t]:
            assert np.array_equal(shown, front.rgb(t))
        assert np.abs(shown.astype(int) - edited.rgb(t)).mean() < 3
    assert after[3] != before[3]


def packets(path: Path) -> list[bytes]:
    """Of each frame, in the order shown."""
    with av.open(str(path)) as file:
        held = sorted((one.pts, bytes(one)) for one in file.demux(video=0) if one.size)
    return [data for _, data in held]


@pytest.mark.parametrize("grown", [False, True])
def test_killed_anywhere_while_gathering_it_comes_to_the_same(grown: bool, tmp_path: Path) -> None:
    adapter, root, out = LeRobot(), tmp_path / "in", tmp_path / "out"
    for number in range(2):
        adapter.write(episode(number, 4 + number), root, f"toy/train/{number}", dict)
    adapter.finish(root, root)
    for number in range(4):
        read = adapter.read(root, f"toy/train/{number // 2}")
        if number % 2:
            read = replace(read, views={name: halved(one) for name, one in read.views.items()})
        adapter.write(read, out, f"toy/train/{number}", lambda *_: {"note": b""})
        if grown and number == 1:
            adapter.finish(root, out)
    every = 1 if "RPAUG_EVERY_POINT" in os.environ else 13
    found = crashing.points("lerobot", root, out, tmp_path / "work", every)
    assert len(found) > 5
    assert [one for one in found if one["again"] or one["differ"]] == []


def test_gathered_videos_lie_there_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    adapter, root = LeRobot(), tmp_path / "in"
    for number in range(4):
        adapter.write(episode(number, 4), root, f"toy/train/{number}", dict)
    staged = sum(path.stat().st_size for path in root.rglob("*.mp4"))
    held = []
    whole = video.decode_whole

    def decode_whole(spans: list[video.Span]) -> None:
        whole(spans)
        each = {one.st_ino: one.st_size for one in (path.stat() for path in root.rglob("*.mp4"))}
        held.append(sum(each.values()))

    monkeypatch.setattr(video, "decode_whole", decode_whole)
    adapter.finish(root, root)
    assert len(held) == 2  # a camera each
    assert max(held) < 1.6 * staged  # one camera's file beside its parts, never both cameras'


def in_tables(root: Path, monkeypatch: pytest.MonkeyPatch, count: int, each: int) -> Path:
    """A dataset being made whose images lie in the tables, so many episodes, some in a shared file."""
    lerobot_samples.dataset(root / "like", train=(3,), val=())
    read = LeRobot().read(root / "like", "toy/train/0")
    for number in range(count):
        LeRobot().write(read, root / "out", f"toy/train/{number}", dict)
    size = (root / "out/toy/train/0" / tables.STAGED).stat().st_size
    info = root / "out/toy" / tables.INFO
    given = json.loads(info.read_text()) | {"data_files_size_in_mb": (each + 0.5) * size / 2**20}
    info.write_text(json.dumps(given))
    return root / "out"


def test_tables_lie_there_once_but_for_one_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = in_tables(tmp_path, monkeypatch, count=12, each=2)
    size = (out / "toy/train/0" / tables.STAGED).stat().st_size
    most, replace_ = [0], os.replace

    def replaced(one: Path, other: Path) -> None:
        replace_(one, other)
        most.append(sum(path.stat().st_size for path in (out / "toy").rglob("*.parquet")))

    monkeypatch.setattr(os, "replace", replaced)
    LeRobot().finish(tmp_path / "like", out)
    assert len(list((out / "toy/data").rglob("*.parquet"))) == 6
    assert max(most) < 1.4 * 12 * size  # a file of two, and what stays in twelve own tables
    LeRobot().write(LeRobot().read(out, "toy/train/3"), out, "toy/train/12", dict)
    most.clear()
    LeRobot().finish(tmp_path / "like", out)
    assert max(most) < 1.4 * 13 * size


@pytest.mark.parametrize("grown", [False, True])
def test_killed_anywhere_while_tables_are_gathered(
    grown: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = in_tables(tmp_path, monkeypatch, count=5, each=2)
    if grown:
        LeRobot().finish(tmp_path / "like", out)
        LeRobot().write(LeRobot().read(out, "toy/train/3"), out, "toy/train/5", dict)
    every = 1 if "RPAUG_EVERY_POINT" in os.environ else 11
    found = crashing.points("lerobot", tmp_path / "like", out, tmp_path / "work", every)
    assert len(found) > 5
    assert [one for one in found if one["again"] or one["differ"]] == []


def test_killed_while_own_tables_are_dropped_it_can_grow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some episodes lie in the shared files alone then, and others lack what their own tables left out."""
    out = in_tables(tmp_path, monkeypatch, count=5, each=5)
    wanted, unlink, left = held(out), Path.unlink, [2]

    def dying(path: Path, missing_ok: bool = False) -> None:
        if path.name == tables.STAGED:
            left[0] -= 1
        if left[0] < 0:
            raise KeyboardInterrupt
        unlink(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", dying)
    with pytest.raises(KeyboardInterrupt):
        LeRobot().finish(tmp_path / "like", out)
    monkeypatch.undo()
    assert len(list(out.rglob(tables.STAGED))) == 3
    LeRobot().write(LeRobot().read(out, "toy/train/4"), out, "toy/train/5", dict)
    LeRobot().finish(tmp_path / "like", out)
    grown = held(out)
    assert {key: grown[key][1] for key in wanted} == {key: one[1] for key, one in wanted.items()}
    assert grown["toy/train/5"][1] == wanted["toy/train/4"][1]


def test_statistics_stand_in_the_order_of_the_features(tmp_path: Path) -> None:
    """Whatever Python's hashes are, and whichever episodes were edited: two runs had other bytes."""
    adapter, root, out = LeRobot(), tmp_path / "in", tmp_path / "out"
    adapter.write(episode(0, 4), root, "toy/train/0", dict)
    adapter.finish(root, root)
    read = adapter.read(root, "toy/train/0")
    halved_front = {"front": halved(read.views["front"]), "wrist": read.views["wrist"]}
    adapter.write(replace(read, views=halved_front), out, "toy/train/0", lambda *_: {})
    adapter.write(read, out, "toy/train/1", lambda *_: {})
    adapter.finish(root, out)
    about = tables.info(out / "toy")
    given = json.loads((out / "toy" / tables.STATS).read_bytes())
    assert list(given) == [key for key in about.features if key in given]
    named = pq.read_schema(next((out / "toy/meta/episodes").rglob("*.parquet"))).names
    stated = dict.fromkeys(name.split("/")[1] for name in named if name.startswith("stats/"))
    assert list(stated) == list(given)
