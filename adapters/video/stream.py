"""Frames of a video, each exactly the one asked for, decoded as a stream with a few of them kept.

Frames are numbered in the order they are shown in, whatever their timestamps: a variable rate changes nothing. A video
with a rotation in its header is shown upright, as players do. Colors follow the file's matrix; where it names none,
that of BT.709 from 720 rows on and BT.601 below, which is what players assume.
"""

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from threading import RLock
from typing import Any

import av
import numpy as np
from av.container import InputContainer
from av.error import FFmpegError
from av.video.frame import VideoFrame
from av.video.reformatter import Colorspace, VideoReformatter
from av.video.stream import VideoStream
from jaxtyping import Int64, UInt8
from rpaug_adapters.shared.texts import stamp
from rpaug_adapters.video import boxes

from rpaug import BadInput, files

KEPT_BYTES = 64 * 2**20  # of decoded frames
HIGH_DEFINITION = 720  # rows
NAMED = {
    1: Colorspace.ITU709,
    5: Colorspace.ITU601,
    6: Colorspace.ITU601,
    4: Colorspace.FCC,
    7: Colorspace.SMPTE240M,
}  # by ITU-T H.273


@dataclass(frozen=True)
class Facts:
    """What a video's header and packets tell, without decoding: `times` are presentation times in `time_base`.

    `width` and `height` are as stored; `quarter_turns` says how often to turn a stored frame counter-clockwise
    (`np.rot90`) to see it upright. `broken` frames at the end do not decode and are in neither.
    """

    times: Int64[np.ndarray, "t"]
    keys: Int64[np.ndarray, "k"]  # presentation times of frames that decoding can begin at
    time_base: Any
    rate: Any
    codec: str
    pixels: str
    width: int
    height: int
    quarter_turns: int
    broken: int = 0

    @property
    def seconds(self) -> np.ndarray:
        """When each frame is shown, from the first on."""
        return (self.times - self.times[0]) * float(self.time_base)


@lru_cache(64)
def facts(path: Path, _modified: int, _size: int) -> Facts:
    """Read a video's packets, once, and decode its last group of pictures: what is cut off or spoilt is there. Raises
    BadInput where it is no video, or one without whole frames."""
    try:
        with av.open(str(path)) as file:
            if not file.streams.video:
                raise BadInput(path, "streams", found="no video", expected="a video stream")
            stream = file.streams.video[0]
            if stream.codec_context is None:
                raise BadInput(path, "codec", found="one nobody knows", expected="a video's codec")
            if not (0 < stream.width <= files.MAX_SIDE and 0 < stream.height <= files.MAX_SIDE):
                size = f"{stream.width}x{stream.height}"
                raise BadInput(
                    path, "size", found=size, expected=f"1 to {files.MAX_SIDE} pixels a side"
                )
            shown = [
                (packet.pts, packet.is_keyframe)
                for packet in file.demux(stream)
                if packet.pts is not None and packet.size and not packet.is_discard
            ]
            times = np.array(sorted(pts for pts, _ in shown), np.int64)
            if not len(times) or (np.diff(times) <= 0).any():
                found = "no frames" if not len(times) else "two frames at one time"
                raise BadInput(path, "timestamps", found=found, expected="frames one after another")
            keys = np.array(sorted(pts for pts, key in shown if key), np.int64)
            if not len(keys):
                raise BadInput(path, "key frames", found="none", expected="one to begin with")
            broken = _broken(file, times[np.searchsorted(times, keys[-1]) :])
            times = times[: len(times) - broken]
            if not len(times):
                raise BadInput(path, "frames", found="none that decodes", expected="a whole video")
            return Facts(
                times=times,
                keys=keys[keys <= times[-1]],
                broken=broken,
                time_base=stream.time_base,
                rate=stream.average_rate or stream.guessed_rate,
                codec=stream.codec_context.name,
                pixels=stream.codec_context.pix_fmt or "",
                width=stream.width,
                height=stream.height,
                quarter_turns=boxes.quarter_turns(path),
            )
    except (FFmpegError, OSError, ValueError) as error:
        raise BadInput(path, "video", found=_words(error), expected="a video") from None


def _broken(file: InputContainer, last: Int64[np.ndarray, "n"]) -> int:
    """How many of the last frames do not decode; the first of them is a key frame."""
    stream = file.streams.video[0]
    stream.codec_context.thread_count = 1
    file.seek(int(last[0]), stream=stream, backward=True)
    seen = {frame.pts for frame in _frames(file, stream) if not frame.is_corrupt}
    sound = next((n for n, when in enumerate(last.tolist()) if when not in seen), len(last))
    return len(last) - sound


def _frames(file: InputContainer, stream: VideoStream) -> Iterator[VideoFrame]:
    """Frames as they are decoded; what does not decode is passed over."""
    for packet in file.demux(stream):
        try:
            decoded = packet.decode()
        except FFmpegError:
            continue
        yield from decoded  # not within: Python ends open readers when names are gone already


