"""An edit of a part of a video leaves the packets of the rest as they were, and the whole decodes."""

import threading
from collections.abc import Collection
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rpaug_adapters.shared import splice
from rpaug_adapters.shared.video import open_encoders
from rpaug_adapters.video import Videos, encode
from rpaug_adapters.video.stream import Video
from videos import picture

from rpaug import Unsupported
from rpaug.core import ahead

SIZE = (96, 64)
LENGTH, GROUP = 24, 8
CLOSED = "bframes=0:open-gop=0"
KINDS = {  # encoder, options, ending
    "h264": ("libx264", {"bf": "0"}, ".mp4"),
    "h264, baseline": ("libx264", {"profile": "baseline"}, ".mov"),
    "h264, frames stored early": ("libx264", {}, ".mp4"),
    "h264, open groups": ("libx264", {"x264-params": "open-gop=1"}, ".mp4"),
    "hevc": ("libx265", {"x265-params": CLOSED}, ".mp4"),
    "hevc in matroska": ("libx265", {"x265-params": CLOSED}, ".mkv"),
    "hevc, frames stored early": ("libx265", {"x265-params": "open-gop=0"}, ".mp4"),
    "hevc, open groups": ("libx265", {}, ".mp4"),
    "av1": ("libsvtav1", {"preset": "12"}, ".mp4"),
    "vp9": ("libvpx-vp9", {}, ".webm"),
    "mjpeg": ("mjpeg", {}, ".avi"),
}


def drawn(t: int) -> np.ndarray:
    return np.roll(picture(t), 3 * t, 1)


def filmed(path: Path, codec: str, options: dict[str, str], pixels: str = "yuv420p") -> Path:
    """A clip of LENGTH frames that move, a key frame every GROUP."""
    quiet = {"x265-params": f"log-level=none:keyint={GROUP}:{options.get('x265-params', '')}"}
    with av.open(str(path), "w") as made:
        more = options | (quiet if codec == "libx265" else {})
        stream = made.add_stream(codec, rate=30, options={"g": str(GROUP), "crf": "24", **more})
        stream.width, stream.height = SIZE
        stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else pixels
        open_encoders(made)
        for t in range(LENGTH):
            frame = av.VideoFrame.from_ndarray(drawn(t), format="rgb24")
            frame.pts, frame.time_base = t, Fraction(1, 30)
            made.mux(stream.encode(frame))
        made.mux(stream.encode())
    return path


def painted(video: Video, edited: Collection[int]) -> encode.Seen:
    def shown(t: int) -> np.ndarray:
        image = video.rgb(t).copy()
        if t in edited:
            image[20:40, 40:60] = (20, 220, 20)
        return image

    return shown


