"""A video of which a part is new: packets of what stays are copied bit for bit, the rest is encoded anew.

New frames begin anywhere where no packet before is shown later (an encoder's first frame refers to nothing), and end
where decoding can begin whatever was before: at an instantaneous refresh (IDR) of H.264 and HEVC, at a key frame of
other codecs, with no frame stored after it that is shown before it (an open group of pictures is joined to the one
before). Two encoders' packets share one stream:

- H.264, HEVC: the header holds parameter sets of both, ours under numbers of their own (ITU-T H.264 and H.265, 7.3), so
  that each slice names those it was encoded with and no packet holds any;
- AV1, VP9, MJPEG: each key frame has its parameters with it;
- others (MPEG-4, FFV1): where both encoders come to the same header.

The result is decoded whole, and must show the recorded samples and those of the new parts; where it does not, or codec
and container do not allow it, everything is encoded anew and the caller is told why.
"""

import os
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from itertools import groupby, islice, pairwise
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.error import FFmpegError
from av.video.frame import VideoFrame
from jaxtyping import Bool, Int64
from rpaug_adapters.shared.video import Span, opened, planar, samples

from rpaug import BadInput, in_order

HEVC_ID = 15  # its code has 9 bits, that of x265's 0 has one: a byte is put in, and all after it stays aligned
AVC_HEAD, HEVC_HEAD = 5, 22  # bytes before the parameter sets of a header (ISO/IEC 14496-15)
LENGTH = 4  # bytes that say how long a unit of a packet is, as FFmpeg writes them
IDR = {"h264": {5}, "hevc": {19, 20}}  # kinds of units
SLICES = {"h264": range(1, 6), "hevc": range(32)}
REFERENCE = range(16, 24)  # HEVC's slices with one flag more
VIDEO_SET, SEQUENCE_SET, PICTURE_SET = 32, 33, 34  # HEVC's
SEQUENCE_HEADER = 1  # AV1's
IN_BAND = ("av1", "vp9", "mjpeg")
MP4 = (".mp4", ".mov", ".m4v")

New = Iterator[tuple[int, Any]]
"""Frames to encode: their numbers, and what they show, None for what is recorded."""
Pieces = list[tuple[Path, range]]
"""Files, and the frames of the source that they show."""


@dataclass(frozen=True)
class StoredFrames:
    """A file's packets in the order stored; frames are numbered in the order shown.

    `clean` says before which packets all that are stored are shown before all that follow (the end is one), `entry`
    where besides decoding can begin.
    """

    codec: str
    extradata: bytes
    pts: Int64[np.ndarray, "n"]
    dts: Int64[np.ndarray, "n"]
    clean: Bool[np.ndarray, "n+1"]
    entry: Bool[np.ndarray, "n+1"]

    @property
    def times(self) -> Int64[np.ndarray, "n"]:
        """When each frame is shown."""
        return np.sort(self.pts)

    @property
    def early(self) -> int:
        """How many frames, at most, are stored before one that is shown before them."""
        return int((np.argsort(np.argsort(self.pts)) - np.arange(len(self.pts))).max(initial=0))

    @property
    def unfit(self) -> str:
        """Why packets of another encoder have no place beside these, if so."""
        head = {"h264": 4, "hevc": 21}.get(self.codec)  # where the length of lengths is
        if len(np.unique(self.pts)) != len(self.pts) or not len(self.pts):
            return f"not all packets of its {self.codec} state when they are decoded and shown"
        if head is not None and (self.extradata[:1] != b"\x01" or self.extradata[head] & 3 != 3):
            return f"its {self.codec} has no header of the kind that holds two encoders' parameters"
        return ""


