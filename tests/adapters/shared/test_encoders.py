"""Encoders leave the process as they found it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

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
