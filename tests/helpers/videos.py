"""Small videos made here: smooth pictures that name their frame, with key frames, rates and rotations as asked."""

import struct
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from rpaug_adapters.shared.video import open_encoders
from rpaug_adapters.video import boxes

WIDTH, HEIGHT = 96, 64


def picture(t: int, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """A picture of frame t: a smooth pattern, a bar of t/32 of the width, and a red block in one corner."""
    rng = np.random.default_rng(5)
    image = cv2.resize(rng.integers(60, 200, (4, 6, 3), np.uint8), (width, height))
    image[: height // 4, : max(2, width * (t + 1) // 32)] = 240
    image[-height // 4 :, : width // 6] = (200, 20, 20)
    return image


def write(
    path: Path,
    length: int = 12,
    *,
    codec: str = "libx264",
    times: Sequence[int] | None = None,
    gop: int = 5,
    sound: bool = False,
    size: tuple[int, int] = (WIDTH, HEIGHT),
    pixels: str = "yuv420p",
) -> Path:
    """A video at 30 frames a second, or with frames at `times` in units of 1/15360 s."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w", options={"video_track_timescale": "15360"}) as made:
        stream = made.add_stream(codec, rate=30)
        stream.width, stream.height = size
        stream.pix_fmt = pixels
        stream.codec_context.time_base = Fraction(1, 15360)
        stream.gop_size = gop
        stream.options = {"crf": "8"}
        heard = made.add_stream("aac", rate=48000) if sound else None
        open_encoders(made)
        for t in range(length):
            frame = av.VideoFrame.from_ndarray(picture(t, *size), format="rgb24")
            frame.time_base = stream.codec_context.time_base
            frame.pts = 512 * t if times is None else times[t]
            for packet in stream.encode(frame):
                made.mux(packet)
        for packet in stream.encode():
            made.mux(packet)
        if heard is not None:
            for k in range(length * 1600 // 1024):
                wave = np.sin(np.arange(1024) / 9).astype(np.float32)[None]
                noise = av.AudioFrame.from_ndarray(wave, format="fltp", layout="mono")
                noise.sample_rate, noise.pts = 48000, k * 1024
                for packet in heard.encode(noise):
                    made.mux(packet)
            for packet in heard.encode():
                made.mux(packet)
    return path


def turn(path: Path, matrix: tuple[int, int, int, int]) -> None:
    """Put a display matrix into an MP4's track header."""
    with path.open("r+b") as file:
        at = boxes._matrix_at(file)
        assert at is not None
        a, b, c, d = (value << 16 for value in matrix)
        file.seek(at)
        file.write(struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30))