def stored(path: Path) -> StoredFrames:
    """How a file's packets lie; without packets where one has no time or is not to be shown. Raises BadInput."""
    pts, dts, entry = [], [], []
    with opened(path) as file:
        stream = file.streams.video[0]
        codec, extradata = stream.codec_context.name, stream.codec_context.extradata or b""
        codec = codec.removeprefix("lib").replace("dav1d", "av1").replace("vpx-", "")
        for packet in file.demux(stream):
            if packet.size:
                if packet.pts is None or packet.dts is None or packet.is_discard:
                    pts = dts = entry = []
                    break
                pts.append(packet.pts)
                dts.append(packet.dts)
                entry.append(packet.is_keyframe and _refreshes(codec, bytes(packet)))
    shown = np.array(pts, np.int64)
    before, after = np.maximum.accumulate(shown), np.minimum.accumulate(shown[::-1])[::-1]
    clean = np.array([True, *(before[:-1] < after[1:]), True])[: len(shown) + 1]
    return StoredFrames(
        codec, extradata, shown, np.array(dts, np.int64), clean, np.array([*entry, True]) & clean
    )


def first_frame(span: Span) -> int | None:
    """Which of a file's frames is a span's first; None where others lie between its frames. Raises BadInput."""
    with opened(span.path) as file:
        tick = file.streams.video[0].time_base
    assert tick is not None
    numbers = [span.number(one * tick) for one in stored(span.path).times.tolist()]
    first = numbers.index(0) if 0 in numbers else len(numbers)
    inside = numbers[first : first + span.length] == list(range(span.length))
    return first if inside else None


def _refreshes(codec: str, data: bytes) -> bool:
    """Whether a key frame's packet makes decoding independent of all before it."""
    if codec in IDR:
        kinds = {_kind(codec, unit) for unit in _units(data)} & {*SLICES[codec]}
        return bool(kinds) and kinds <= IDR[codec]
    return codec != "av1" or data[0] >> 3 & 15 == SEQUENCE_HEADER


def write(
    source: Path,
    frames: range,
    new: Callable[[int], Any],
    encode: Callable[[New, Path], None],
    target: Path,
    *,
    begin: int = 0,
    sound: bool = False,
) -> tuple[str, ...]:
    """Write some frames of a file, the first at the time `begin` of its time base, with `new(t)` in place of frame t
    where that is not None. Returns why all had to be encoded anew, where an edit left frames as they were.

    `encode` writes frames to a file of their own, in the target's container, one packet a frame, H.264 with parameter
    sets numbered `video.X264_ID`. `new` is asked in threads, for the next frames while others are encoded, once a
    frame; again where all must be encoded after all. Raises BadInput, and what `encode` raises.
    """
    lies, parts = stored(source), target.with_name(f".parts-{target.name}")
    why, edited, left = lies.unfit, 0, 0

    def images() -> Iterator[Any]:
        nonlocal edited, left
        for image in in_order(partial(new, t) for t in frames):
            edited, left = edited + (image is not None), left + (image is None)
            yield image

    parts.mkdir()
    try:
        pieces: Pieces = []
        if not why:
            for piece in _encoded(_to_encode(lies, frames, images()), encode, parts, target.suffix):
                pieces.append(piece)
                if piece[1] != frames and _header(lies, piece[0]) is None:
                    why = f"another encoder wrote the header of its {lies.codec}"
                    break
        if not why and [run for _, run in pieces] != [frames]:
            pieces = _filled(pieces, frames, source)
            if _joined(lies, pieces, source, target, begin, sound) and _shows(
                lies, pieces, source, target, begin
            ):
                return ()
            why = f"its {lies.codec} and new packets do not decode as one"
        if why:
            edited = left = 0
            pieces = [(parts / f"all{target.suffix}", frames)]
            encode(zip(frames, images(), strict=True), pieces[0][0])
        if sound:
            _with_sound(pieces[0][0], source, target)
        else:
            os.replace(pieces[0][0], target)
    finally:
        shutil.rmtree(parts)
    return (f"{source.name}: all is encoded anew: {why}",) if why and edited and left else ()


