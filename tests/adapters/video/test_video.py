"""Videos: exact frames, what is written back like what came in, Ego4D's annotations cut and named anew."""

import json
import tracemalloc
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest
from rpaug_adapters.video import Videos, ego4d, encode
from rpaug_adapters.video import stream as video_stream
from rpaug_adapters.video.stream import Video
from videos import HEIGHT, WIDTH, picture, turn, write

from rpaug import BadInput, CameraView, Episode, Unsupported
from rpaug.core import registry
from rpaug.pipeline.contracts import AdapterContract

UID, CLIP = "9c5b7322-d1cc-4b56-ae9d-85831f28fac1", "0a1b"
NARRATIONS = "all_narrations_redacted.json"
VARIED = [0, 512, 700, 2100, 2200, 2300, 5000, 5010, 6000, 6512, 7000, 9000]


def dataset(folder: Path) -> Path:
    """One full-scale video with narrations and hands, and one clip of it."""
    home = folder / "v2"
    write(home / "full_scale" / f"{UID}.mp4", 12, sound=True)
    write(home / "clips" / f"{CLIP}.mp4", 6)
    (home / "annotations").mkdir()
    video = {"video_uid": UID, "duration_sec": 0.4, "scenarios": ["Cooking"]}
    clip = {
        "clip_uid": CLIP, "video_uid": UID, "video_start_sec": 0.2, "video_end_sec": 0.4,
        "video_start_frame": 6, "video_end_frame": 12,
    }  # fmt: skip
    (home / "ego4d.json").write_text(json.dumps({"videos": [video], "clips": [clip]}))
    given = [
        {"timestamp_sec": 0.1, "timestamp_frame": 3, "narration_text": "#C C picks the pan", "annotation_uid": "a"},
        {"timestamp_sec": 0.3, "timestamp_frame": 9, "narration_text": "#C C stirs #unsure", "annotation_uid": "b"},
    ]  # fmt: skip
    narrations = {
        "version": "v2",
        "videos": {
            UID: {
                "narration_pass_1": {"narrations": given, "summaries": []},
                "status": "redacted",
            }
        },
    }
    (home / "annotations" / NARRATIONS).write_text(json.dumps(narrations))
    boxes = [{"left_hand": [1, 2, 3, 4]}]
    moments = {"pre_frame": {"frame": 7, "clip_frame": 1, "boxes": boxes}}
    moments |= {"pnr_frame": {"frame": 9, "clip_frame": 3, "boxes": boxes}}
    early = {"pre_frame": {"frame": 2, "clip_frame": 0, "boxes": boxes}}
    hands = {"clips": [{"clip_uid": CLIP, "video_uid": UID, "frames": [moments, early]}]}
    (home / "annotations" / "fho_hands_train.json").write_text(json.dumps(hands))
    return folder


class TestContract(AdapterContract):
    def adapter(self) -> Videos:
        return Videos()

    def dataset(self, folder: Path) -> Path:
        return dataset(folder)


def brighter(episode: Episode, at: int | None = None) -> Episode:
    """The episode with a block of one frame, or of all, painted."""
    view = episode.views["ego"]

    def rgb(t: int) -> np.ndarray:
        image = view.rgb(t).copy()
        if at is None or t == at:
            image[20:40, 40:60] = (20, 220, 20)
        return image

    return replace(episode, views={"ego": replace(view, rgb=rgb)})


def copied(episode: Episode, root: Path, key: str = "video_0") -> Path:
    Videos().write(episode, root, key, lambda *_: {})
    return next((root / key).glob("video.*"))


def test_so_many_frames_are_in_memory_however_long_the_clip(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Decoded frames are libav's, rgb images numpy's: the former are counted, the latter's memory traced."""
    frame = 3 * WIDTH * HEIGHT // 2
    monkeypatch.setattr(video_stream, "KEPT_BYTES", 5 * frame)
    peaks, kept = [], set()
    for length in (40, 400):
        path = write(tmp_path / f"{length}/a.mp4", length)
        episode = Videos().read(path.parent, "a")
        video = Video(path)
        tracemalloc.start()
        for t in range(length):
            video.rgb(t)
            kept.add(len(video._kept))
        copied(brighter(episode), tmp_path / f"out{length}")
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert max(kept) == 5
    assert peaks[1] - peaks[0] < 20 * 3 * WIDTH * HEIGHT  # of 360 more: their times, key frames


def test_frames_are_those_asked_for_in_any_order(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mp4", 12)
    with av.open(str(path)) as file:
        truth = [frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)]
    video = Video(path)
    assert video.length == 12
    for t in (7, 0, 11, 3, 4, 5, 2, 10):
        assert np.abs(video.rgb(t).astype(int) - truth[t]).max() <= 3
        assert np.abs(video.rgb(t).astype(int) - picture(t)).mean() < 6


def test_few_frames_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video_stream, "KEPT_BYTES", 1)
    video = Video(write(tmp_path / "a.mp4", 24))
    for t in (*range(24), 3):
        video.rgb(t)
        assert len(video._kept) <= 4