def _words(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error) or type(error).__name__


@dataclass(frozen=True)
class Video:
    """The frames `first` up to `stop` of a file. One decoder is kept open; it starts over only to go back."""

    path: Path
    first: int = 0
    stop: int | None = None
    _kept: "OrderedDict[int, VideoFrame]" = field(default_factory=OrderedDict, repr=False)
    _open: dict[str, Any] = field(default_factory=dict, repr=False)
    _lock: Any = field(default_factory=RLock, repr=False)

    def __del__(self) -> None:
        """End the decoder's threads: PyAV's objects refer to one another, and would wait for the garbage collector."""
        if "file" in self._open:
            self._open["file"].close()

    @cached_property
    def facts(self) -> Facts:
        """Of the whole file. Raises BadInput."""
        return facts(self.path, *stamp(self.path))

    @property
    def length(self) -> int:
        """Number of frames."""
        return (len(self.facts.times) if self.stop is None else self.stop) - self.first

    @property
    def whole(self) -> bool:
        """Whether these are all frames of the file."""
        return self.length == len(self.facts.times)

    @property
    def reaches_end(self) -> bool:
        """Whether the last frame of the file is among these."""
        return self.first + self.length == len(self.facts.times)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a frame as shown."""
        given = self.facts
        return (
            (given.height, given.width) if given.quarter_turns % 2 else (given.width, given.height)
        )

    def times(self) -> Int64[np.ndarray, "t"]:
        """When each frame is shown, in the file's time base, the first one at 0 if it is a cut."""
        times = self.facts.times[self.first : self.first + self.length]
        return times if self.whole else times - times[0]

    def rgb(self, t: int) -> UInt8[np.ndarray, "h w 3"]:
        """Frame t as shown. Raises BadInput where it cannot be decoded, IndexError beyond the end."""
        return pixels(self.frame(t), self.facts)

    def frame(self, t: int) -> VideoFrame:
        """Frame t as decoded."""
        if not 0 <= t < self.length:
            raise IndexError(f"frame {t} of {self.length}")
        wanted = int(self.facts.times[self.first + t])
        with self._lock:
            if wanted not in self._kept:
                self._decode_to(wanted, t)
            self._kept.move_to_end(wanted)
            frame, given = self._kept[wanted], self.facts
        if (frame.width, frame.height) != (given.width, given.height):
            found, size = f"{frame.width}x{frame.height}", f"{given.width}x{given.height}"
            raise BadInput(self.path, f"frame {t}", found=found, expected=f"{size} as stated")
        return frame

    def _decode_to(self, wanted: int, t: int) -> None:
        try:
            for frame in self._from(wanted):
                if frame.pts is not None:
                    self._keep(frame)
                    if frame.pts >= wanted:
                        break
        except (FFmpegError, OSError) as error:
            self._open.clear()
            found = _words(error)
            raise BadInput(self.path, f"frame {t}", found=found, expected="a frame") from None
        if wanted not in self._kept:
            self._open.clear()
            raise BadInput(self.path, f"frame {t}", found="none", expected="one that decodes")

    def _keep(self, frame: VideoFrame) -> None:
        self._open["at"] = frame.pts
        self._kept[frame.pts] = frame
        self._kept.move_to_end(frame.pts)
        most = max(4, KEPT_BYTES // max(1, 3 * frame.width * frame.height // 2))
        while len(self._kept) > most:
            self._kept.popitem(last=False)

    def _from(self, wanted: int) -> Iterator[VideoFrame]:
        """Frames from the open decoder if it is on the way to the wanted one, else from the key frame before."""
        keys = self.facts.keys
        start = int(keys[max(0, int(np.searchsorted(keys, wanted, "right")) - 1)])
        at = self._open.get("at")
        if at is None or not start <= at < wanted:
            if "file" in self._open:
                self._open["file"].close()
            self._open.clear()
            file = av.open(str(self.path))
            stream = file.streams.video[0]
            if self.facts.broken:  # threads would fail on frames before the spoilt one
                stream.codec_context.thread_count = 1
            else:
                stream.thread_type = "AUTO"
            file.seek(start, stream=stream, backward=True)
            self._open.update(file=file, frames=_frames(file, stream), at=start)
        return self._open["frames"]


def matrix(given: Facts, frame: VideoFrame) -> Colorspace:
    """The color matrix of a frame."""
    assumed = Colorspace.ITU709 if given.height >= HIGH_DEFINITION else Colorspace.ITU601
    return NAMED.get(int(frame.colorspace), assumed)


def pixels(frame: VideoFrame, given: Facts) -> UInt8[np.ndarray, "h w 3"]:
    """A decoded frame as an upright RGB image."""
    # Of its own: a frame keeps the threads of the one that it makes itself for as long as it is kept.
    made = VideoReformatter().reformat(frame, format="rgb24", src_colorspace=matrix(given, frame))
    image = made.to_ndarray()
    return np.ascontiguousarray(np.rot90(image, given.quarter_turns))