def _to_encode(lies: StoredFrames, frames: range, images: Iterator[Any]) -> New:
    """The frames that cannot stay: of each group of pictures those from its first new one on."""
    entries, clean = (np.flatnonzero(one[: frames.stop + 1]) for one in (lies.entry, lies.clean))
    bounds = [frames.start, *(n for n in entries.tolist() if n in frames[1:]), frames.stop]
    for first, end in pairwise(bounds):
        at, image = first, next(images)
        while image is None and lies.entry[first] and (at := at + 1) < end:
            image = next(images)
        if lies.entry[first]:
            yield from ((t, None) for t in range(int(clean[clean <= at][-1]), at))
        if at < end:
            yield at, image
        yield from ((t, next(images)) for t in range(at + 1, end))


def _encoded(
    frames: New, encode: Callable[[New, Path], None], folder: Path, suffix: str
) -> Iterator[tuple[Path, range]]:
    """A file for each run of frames."""
    runs = groupby(enumerate(frames), lambda one: one[1][0] - one[0])
    for number, (_, run) in enumerate(runs):
        seen: list[int] = []

        def passed(run: Any = run, seen: list[int] = seen) -> New:
            for _, (t, image) in run:
                seen.append(t)
                yield t, image

        path = folder / f"{number}{suffix}"
        encode(passed(), path)
        yield path, range(seen[0], seen[-1] + 1)


def _filled(pieces: Pieces, frames: range, source: Path) -> Pieces:
    """The pieces, with what stays between them."""
    found, at = [], frames.start
    for path, run in pieces:
        found += [(source, range(at, run.start)), (path, run)]
        at = run.stop
    return [one for one in (*found, (source, range(at, frames.stop))) if one[1]]


def _joined(
    lies: StoredFrames, pieces: Pieces, source: Path, target: Path, begin: int, sound: bool
) -> bool:
    """Copy the pieces' packets into one file; False where new ones do not come one a frame, each in time."""
    times = lies.times
    shift = begin - int(times[pieces[0][1].start])
    lasts = dict(zip(times.tolist(), [*np.diff(times).tolist(), 0], strict=True))
    new = next((path for path, _ in pieces if path != source), None)
    with opened(source) as file, _output(file, target) as made:
        recorded = file.streams.video[0]
        copied = made.add_stream_from_template(recorded, opaque=True)
        copied.codec_context.codec_tag = recorded.codec_context.codec_tag
        copied.codec_context.extradata = (new and _header(lies, new)) or lies.extradata or None
        heard = _heard(file, made) if sound else {}
        made.start_encoding()
        kept = enumerate(one for one in file.demux(recorded) if one.size)
        for path, run in pieces:
            if path == source:
                for one in islice((one for n, one in kept if n in run), len(run)):
                    _mux(made, copied, one, one.pts + shift, one.dts + shift)
                continue
            order = np.argsort(np.argsort([one.pts for one in _packets(path)]))
            if len(order) != len(run):
                return False
            shown, dts = times[run.start : run.stop][order], lies.dts[run.start : run.stop]
            if (dts > shown).any():
                return False
            for one, at, early in zip(_packets(path), shown.tolist(), dts.tolist(), strict=True):
                packet = av.Packet(_renumbered(bytes(one)) if lies.codec == "hevc" else bytes(one))
                packet.is_keyframe, packet.time_base = one.is_keyframe, recorded.time_base
                packet.duration = lasts[at]
                _mux(made, copied, packet, at + shift, early + shift)
        _copy_sound(source, made, heard)
    return True


def _with_sound(part: Path, source: Path, target: Path) -> None:
    """A video of new frames alone, with the source's sound."""
    with (
        opened(source) as file,
        opened(part) as silent,
        _output(file, target) as made,
    ):
        stream = silent.streams.video[0]
        copied = made.add_stream_from_template(stream, opaque=True)
        heard = _heard(file, made)
        made.start_encoding()
        for one in silent.demux(stream):
            if one.size:
                _mux(made, copied, one, one.pts, one.dts)
        _copy_sound(source, made, heard)