def test_varying_rates_come_back_as_they_were(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mp4", 12, times=VARIED)
    episode = Videos().read(tmp_path, "a")
    made = copied(brighter(episode), tmp_path / "out")
    before, after = Video(path).facts, Video(made).facts
    assert np.array_equal(before.times, after.times)
    assert before.time_base == after.time_base
    assert np.allclose(before.seconds, np.array(VARIED) / 15360)


@pytest.mark.parametrize(
    ("matrix", "corner"),
    [((1, 0, 0, 1), (-1, 0)), ((0, 1, -1, 0), (0, 0)), ((-1, 0, 0, -1), (0, -1)), ((0, -1, 1, 0), (-1, -1))],
)  # fmt: skip
def test_rotated_videos_stand_upright_and_stay_rotated(
    tmp_path: Path, matrix: tuple[int, int, int, int], corner: tuple[int, int]
) -> None:
    path = write(tmp_path / "a.mp4", 4)
    turn(path, matrix)
    with av.open(str(path)) as file:
        frame = next(file.decode(video=0))
        degrees = frame.rotation
    episode = Videos().read(tmp_path, "a")
    view = episode.views["ego"]
    assert (view.camera.width, view.camera.height) == (
        (WIDTH, HEIGHT) if degrees % 180 == 0 else (HEIGHT, WIDTH)
    )
    upright = np.rot90(frame.to_ndarray(format="rgb24"), degrees // 90)
    assert np.abs(view.rgb(0).astype(int) - upright).max() <= 3
    row, column = (-3 if side else 3 for side in corner)
    assert view.rgb(0)[row, column, 0] > 150 > 90 > view.rgb(0)[row, column, 1]
    made = copied(brighter(episode), tmp_path / "out")
    with av.open(str(made)) as file:
        again = next(file.decode(video=0))
        assert again.rotation == degrees
        assert (again.width, again.height) == (WIDTH, HEIGHT)
    shown = Videos().read(tmp_path / "out", "video_0").views["ego"].rgb(1).astype(int)
    assert np.abs(shown - brighter(episode).views["ego"].rgb(1)).mean() < 3


def sound(path: Path) -> list[tuple[int | None, bytes]]:
    """Times and bytes of all packets of sound."""
    with av.open(str(path)) as file:
        return [(one.pts, bytes(one)) for one in file.demux(audio=0) if one.size]


@pytest.mark.parametrize(
    ("codec", "name"), [("libx264", "h264"), ("mpeg4", "mpeg4"), ("libx265", "hevc")]
)
def test_an_edited_video_is_like_the_recorded_one(tmp_path: Path, codec: str, name: str) -> None:
    path = write(tmp_path / "a.mp4", 8, codec=codec, sound=True)
    episode = Videos().read(tmp_path, "a")
    made = copied(brighter(episode, at=3), tmp_path / "out")
    with av.open(str(path)) as one, av.open(str(made)) as other:
        for stream, twin in zip(one.streams, other.streams, strict=True):
            assert stream.codec_context.name == twin.codec_context.name
        first, second = one.streams.video[0], other.streams.video[0]
        assert second.codec_context.name == name
        assert (first.width, first.height, first.average_rate) == (
            second.width, second.height, second.average_rate,
        )  # fmt: skip
        assert first.pix_fmt == second.pix_fmt
    assert sound(made) == sound(path)
    again = Videos().read(tmp_path / "out", "video_0")
    assert again.length == 8
    for t in (2, 3):
        wanted = brighter(episode, at=3).views["ego"].rgb(t).astype(int)
        assert np.abs(again.views["ego"].rgb(t) - wanted).mean() < 2.5


def test_small_videos_in_hevc_are_refused_and_not_crashed_on(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mp4", 2, size=(96, 62))
    episode = Videos().read(tmp_path, "a")
    object.__setattr__(episode.source.video.facts, "codec", "hevc")
    with pytest.raises(Unsupported, match=r"a\.mp4: 96x62 in HEVC"):
        copied(brighter(episode), tmp_path / "out")
    assert not (tmp_path / "out" / "video_0").exists()
    assert path.is_file()


def test_a_rotated_video_of_varying_rate_in_hevc(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mp4", 12, codec="libx265", times=VARIED)
    turn(path, (0, 1, -1, 0))
    episode = Videos().read(tmp_path, "a")
    assert (episode.views["ego"].camera.width, episode.views["ego"].camera.height) == (64, 96)
    made = copied(brighter(episode), tmp_path / "out")
    before, after = Video(path).facts, Video(made).facts
    assert np.array_equal(before.times, after.times)
    assert (before.codec, before.quarter_turns) == (after.codec, after.quarter_turns)
    wanted = brighter(episode).views["ego"].rgb(7).astype(int)
    shown = Videos().read(tmp_path / "out", "video_0").views["ego"].rgb(7)
    assert np.abs(shown - wanted).mean() < 2.5


def test_boxes_of_hands_come_with_the_view(tmp_path: Path) -> None:
    root = dataset(tmp_path)
    clip = Videos().read(root, f"v2/clips/{CLIP}").views["ego"]
    assert clip.hands == {1: ((1.0, 2.0, 3.0, 4.0),), 3: ((1.0, 2.0, 3.0, 4.0),)}


def test_an_unedited_video_keeps_its_bytes(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mp4", 4)
    made = copied(Videos().read(tmp_path, "a"), tmp_path / "out")
    assert made.read_bytes() == path.read_bytes()


def test_narrations_say_what_to_do(tmp_path: Path) -> None:
    root = dataset(tmp_path)
    adapter = Videos()
    assert list(adapter.episodes(root)) == [f"v2/clips/{CLIP}", f"v2/full_scale/{UID}"]
    assert adapter.read(root, f"v2/full_scale/{UID}").descriptions == ("picks the pan", "stirs")
    clip = adapter.read(root, f"v2/clips/{CLIP}")
    assert clip.descriptions == ("stirs",)
    (note,) = clip.source.notes.passes["narration_pass_1"]["narrations"]
    assert note["timestamp_frame"] == 3
    assert note["timestamp_sec"] == pytest.approx(0.1)


def test_annotations_get_the_new_names(tmp_path: Path) -> None:
    root, out = dataset(tmp_path / "in"), tmp_path / "out"
    adapter = Videos()
    key = f"v2/clips/{CLIP}"
    edited = replace(brighter(adapter.read(root, key)), descriptions=("shakes",))
    adapter.write(edited, out, adapter.key_at(key, 0), dict)
    adapter.finish(root, out)
    assert list(adapter.episodes(out)) == ["v2/clips/video_0"]
    assert (out / "v2/clips/video_0.mp4").is_file()
    (video,) = json.loads((out / "v2/ego4d.json").read_text())["videos"]
    assert video["video_uid"] == "video_0"
    assert video["video_metadata"]["num_frames"] == 6
    assert video["synthetic"] is True
    assert video["source_file"] == f"{CLIP}.mp4"
    narrations = json.loads((out / "v2/annotations" / NARRATIONS).read_text())
    assert narrations["version"] == "v2"
    assert list(narrations["videos"]) == ["video_0"]
    assert narrations["videos"]["video_0"]["status"] == "redacted"
    (note,) = narrations["videos"]["video_0"]["narration_pass_1"]["narrations"]
    assert note["narration_text"] == "#C C shakes #unsure"
    (clip,) = json.loads((out / "v2/annotations/fho_hands.json").read_text())["clips"]
    assert clip["clip_uid"] == "video_0"
    (action,) = clip["frames"]  # the other one was before the clip
    assert action["pre_frame"]["frame"] == 1
    assert action["pnr_frame"]["boxes"] == [{"left_hand": [1, 2, 3, 4]}]
    assert adapter.read(out, "v2/clips/video_0").descriptions == ("shakes",)


def test_clips_are_cut_by_time_and_by_annotation(tmp_path: Path) -> None:
    root = dataset(tmp_path / "in")
    given = [
        f"  - {{video: {UID}, start: 0.1, end: 0.2}}",
        f"  - {{video: {UID}, annotation: b, margin: 0.05}}",
    ]
    (root / "v2/full_scale/clips.yaml").write_text("clips:\n" + "\n".join(given))
    adapter = Videos()
    first, second = [key for key in adapter.episodes(root) if "cut" in key]
    whole = Video(root / f"v2/full_scale/{UID}.mp4")
    by_time = adapter.read(root, first)
    assert by_time.length == 3
    assert np.array_equal(by_time.views["ego"].rgb(0), whole.rgb(3))
    assert by_time.descriptions == ("picks the pan",)
    by_note = adapter.read(root, second)
    assert by_note.length == 3
    assert by_note.descriptions == ("stirs",)
    assert adapter.key_at(first, 2) == "v2/clips/video_2"
    adapter.write(by_time, tmp_path / "out", adapter.key_at(first, 0), dict)
    again = adapter.read(tmp_path / "out", "v2/clips/video_0")
    assert again.length == 3
    assert np.abs(again.views["ego"].rgb(1).astype(int) - whole.rgb(4)).mean() < 2


@pytest.mark.parametrize("name", ["uid", "action_uid"])
def test_clips_are_cut_by_actions_under_either_name(tmp_path: Path, name: str) -> None:
    root = dataset(tmp_path / "in")
    hands = root / "v2/annotations/fho_hands_train.json"
    given = json.loads(hands.read_text())
    given["clips"][0]["frames"][0] |= {name: "h", "action_start_sec": 0.2, "action_end_sec": 0.3}
    hands.write_text(json.dumps(given))
    clip = f"clips:\n  - {{video: {UID}, annotation: h, margin: 0.01}}\n"
    (root / "v2/full_scale/clips.yaml").write_text(clip)
    (key,) = [key for key in Videos().episodes(root) if "cut" in key]
    whole = Video(root / f"v2/full_scale/{UID}.mp4")
    assert np.array_equal(Videos().read(root, key).views["ego"].rgb(0), whole.rgb(6))


def test_one_file_is_a_dataset_and_other_layouts_come_first(tmp_path: Path, dataset: Path) -> None:
    path = write(tmp_path / "videos" / "a.mp4", 3)
    assert registry.adapter_for(path).name == "video"
    assert registry.adapter_for(path.parent).name == "video"
    assert registry.adapter("video").read(path, "a").length == 3
    write(dataset / "seen.mp4", 3)
    assert registry.adapter_for(dataset).name == "rlbench"


@pytest.mark.parametrize(
    "spoil", [lambda data: data[: len(data) // 2], lambda data: b"", lambda data: b"x" * 99]
)
def test_damaged_videos_are_named(tmp_path: Path, spoil) -> None:
    path = write(tmp_path / "a.mp4", 4)
    path.write_bytes(spoil(path.read_bytes()))
    with pytest.raises(BadInput, match=r"a\.mp4"):
        Videos().read(tmp_path, "a").views["ego"].rgb(3)


def test_bad_annotations_are_named(tmp_path: Path) -> None:
    root = dataset(tmp_path)
    (root / "v2/annotations" / NARRATIONS).write_text("[")
    with pytest.raises(BadInput, match=NARRATIONS):
        Videos().read(root, f"v2/clips/{CLIP}")


@pytest.mark.parametrize(
    ("narration", "words"),
    [
        ("#C C opens the drawer.", "opens the drawer"),
        ("#O A man X looks at C", "A man X looks at C"),
        ("#c C cuts #unsure", "cuts"),
        ("plain words", "plain words"),
    ],
)
def test_tags_are_no_instruction(narration: str, words: str) -> None:
    assert ego4d.instruction(narration) == words


def test_real_videos(samples: Path) -> None:
    adapter = Videos()
    for folder, length, size in (("ego_hawor", 121, (1920, 1080)), ("ego_lavila", 60, (384, 288))):
        (key,) = adapter.episodes(samples / folder)
        episode = adapter.read(samples / folder, key)
        view: CameraView = episode.views["ego"]
        assert (episode.length, (view.camera.width, view.camera.height)) == (length, size)
        assert view.camera.assumed
        assert view.rgb(length - 1).std() > 10


KINDS = {
    "ten_bits.mp4": ("libx264", "yuv420p10le", (96, 64)),
    "half_color.avi": ("mjpeg", "yuvj422p", (96, 64)),
    "full_color.mp4": ("libx264", "yuv444p", (95, 63)),
    "gray.mkv": ("ffv1", "gray", (95, 63)),
    "sixteen_bits.mkv": ("ffv1", "gray16le", (95, 63)),
    "odd.webm": ("libvpx-vp9", "yuv420p", (95, 63)),
}


@pytest.mark.parametrize("name", KINDS)
def test_unedited_samples_of_every_kind_stay(tmp_path: Path, name: str) -> None:
    codec, pixels, size = KINDS[name]
    path = write(tmp_path / name, 3, codec=codec, size=size, pixels=pixels)
    episode = Videos().read(tmp_path, path.stem)
    recorded = episode.source.video
    assert (episode.views["ego"].camera.width, episode.views["ego"].camera.height) == size
    image = recorded.rgb(1).copy()
    image[:20, :30] //= 2
    made = encode.changed(recorded, 1, image)
    assert (
        np.abs(
            video_stream.pixels(made, recorded.facts)[:20, :30].astype(int) - image[:20, :30]
        ).mean()
        < 3
    )
    for old, new in zip(recorded.frame(1).planes, made.planes, strict=True):
        a, b = (np.frombuffer(one, np.uint8).reshape(one.height, -1) for one in (old, new))
        first = one_block(old.height)
        assert np.array_equal(a[first:, : old.width], b[first:, : old.width])
    out = copied(brighter(episode), tmp_path / "out")
    again = Video(out)
    assert (again.facts.pixels, again.size, again.length) == (recorded.facts.pixels, size, 3)


def one_block(height: int) -> int:
    """The first row of a plane that shows nothing of the upper 20 of 63 or 64."""
    return 20 if height > 40 else 10


def test_a_broken_last_group_is_left_out_and_said(tmp_path: Path) -> None:
    path = write(tmp_path / "clip.mp4", 20, gop=5)
    whole = Videos().read(tmp_path, "clip")
    with av.open(str(path)) as file:
        packets = [(one.pos, one.size) for one in file.demux(video=0) if one.size]
    data = bytearray(path.read_bytes())
    for at, size in packets[-2:]:
        data[at : at + size] = bytes(size)
    wanted = [whole.views["ego"].rgb(t) for t in range(16)]
    path.write_bytes(data)
    episode = Videos().read(tmp_path, "clip")
    assert episode.length == 16
    assert episode.unread == ("the last 4 frames of the video do not decode and are left out",)
    for t in (15, 3, 14):
        assert np.array_equal(episode.views["ego"].rgb(t), wanted[t])


def test_packets_are_read_once_for_all_cuts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "long.mp4", 20)
    (tmp_path / "clips.yaml").write_text(
        "version: 1\nclips:\n  - {video: long, start: 0.0, end: 0.2}\n  - {video: long, start: 0.3, end: 0.5}\n"
    )
    for key in Videos().episodes(tmp_path):
        Videos().read(tmp_path, key).views["ego"].rgb(0)
    before = video_stream.facts.cache_info().misses
    assert Video(path).length == 20
    assert video_stream.facts.cache_info().misses == before


def test_a_video_that_is_let_go_leaves_no_threads(tmp_path: Path) -> None:
    def threads() -> int:
        return len(list(Path("/proc/self/task").iterdir()))

    path, counts = write(tmp_path / "clip.mp4", 20), []
    for _ in range(4):
        shown = Video(path)
        for t in range(20):
            shown.rgb(t)
        del shown
        counts.append(threads())
    assert counts[-1] <= counts[0]


def test_a_clip_of_a_video_that_is_not_there_is_refused(tmp_path: Path) -> None:
    (tmp_path / "clips.yaml").write_text("clips:\n- {video: nowhere, start: 0, end: 1}\n")
    (tmp_path / "walk.mp4").write_bytes(b"")
    with pytest.raises(BadInput, match=r"clips\.0\.video: found nowhere; .*beside it: walk"):
        Videos().episodes(tmp_path)


def test_a_reader_that_is_left_open_ends_quietly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As Python ends it: the module's names are gone by then."""
    write(tmp_path / "a.mp4", 6)
    with av.open(str(tmp_path / "a.mp4")) as file:
        frames = video_stream._frames(file, file.streams.video[0])
        next(frames)
        monkeypatch.setattr(video_stream, "FFmpegError", None)
        frames.close()
