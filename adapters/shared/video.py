"""A span of frames in a video file: checked, decoded one after another, cut out without loss, and written.

Frames are counted from the span's start, frame t being shown t / rate seconds after it. Nothing here holds more than a
few frames: PyAV decodes while it reads.
"""

import errno
import hashlib
import os
import threading
import zlib
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.video.frame import VideoFrame
from av.video.plane import VideoPlane
from jaxtyping import UInt8, UInt16

from rpaug import BadInput, files

KEPT = 8  # decoded frames
ENCODERS = {"h264": "libx264", "hevc": "libx265", "av1": "libsvtav1", "vp9": "libvpx-vp9"}
X265 = "log-level=none:open-gop=0:bframes=0"
CODES = "gray12le"  # pixel format of 12-bit codes
X264_ID = 31  # of parameter sets: the largest that x264 takes
CPU = Path("/proc/cpuinfo")
# x264's AVX-512 code for its macroblock tree reads what nobody wrote (frames 96 or 320 wide): each run had other bytes.
X264 = f"sps-id={X264_ID}" + (
    ":asm=AVX2" if CPU.is_file() and b" avx512" in CPU.read_bytes() else ""
)
QUALITY = "10"  # constant rate factor: what was not edited comes back nearly as it was
EVERY = 2  # frames from one key frame to the next, as LeRobot has it: any frame is near one
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)
HEVC_LEAST = 64  # pixels a side: x265 4.2 writes beyond its memory for 48x32
BACK = 10.0  # seconds
TICKS = 90_000  # a second
PACKETS = {
    "codec_whitelist": "none"
}  # FFmpeg tries no decoder on a file that is opened for its packets


@dataclass(frozen=True)
class Span:
    """`length` frames of a file's first video stream, `rate` a second, from `start` seconds on."""

    path: Path
    start: float
    length: int
    rate: float

    @property
    def end(self) -> float:
        """When the span ends, in seconds of the file."""
        return self.start + self.length / self.rate

    def number(self, seconds: float) -> int:
        """The frame that is shown at a time of the file."""
        return round((seconds - self.start) * self.rate)


def reason(error: Exception) -> str:
    """What an error says, without its number and the path."""
    words = getattr(error, "strerror", None) or str(error)
    return str(words)[:120]


@contextmanager
def opened(path: Path, *, decoded: bool = True) -> Iterator[av.container.InputContainer]:
    """The file, for reading; quicker if nothing is to be decoded. Raises BadInput for what is no video or is damaged
    where it is read."""
    if not path.is_file():
        raise BadInput(path, "file", found="nothing", expected="a video")
    try:
        with av.open(str(path), options={} if decoded else PACKETS) as container:
            if not container.streams.video:
                raise BadInput(path, "streams", found="no video", expected="a video stream")
            stream = container.streams.video[0]
            if stream.codec_context is None or stream.time_base is None:
                raise BadInput(path, "codec", found="none known", expected="a video stream")
            if not (0 < stream.width <= files.MAX_SIDE and 0 < stream.height <= files.MAX_SIDE):
                found = f"{stream.width}x{stream.height}"
                raise BadInput(path, "size", found=found, expected=f"1 to {files.MAX_SIDE} a side")
            yield container
    except (av.FFmpegError, EOFError, ValueError, OSError) as error:
        if getattr(error, "errno", None) in FULL:  # what the block was writing, not the video
            raise
        raise BadInput(path, "video", found=reason(error), expected="a whole video") from None


def _seek(container: av.container.InputContainer, seconds: float) -> None:
    """To the key frame at a time, or before it."""
    stream = container.streams.video[0]
    assert stream.time_base is not None
    ticks = round(seconds / stream.time_base) - 1
    container.seek(max(ticks, 0), stream=stream, backward=True, any_frame=False)