def _output(source: Any, target: Path) -> AbstractContextManager[Any]:
    """A new file with the ticks of another."""
    base = source.streams.video[0].time_base
    ticks = {"video_track_timescale": str(base.denominator)}
    return av.open(str(target), "w", options=ticks if target.suffix in MP4 else {})


def _mux(made: Any, stream: Any, packet: av.Packet, pts: int, dts: int | None) -> None:
    packet.pts, packet.dts, packet.stream = pts, dts, stream
    made.mux(packet)


def _heard(file: Any, made: Any) -> dict[int, Any]:
    return {one.index: made.add_stream_from_template(one) for one in file.streams.audio}


def _copy_sound(source: Path, made: Any, heard: dict[int, Any]) -> None:
    """All packets of sound, from the file's beginning: a seek to 0 leaves out what an audio encoder was primed with."""
    if not heard:
        return
    with opened(source) as file:
        for one in file.demux(*(file.streams[n] for n in heard)):
            if one.dts is not None:
                one.stream = heard[one.stream_index]
                made.mux(one)


def _packets(path: Path) -> Iterator[av.Packet]:
    with opened(path) as file:
        yield from (one for one in file.demux(file.streams.video[0]) if one.size)


def _shows(lies: StoredFrames, pieces: Pieces, source: Path, target: Path, begin: int) -> bool:
    """Whether a file shows the pieces, sample by sample and in time."""
    times = lies.times
    first, last = pieces[0][1].start, pieces[-1][1].stop
    recorded = _decoded(source, int(times[first]), last < len(times))

    def wanted() -> Iterator[tuple[int, VideoFrame | None]]:
        for path, run in pieces:
            for t in run:
                if path == source:
                    yield t, next((one for one in recorded if one.pts >= times[t]), None)
            if path != source:
                yield from zip(run, _decoded(path), strict=True)

    made = _decoded(target)
    try:
        for (t, frame), shown in zip(wanted(), made, strict=True):
            if frame is None or shown.pts != times[t] - times[first] + begin:
                return False
            if not _alike(frame, shown):
                return False
    except (BadInput, FFmpegError, ValueError):
        return False
    return True


def _decoded(path: Path, at: int = 0, alone: bool = False) -> Iterator[VideoFrame]:
    """Frames from a time on; with a thread `alone` where what follows may be spoilt."""
    with opened(path) as file:
        stream = file.streams.video[0]
        if alone:
            stream.codec_context.thread_count = 1
        else:
            stream.thread_type = "AUTO"
        if at:
            file.seek(at, stream=stream, backward=True)
        yield from (one for one in file.decode(stream) if one.pts is not None)


def _alike(one: VideoFrame, other: VideoFrame) -> bool:
    """Whether two frames hold the same samples."""
    if (one.format.name, one.width, one.height) != (other.format.name, other.width, other.height):
        return False
    if not planar(one):
        return all(map(np.array_equal, map(bytes, one.planes), map(bytes, other.planes)))
    kind = np.uint8 if one.format.components[0].bits == 8 else np.uint16
    return all(
        np.array_equal(samples(a, kind), samples(b, kind))
        for a, b in zip(one.planes, other.planes, strict=True)
    )


def _header(lies: StoredFrames, part: Path) -> bytes | None:
    """What the header of a stream of both encoders' packets holds; None where there is no such."""
    with opened(part) as file:
        ours = file.streams.video[0].codec_context.extradata or b""
    if lies.codec == "h264":
        return _avc(lies.extradata, ours)
    if lies.codec == "hevc":
        return _hevc(lies.extradata, ours)
    return lies.extradata if lies.codec in IN_BAND or ours == lies.extradata else None


