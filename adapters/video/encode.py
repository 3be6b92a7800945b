"""Writing a video like another: its codec, size, rate, times and rotation, with some frames new.

Groups of pictures that no edit touched keep their packets (`shared.splice`). In the others what no edit touched is
taken from the recorded frame as decoded, not through RGB and back: in frames that changed, too, where only the samples
of changed pixels are new, whatever their bits and however many pixels share a color sample. Sound of a whole video is
copied as it is.
"""

from collections.abc import Callable
from itertools import chain, islice
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.error import FFmpegError
from av.video.frame import VideoFrame
from av.video.reformatter import VideoReformatter
from jaxtyping import Bool, UInt8
from rpaug_adapters.shared import splice
from rpaug_adapters.shared.video import HEVC_LEAST, X264, open_encoders, planar, samples
from rpaug_adapters.video import boxes
from rpaug_adapters.video.stream import Facts, Video, matrix

from rpaug import Unsupported

FINEST = {"flags": "+qscale", "global_quality": "236"}  # quantised by 2, in units of 1/118
ENCODERS = {
    "h264": (
        "libx264",
        {"crf": "11.5", "preset": "faster", "x264-params": X264},
    ),
    "hevc": ("libx265", {"crf": "12", "preset": "medium", "x265-params": "log-level=error"}),
    "mpeg4": ("mpeg4", FINEST),
    "mjpeg": ("mjpeg", FINEST),
    "vp9": ("libvpx-vp9", {"crf": "12", "b": "0"}),
    "av1": ("libsvtav1", {"crf": "12"}),
    "ffv1": ("ffv1", {}),
}  # by the name of the decoder: near lossless (docs/why/video.md)
B_DEPTH = 2  # frames that these encoders store before one that is shown before them
IN_ORDER = {
    "h264": {"bf": "0"},
    "hevc": {"x265-params": "log-level=error:bframes=0"},
}  # where the recorded frames are stored as shown
FEW = 5  # frames: x265 4.2 makes up times of storage for fewer with B frames
Seen = Callable[[int], UInt8[np.ndarray, "h w 3"]]


def write(target: Path, video: Video, shown: Seen) -> tuple[str, ...]:
    """Write `shown` into a file like the video's: packets stay from each key frame to the next change, and in what is
    encoded anew the samples of unchanged pixels are as decoded. Returns what could not be had, in words.

    Raises Unsupported where nothing here encodes the codec.
    """
    given = video.facts
    codec = given.codec.removeprefix("lib").replace("dav1d", "av1").replace("vpx-", "")
    if codec not in ENCODERS or ENCODERS[codec][0] not in av.codecs_available:
        known = ", ".join(ENCODERS)
        raise Unsupported(f"{video.path}: {given.codec} cannot be written; these can: {known}")
    if codec == "hevc" and min(given.width, given.height) < HEVC_LEAST:
        size = f"{given.width}x{given.height}"
        raise Unsupported(
            f"{video.path}: {size} in HEVC; its encoder takes {HEVC_LEAST} pixels a side or more"
        )
    name, usual = ENCODERS[codec]
    in_order = usual | IN_ORDER.get(codec, {})
    early = splice.stored(video.path).early

    def new(t: int) -> Any:
        image = shown(t - video.first)
        return None if np.array_equal(image, video.rgb(t - video.first)) else image

    def encode(frames: splice.New, path: Path) -> None:
        timescale = {"video_track_timescale": str(given.time_base.denominator)}
        mp4 = path.suffix in splice.MP4
        first = list(islice(frames, FEW))
        options = usual if early >= B_DEPTH and len(first) == FEW else in_order
        with (
            av.open(str(video.path)) as source,
            av.open(str(path), "w", options=timescale if mp4 else {}) as made,
        ):
            stream: Any = made.add_stream(name, rate=given.rate, options=options)
            _like(stream, source.streams.video[0], given)
            open_encoders(made)
            _pictures(made, stream, video, chain(first, frames))

    begin = int(video.times()[0])
    span = range(video.first, video.first + video.length)
    try:
        said = splice.write(video.path, span, new, encode, target, begin=begin, sound=video.whole)
    except FFmpegError as error:
        if getattr(error, "errno", None) == 28:  # a full disk is told as one
            raise OSError(28, "No space left on device") from None
        raise Unsupported(f"{video.path}: {given.codec} cannot be written: {error}") from None
    if target.suffix in splice.MP4:
        boxes.copy_matrix(video.path, target)
    return said


def _like(stream: Any, recorded: Any, given: Facts) -> None:
    context, before = stream.codec_context, recorded.codec_context
    context.width, context.height, context.pix_fmt = given.width, given.height, given.pixels
    context.time_base = given.time_base
    stream.time_base = given.time_base
    context.thread_count = 1  # the same pixels give the same bytes, whatever the machine
    for name in ("color_range", "color_primaries", "color_trc", "colorspace"):
        setattr(context, name, getattr(before, name))
    if before.sample_aspect_ratio:
        context.sample_aspect_ratio = before.sample_aspect_ratio


def _pictures(made: Any, stream: Any, video: Video, frames: splice.New) -> None:
    times = video.times()
    gaps = np.append(np.diff(times), int(np.median(np.diff(times))) if len(times) > 1 else 1)
    for number, image in frames:
        t = number - video.first
        frame = changed(video, t, video.rgb(t) if image is None else image)
        frame.pts, frame.time_base, frame.duration = (
            int(times[t]),
            video.facts.time_base,
            int(gaps[t]),
        )
        frame.pict_type = 0  # the encoder's to choose
        for packet in stream.encode(frame):
            made.mux(packet)
    for packet in stream.encode():
        made.mux(packet)


def changed(video: Video, t: int, image: UInt8[np.ndarray, "h w 3"]) -> VideoFrame:
    """Frame t of the video, showing the image."""
    given, recorded = video.facts, video.frame(t)
    apart = image != video.rgb(t)
    differs = np.rot90(apart[..., 0] | apart[..., 1] | apart[..., 2], -given.quarter_turns)
    lay = np.ascontiguousarray(np.rot90(image, -given.quarter_turns))
    new = VideoReformatter().reformat(
        VideoFrame.from_ndarray(lay, format="rgb24"),
        format=recorded.format.name,
        dst_colorspace=matrix(given, recorded),
    )
    new.color_range = recorded.color_range
    if planar(recorded):
        for old, plane in zip(recorded.planes, new.planes, strict=True):
            kept = _kept(~differs, plane.width, plane.height)
            kind = np.uint8 if recorded.format.components[0].bits == 8 else np.uint16
            before, after = (samples(one, kind) for one in (old, plane))
            np.copyto(after, before, where=kept)
    elif not differs.any():
        new = recorded
    return new


def _kept(kept: Bool[np.ndarray, "h w"], width: int, height: int) -> Bool[np.ndarray, "y x"]:
    """Which samples of a plane show only such pixels; a plane of color may have one for several pixels."""
    by = tuple(-(-full // part) for full, part in zip(kept.shape, (height, width), strict=True))
    edge = [
        (0, part * n - full) for full, part, n in zip(kept.shape, (height, width), by, strict=True)
    ]
    whole = np.pad(kept, edge, constant_values=True)
    return whole.reshape(height, by[0], width, by[1]).all((1, 3))