def check(span: Span) -> tuple[int, int]:
    """Width and height, after every frame of the span was found in the file. Raises BadInput."""
    with opened(span.path, decoded=False) as container:
        stream = container.streams.video[0]
        _seek(container, span.start)
        assert stream.time_base is not None
        tick, seen, last = float(stream.time_base), set(), -1
        for packet in container.demux(stream):
            if packet.pts is None:
                continue
            number = span.number(packet.pts * tick)
            seen.add(number)
            last = max(last, number)
            if packet.is_keyframe and number >= span.length:
                break
        missing = next((t for t in range(span.length) if t not in seen), None)
        if missing is not None:
            found = f"none at {span.start + missing / span.rate:.3f} s"
            expected = f"{span.length} frames, {span.rate:g} a second from {span.start:.3f} s"
            raise BadInput(span.path, f"frame {missing}", found=found, expected=expected)
        return stream.width, stream.height


class Frames:
    """The pixels of a span, frame by frame; threads may share one. Quick in order, and anywhere by key frames."""

    def __init__(self, span: Span, kind: str = "rgb24") -> None:
        self.span, self.kind = span, kind
        self._kept: OrderedDict[int, np.ndarray] = OrderedDict()
        self._source: Iterator[tuple[int, np.ndarray]] | None = None
        self._next = 0
        self._lock = threading.Lock()

    def __call__(self, t: int) -> UInt8[np.ndarray, "h w 3"] | UInt16[np.ndarray, "h w"]:
        """Frame t. Raises BadInput where it cannot be decoded."""
        with self._lock:
            if t in self._kept:
                return self._kept[t]
            going = self._source is not None and self._next <= t < self._next + KEPT
            # Where the nearest key frame does not lead to the frame, an earlier one may.
            for back in (*([None] if going else []), 0.0, BACK):
                if back is not None:
                    self._source = self._decoded(t, back)
                image = self._forward(t)
                if image is not None:
                    return image
            self._source = None
            where = f"frame {t}"
            raise BadInput(self.span.path, where, found="none decodable", expected="an image")

    def _forward(self, t: int) -> np.ndarray | None:
        """Frame t, if it comes next or after a few others."""
        assert self._source is not None
        for number, image in self._source:
            self._next = number + 1
            self._kept[number] = image
            if len(self._kept) > KEPT:
                self._kept.popitem(last=False)
            if number >= t:
                return image if number == t else None
        return None

    def _decoded(self, t: int, back: float) -> Iterator[tuple[int, np.ndarray]]:
        with opened(self.span.path) as container:
            stream = container.streams.video[0]
            stream.codec_context.thread_count = 1  # the same frames, and no threads that outlive us
            _seek(container, max(self.span.start + t / self.span.rate - back, 0.0))
            for frame in container.decode(stream):
                if frame.pts is None:
                    continue
                number = self.span.number(float(frame.pts * stream.time_base))
                if number >= t or number in range(t - KEPT, t):
                    yield number, frame.to_ndarray(format=self.kind)


def cut(span: Span, target: Path) -> bool:
    """Copy the span's packets to a file of their own; False where it does not begin with a key frame."""
    with opened(span.path) as container, av.open(str(target), "w", format="mp4") as made:
        stream = container.streams.video[0]
        copied = made.add_stream_from_template(stream, opaque=True)
        _seek(container, span.start)
        first, count = None, 0
        for packet in container.demux(stream):
            if packet.pts is None:
                continue
            number = span.number(float(packet.pts * packet.time_base))
            if first is None:
                if number < 0:
                    continue
                if number > 0 or not packet.is_keyframe:
                    return False
                first = packet.pts
            if number >= span.length and packet.is_keyframe:
                break
            if not 0 <= number < span.length:
                return False  # frames in an order that crosses the cut
            _shift(packet, -first)
            packet.stream = copied
            made.mux(packet)
            count += 1
    return count == span.length


def _shift(packet: av.Packet, ticks: int) -> None:
    assert packet.pts is not None
    packet.pts += ticks
    if packet.dts is not None:
        packet.dts += ticks