def _avc(one: bytes, other: bytes) -> bytes:
    """One AVC header of two: the profile of the first, the higher level, the parameter sets of both."""
    sets, tails = ([], []), []
    for data in (one, other):
        at = AVC_HEAD
        for found, mask in zip(sets, (31, 255), strict=True):
            count, at = data[at] & mask, at + 1
            for _ in range(count):
                size = int.from_bytes(data[at : at + 2], "big")
                found.append(data[at : at + 2 + size])
                at += 2 + size
        tails.append(data[at:])
    level = max(one[3], other[3])
    head = one[:3] + bytes([level, one[4], 0xE0 | len(sets[0])])
    return b"".join([head, *sets[0], bytes([len(sets[1])]), *sets[1], tails[0] or tails[1]])


def _hevc(one: bytes, other: bytes) -> bytes:
    """One HEVC header of two, with the other's parameter sets renumbered."""
    arrays: dict[int, list[bytes]] = {}
    for data in (one, other):
        at = HEVC_HEAD + 1
        for _ in range(data[HEVC_HEAD]):
            kind, count = data[at], int.from_bytes(data[at + 1 : at + 3], "big")
            at += 3
            for _ in range(count):
                size = int.from_bytes(data[at : at + 2], "big")
                unit, at = data[at + 2 : at + 2 + size], at + 2 + size
                if data is one:
                    arrays.setdefault(kind, []).append(unit)
                elif kind & 63 in (VIDEO_SET, SEQUENCE_SET, PICTURE_SET):
                    same = next((k for k in arrays if k & 63 == kind & 63), kind)
                    arrays.setdefault(same, []).append(_unit_renumbered(unit))
    head = bytearray(one[:HEVC_HEAD])
    head[12] = max(one[12], other[12])  # the level
    made = [bytes(head), bytes([len(arrays)])]
    for kind, units in arrays.items():
        made += [bytes([kind]), len(units).to_bytes(2, "big")]
        made += [len(unit).to_bytes(2, "big") + unit for unit in units]
    return b"".join(made)


def _units(data: bytes) -> Iterator[bytes]:
    """The units of a packet, each behind its length."""
    at = 0
    while at + LENGTH < len(data):
        size = int.from_bytes(data[at : at + LENGTH], "big")
        at += LENGTH
        if unit := data[at : at + size]:
            yield unit
        at += size


def _kind(codec: str, unit: bytes) -> int:
    return unit[0] & 31 if codec == "h264" else unit[0] >> 1 & 63


def _renumbered(data: bytes) -> bytes:
    """A packet of HEVC, its slices by the parameter sets HEVC_ID in place of 0."""
    units = map(_unit_renumbered, _units(data))
    return b"".join(len(unit).to_bytes(LENGTH, "big") + unit for unit in units)


def _unit_renumbered(unit: bytes) -> bytes:
    kind = _kind("hevc", unit)
    body = re.sub(b"\0\0\3", b"\0\0", unit[2:])  # without what keeps start codes from appearing
    if kind in (VIDEO_SET, SEQUENCE_SET):
        body = bytes([HEVC_ID << 4 | body[0] & 15]) + body[1:]
    if kind == SEQUENCE_SET:
        body = _longer(body, 8 + 96)  # after profile and level
    elif kind == PICTURE_SET:
        body = _longer(_longer(body, 0), 9)
    elif kind in SLICES["hevc"]:
        body = _longer(body, 2 if kind in REFERENCE else 1)
    return unit[:2] + re.sub(b"\0\0(?=[\0-\3])", b"\0\0\3", body)


def _longer(body: bytes, at: int) -> bytes:
    """Bits with the number HEVC_ID in place of a 0 at a bit, both in Exp-Golomb codes: 000010000 for 1."""
    byte, bit = divmod(at, 8)
    rest = 7 - bit
    head, tail = body[byte] >> 8 - bit, body[byte] & (1 << rest) - 1
    code = (HEVC_ID + 1) << rest
    return body[:byte] + (head << 9 + rest | code | tail).to_bytes(2, "big") + body[byte + 1 :]