def test_frames_are_made_side_by_side_in_a_process_alone(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv(ahead.BESIDE, raising=False)
    monkeypatch.setattr(ahead, "cores", lambda: 2)
    video = Video(filmed(tmp_path / "a.mp4", "libx264", {}))
    together, image = threading.Barrier(2, timeout=60), painted(video, range(LENGTH))
    waited = list[int]()

    def shown(t: int) -> np.ndarray:
        together.wait()  # breaks where only one frame is under way
        waited.append(t)
        return image(t)

    assert encode.write(tmp_path / "made.mp4", video, shown) == ()
    assert sorted(waited) == list(range(LENGTH))
    again = Video(tmp_path / "made.mp4")
    assert all(np.abs(again.rgb(t).astype(int) - image(t)).mean() < 4 for t in range(LENGTH))


def packets(path: Path) -> list[tuple[int, bytes]]:
    """Time and bytes of each packet, in the order shown."""
    with av.open(str(path)) as file:
        return sorted((one.pts, bytes(one)) for one in file.demux(video=0) if one.size)


def elsewhere(path: Path) -> list[np.ndarray]:
    """What OpenCV shows of a file, with a decoder of its own."""
    film, found = cv2.VideoCapture(str(path)), []
    while (read := film.read())[0]:
        found.append(read[1])
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_packets_stay_but_from_a_change_to_the_next_key_frame(kind: str, tmp_path: Path) -> None:
    codec, options, ending = KINDS[kind]
    video = Video(filmed(tmp_path / f"a{ending}", codec, options))
    made = tmp_path / f"made{ending}"
    shown = painted(video, {11})
    assert encode.write(made, video, shown) == ()
    before, after = packets(video.path), packets(made)
    assert [when for when, _ in after] == [when for when, _ in before]
    stay = {t for t in range(LENGTH) if before[t] == after[t]}
    assert stay >= {*range(8), *(() if "open" in kind else range(16, 24))}
    assert 11 not in stay
    again = Video(made)
    for t in range(LENGTH):
        if t in stay:
            assert np.array_equal(again.rgb(t), video.rgb(t))
        assert np.abs(again.rgb(t).astype(int) - shown(t)).mean() < 2.5
    if codec != "libsvtav1":  # OpenCV's build has no decoder for it
        theirs, recorded = elsewhere(made), elsewhere(video.path)
        assert len(theirs) == LENGTH
        assert all(np.array_equal(theirs[t], recorded[t]) for t in stay)
        assert np.abs(theirs[11][..., ::-1].astype(int) - shown(11)).mean() < 2.5


@pytest.mark.parametrize("edited", [{0}, {23}, {2, 9}, {3, 20}])
def test_wherever_the_edits_are(edited: set[int], tmp_path: Path) -> None:
    video = Video(filmed(tmp_path / "a.mp4", "libx264", {}))
    assert encode.write(tmp_path / "b.mp4", video, painted(video, edited)) == ()
    again = Video(tmp_path / "b.mp4")
    untouched = [n for n in range(3) if not edited & {*range(8 * n, 8 * n + 8)}]
    assert untouched
    for n in untouched:
        for t in range(8 * n, 8 * n + 8):
            assert packets(again.path)[t] == packets(video.path)[t]
            assert np.array_equal(again.rgb(t), video.rgb(t))


def test_the_copy_of_a_copy(tmp_path: Path) -> None:
    """Its header holds our parameter sets, and frames of either encoder can be edited again."""
    one = Video(filmed(tmp_path / "a.mp4", "libx264", {}))
    encode.write(tmp_path / "b.mp4", one, painted(one, {2}))
    other = Video(tmp_path / "b.mp4")
    encode.write(tmp_path / "c.mp4", other, painted(other, {20}))
    last = Video(tmp_path / "c.mp4")
    assert packets(last.path)[:16] == packets(other.path)[:16]
    assert all(np.array_equal(last.rgb(t), other.rgb(t)) for t in range(16))


def test_a_cut_is_encoded_up_to_its_first_key_frame(tmp_path: Path) -> None:
    whole = Video(filmed(tmp_path / "a.mp4", "libx264", {"bf": "0"}))
    part = Video(whole.path, 5, 20)
    assert encode.write(tmp_path / "b.mp4", part, part.rgb) == ()
    made = Video(tmp_path / "b.mp4")
    assert made.length == 15
    assert [data for _, data in packets(made.path)][3:] == [
        data for _, data in packets(whole.path)
    ][8:20]
    assert all(np.array_equal(made.rgb(t), part.rgb(t)) for t in range(3, 15))


@pytest.mark.parametrize(
    ("codec", "ending", "why"),
    [
        ("mpeg4", ".mp4", "another encoder wrote the header"),
        ("libx264", ".avi", "no header of the kind"),
    ],
)
def test_what_cannot_be_spliced_is_encoded_anew_and_said(
    codec: str, ending: str, why: str, tmp_path: Path
) -> None:
    filmed(tmp_path / f"a{ending}", codec, {"bf": "0"})
    episode = Videos().read(tmp_path, "a")
    view, said = episode.views["ego"], []
    changed = replace(view, rgb=painted(episode.source.video, {11}))

    def side(*words: str) -> dict[str, bytes]:
        said.extend(words)
        return {}

    Videos().write(replace(episode, views={"ego": changed}), tmp_path / "out", "video_0", side)
    assert len(said) == 1
    assert why in said[0]
    made = Videos().read(tmp_path / "out", "video_0").views["ego"]
    assert all(np.abs(made.rgb(t).astype(int) - changed.rgb(t)).mean() < 3 for t in range(LENGTH))


@pytest.mark.parametrize(
    ("codec", "pixels", "ending"),
    [("libvpx", "yuv420p", ".webm"), ("prores_ks", "yuv422p10le", ".mov")],
    ids=["vp8", "prores"],
)
def test_codecs_that_are_not_written_are_read_copied_and_refused_by_name(
    codec: str, pixels: str, ending: str, tmp_path: Path
) -> None:
    filmed(tmp_path / f"a{ending}", codec, {}, pixels)
    episode = Videos().read(tmp_path, "a")
    view = episode.views["ego"]
    assert all(np.abs(view.rgb(t).astype(int) - drawn(t)).mean() < 12 for t in range(LENGTH))
    Videos().write(episode, tmp_path / "out", "video_0", dict)
    copied = Videos().read(tmp_path / "out", "video_0").source.video.path
    assert copied.read_bytes() == (tmp_path / f"a{ending}").read_bytes()
    changed = replace(view, rgb=painted(episode.source.video, {11}))
    name = "vp8" if codec == "libvpx" else "prores"
    with pytest.raises(
        Unsupported, match=rf"a\{ending}: .*{name} cannot be written; these can: h264"
    ):
        Videos().write(replace(episode, views={"ego": changed}), tmp_path / "out", "video_1", dict)
    assert {path.stem for path in (tmp_path / "out").iterdir()} == {"video_0"}


def test_a_stream_that_would_show_other_pixels_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        splice, "_avc", lambda one, _: one
    )  # new slices name sets that are not there
    video = Video(filmed(tmp_path / "a.mp4", "libx264", {}))
    shown = painted(video, {11})
    (said,) = encode.write(tmp_path / "b.mp4", video, shown)
    assert "do not decode as one" in said
    made = Video(tmp_path / "b.mp4")
    assert all(np.abs(made.rgb(t).astype(int) - shown(t)).mean() < 2.5 for t in range(LENGTH))


@pytest.mark.parametrize("levels", [(90, 120), (120, 90)])
def test_a_spliced_stream_states_the_higher_level(levels: tuple[int, int]) -> None:
    """A header that states less than its packets need is refused by strict decoders."""
    avc = [bytes([1, 66, 0, level, 0xFF, 0xE0, 0]) for level in levels]
    assert splice._avc(*avc)[3] == 120
    hevc = [bytes(12) + bytes([level]) + bytes(splice.HEVC_HEAD - 12) for level in levels]
    assert splice._hevc(*hevc)[12] == 120


@given(st.binary(min_size=6, max_size=40), st.integers(0, 24))
def test_a_number_grows_by_one_byte(body: bytes, at: int) -> None:
    bits = f"{int.from_bytes(body, 'big'):0{8 * len(body)}b}"
    bits = bits[:at] + "1" + bits[at + 1 :]
    made = splice._longer(int(bits, 2).to_bytes(len(body), "big"), at)
    assert (
        f"{int.from_bytes(made, 'big'):0{8 * len(made)}b}"
        == bits[:at] + "000010000" + bits[at + 1 :]
    )