def joined(paths: Iterable[Path], target: Path) -> list[tuple[float, float]]:
    """One file of several of one `stream_format`, without decoding; start and end of each in it, in seconds."""
    places: list[tuple[float, float]] = []
    copied, at = None, Fraction(0)
    with av.open(str(target), "w", format="mp4") as made:
        for path in paths:
            with opened(path) as container:
                stream = container.streams.video[0]
                if copied is None:
                    copied = made.add_stream_from_template(stream, opaque=True)
                end = at
                for packet in container.demux(stream):
                    if packet.pts is None:
                        continue
                    assert packet.time_base is not None
                    _shift(packet, round(at / packet.time_base))
                    end = max(end, (packet.pts + (packet.duration or 0)) * packet.time_base)
                    packet.stream = copied
                    made.mux(packet)
            places.append((float(at), float(end)))
            at = end
    return places


def stream_format(path: Path) -> tuple[object, ...]:
    """What streams must share to be decoded as one: codec, pixels, ticks, parameter sets, and how far frames are stored
    before they are shown. Raises BadInput."""
    with opened(path) as container:
        stream = container.streams.video[0]
        about = stream.codec_context
        first = next((one for one in container.demux(stream) if one.pts is not None), None)
        delay = None if first is None or first.dts is None else first.pts - first.dts
        shape = (about.name, about.codec_tag, about.pix_fmt, about.width, about.height)
        return *shape, stream.time_base, about.extradata, delay


def digest(span: Span) -> bytes:
    """What tells the packets of a span from others, wherever they lie. Raises BadInput."""
    with opened(span.path, decoded=False) as container:
        stream = container.streams.video[0]
        _seek(container, span.start)
        found = hashlib.sha256()
        for packet in container.demux(stream):
            if packet.pts is None:
                continue
            number = span.number(float(packet.pts * packet.time_base))
            if number >= span.length and packet.is_keyframe:
                break
            if 0 <= number < span.length:
                found.update(bytes(packet))
        return found.digest()


def count(path: Path) -> int:
    """How many frames a file says that it holds; 0 where it does not. Raises BadInput."""
    with opened(path, decoded=False) as container:
        return container.streams.video[0].frames


def decode_whole(spans: Sequence[Span]) -> None:
    """See that every frame of the spans, which lie in one file, decodes without a fault. Raises BadInput."""
    path, missing = (
        spans[0].path,
        {(i, t) for i, one in enumerate(spans) for t in range(one.length)},
    )
    starts = [span.start for span in spans]
    with opened(path) as container:
        stream = container.streams.video[0]
        stream.codec_context.options = {"err_detect": "explode"}
        stream.thread_type = "AUTO"
        for frame in container.decode(stream):
            if frame.pts is not None and not frame.is_corrupt:
                seconds = float(frame.pts * stream.time_base)
                i = max(bisect_right(starts, seconds + 0.5 / spans[0].rate) - 1, 0)
                missing.discard((i, spans[i].number(seconds)))
    if missing:
        i, t = min(missing)
        at = spans[i].start + t / spans[i].rate
        expected = "every frame decodable"
        raise BadInput(path, f"frame at {at:.3f} s", found="none", expected=expected)


def encode(
    images: Iterable[UInt8[np.ndarray, "h w 3"]], target: Path, rate: float, like: Path | None
) -> None:
    """Write frames with the codec and pixel format of another file, or as H.264 with full chroma. Raises BadInput."""
    codec, pixels = ("h264", "yuv444p") if like is None else _encoding(like)
    codec = {"libdav1d": "av1", "libvpx-vp9": "vp9"}.get(codec, codec)
    if codec not in ENCODERS:
        raise BadInput(
            like or target, "codec", found=codec, expected=f"one of {', '.join(ENCODERS)}"
        )
    options = {"crf": QUALITY, "g": str(EVERY)}
    if codec == "hevc":
        options["x265-params"] = X265
    if codec == "h264":
        options["bf"] = "0"  # frames in the order they are shown
        options["x264-params"] = X264  # beside another encoder's (`shared.splice`)
    if codec == "av1":
        options["preset"] = "8"
    _write(images, "rgb24", target, rate, (ENCODERS[codec], pixels, options))


