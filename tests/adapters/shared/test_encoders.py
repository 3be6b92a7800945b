"""Encoders leave the process as they found it, and come to the same bytes each time."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import videos
from rpaug_adapters.video import encode
from rpaug_adapters.video.stream import Video

ENCODED = """
import os, sys
import av
import numpy as np
from rpaug_adapters.shared import video
os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # whatever the process that started it is
with av.open(sys.argv[1], "w") as made:
    stream = made.add_stream(video.ENCODERS["av1"], rate=10)
    stream.width = stream.height = 64
    stream.pix_fmt = "yuv420p"
    video.open_encoders(made)
    for t in range(4):
        made.mux(stream.encode(av.VideoFrame.from_ndarray(np.full((64, 64, 3), t, np.uint8))))
    made.mux(stream.encode())
    print({os.sched_getscheduler(int(thread)) for thread in os.listdir("/proc/self/task")})
"""


@pytest.mark.skipif(not hasattr(os, "sched_getscheduler"), reason="Linux schedules by policy")
def test_encoding_av1_leaves_no_thread_real_time(tmp_path: Path) -> None:
    command = [sys.executable, "-c", ENCODED, str(tmp_path / "made.mp4")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == f"{{{os.SCHED_OTHER}}}"
    assert (tmp_path / "made.mp4").stat().st_size > 0


@pytest.mark.parametrize("width", [96, 128, 320])
def test_the_same_frames_come_to_the_same_bytes(width: int, tmp_path: Path) -> None:
    """However often: x264's code for AVX-512 read memory that nobody had written."""
    source, rng = videos.write(tmp_path / "in.mp4", 6, size=(width, 64)), np.random.default_rng(0)
    noise = rng.integers(-30, 30, (6, 64, width, 3))
    made = set()
    for number in range(12):
        video, path = Video(source), tmp_path / f"{number}.mp4"
        encode.write(path, video, lambda t, video=video: lighter(video, t, noise))
        made.add(path.read_bytes())
        used = [rng.bytes(100_000 + number) for _ in range(20)]  # other contents of free memory
        del used
    assert len(made) == 1


def lighter(video: Video, t: int, noise: np.ndarray) -> np.ndarray:
    return np.clip(video.rgb(t).astype(int) + noise[t], 0, 255).astype(np.uint8)