def encode_codes(
    codes: Iterable[UInt16[np.ndarray, "h w"]], target: Path, rate: float, like: Path
) -> None:
    """Write frames of 12-bit codes like another file of them, each code exactly: what was written is read again.

    Each frame is a key frame: x265 4.2 loses codes where it predicts small frames from others. Raises BadInput.
    """
    if _encoding(like) != ("hevc", CODES):
        found, expected = " of ".join(_encoding(like)), f"hevc of {CODES}, to be written alike"
        raise BadInput(like, "codec", found=found, expected=expected)
    options = {"g": "1", "x265-params": f"{X265}:lossless=1"}
    sums = []

    def counted() -> Iterator[np.ndarray]:
        for one in codes:
            sums.append(zlib.crc32(np.ascontiguousarray(one)))
            yield one

    _write(counted(), CODES, target, rate, (ENCODERS["hevc"], CODES, options))
    written = Frames(Span(target, 0.0, len(sums), rate), CODES)
    for t, wanted in enumerate(sums):
        if zlib.crc32(np.ascontiguousarray(written(t))) != wanted:
            raise BadInput(
                target, f"frame {t}", found="other codes", expected="those that were written"
            )


def _encoding(path: Path) -> tuple[str, str]:
    """Codec and pixel format of a file. Raises BadInput."""
    with opened(path) as container:
        about = container.streams.video[0].codec_context
        return about.name, about.pix_fmt or ""


def _write(
    images: Iterable[np.ndarray],
    kind: str,
    target: Path,
    rate: float,
    how: tuple[str, str, dict[str, str]],
) -> None:
    """Encode images of one kind; `how` are encoder, pixel format and options. Raises BadInput."""
    encoder, pixels, options = how
    frequency = Fraction(rate).limit_denominator(100_000)
    with av.open(
        str(target), "w", format="mp4", options={"video_track_timescale": str(TICKS)}
    ) as made:
        stream = None
        for t, image in enumerate(images):
            if stream is None:
                if encoder == ENCODERS["hevc"] and min(image.shape[:2]) < HEVC_LEAST:
                    found, expected = f"{image.shape[1]}x{image.shape[0]}", f"{HEVC_LEAST} a side"
                    raise BadInput(target, "size for HEVC", found=found, expected=expected)
                stream = made.add_stream(encoder, rate=frequency, options=options)
                stream.height, stream.width = image.shape[:2]
                stream.pix_fmt = pixels
                stream.codec_context.thread_count = 1
                open_encoders(
                    made
                )  # the header first: an encoder that was emptied may have lost what it says
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format=kind)
            frame.pts, frame.time_base = t, 1 / frequency
            made.mux(stream.encode(frame))
        if stream is not None:
            made.mux(stream.encode())


def planar(frame: VideoFrame) -> bool:
    """Whether each plane holds one number a sample, in whole bytes."""
    parts = frame.format.components
    return len(parts) == len(frame.planes) and all(part.bits >= 8 for part in parts)


def samples(plane: VideoPlane, kind: type[np.unsignedinteger]) -> np.ndarray:
    """The numbers of a plane, (rows, columns), in its own memory."""
    rows = np.frombuffer(plane, np.uint8).reshape(plane.height, plane.line_size)
    return rows.view(kind)[:, : plane.width]


def open_encoders(made: av.container.OutputContainer) -> None:
    """Open the encoders of a new file and write its header.

    SVT-AV1 makes every thread of a process of root's a real-time one (SCHED_FIFO), its own and ours, and leaves it so:
    nothing else on the machine would run beside it. They become ordinary again. It also prints some twenty lines a
    video, of which errors are left.
    """
    os.environ.setdefault("SVT_LOG", "1")
    ordinary = hasattr(os, "sched_getscheduler") and os.sched_getscheduler(0) != os.SCHED_FIFO
    made.start_encoding()
    if ordinary:
        for thread in map(int, os.listdir("/proc/self/task")):
            with suppress(ProcessLookupError):  # it has ended since
                if os.sched_getscheduler(thread) == os.SCHED_FIFO:
                    os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))
