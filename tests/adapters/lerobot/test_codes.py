"""Depth as LeRobot films it, in codes of twelve bits: read and written code by code."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pyarrow", reason="the extra lerobot is not installed")

import lerobot_samples
from hypothesis import given
from hypothesis import strategies as st
from lerobot_samples import DEPTH, episode, filmed_depth
from rpaug_adapters.lerobot import LeRobot, codes, tables
from rpaug_adapters.shared import video

from rpaug import BadInput


@pytest.fixture
def filmed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for side in ("HEIGHT", "WIDTH"):
        monkeypatch.setattr(lerobot_samples, side, video.HEVC_LEAST)
    return filmed_depth(tmp_path / "filmed")


@pytest.mark.parametrize("more", [(8, 0), (0, 8), (8, 8)], ids=["width", "height", "both"])
def test_a_film_of_another_size_than_the_color_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, more: tuple[int, int]
) -> None:
    """Along either side alone: a pixel of it would mean another ray."""
    for side in ("HEIGHT", "WIDTH"):
        monkeypatch.setattr(lerobot_samples, side, video.HEVC_LEAST)
    root = filmed_depth(tmp_path / "filmed", more)
    with pytest.raises(BadInput, match=r"another size.*as the color"):
        LeRobot().read(root, "toy/train/0")


def stored(root: Path, key: str) -> list[np.ndarray]:
    span = LeRobot().read(root, key).source.spans[DEPTH]
    frames = video.Frames(span, video.CODES)
    return [frames(t) for t in range(span.length)]


def test_filmed_depth_is_read_and_written_code_by_code(filmed: Path, tmp_path: Path) -> None:
    adapter, out, key = LeRobot(), tmp_path / "out", "toy/train/1"
    read, true = adapter.read(filmed, key), episode(1, 4)
    depth = read.views["front"].depth
    step = np.log(4.0 / 1.2) / codes.MOST * 4  # metres, where steps are longest
    assert np.abs(depth(2) - true.views["front"].depth(2))[8:].max() < step
    assert not depth(2)[:8, :8].any()
    nearer = depth(1).copy()
    nearer[20:30, 20:30] = 0.5
    view = replace(read.views["front"], depth=lambda t: nearer if t == 1 else depth(t))
    adapter.write(replace(read, views={**read.views, "front": view}), out, "toy/train/0", dict)
    adapter.write(read, out, "toy/train/1", dict)
    adapter.finish(filmed, out)
    before, edited, kept = stored(filmed, key), stored(out, "toy/train/0"), stored(out, key)
    for t in range(4):
        assert np.array_equal(kept[t], before[t])
        differs = edited[t] != before[t]
        assert not differs[:20].any()
        assert differs.sum() == (100 if t == 1 else 0)
    assert np.abs(adapter.read(out, "toy/train/0").views["front"].depth(1) - nearer).max() < step
    least = json.loads((out / "toy/meta/stats.json").read_text())[DEPTH]["q50"]
    assert 500 < least[0][0][0] < 2000  # millimetres, as it was recorded


@given(
    low=st.floats(0, 1),
    reach=st.floats(0.5, 50),
    shift=st.floats(0.01, 5),
    use_log=st.booleans(),
)
def test_codes_of_depth_come_back(low: float, reach: float, shift: float, use_log: bool) -> None:
    scale = codes.Scale(low, low + reach, shift, use_log)
    every = np.arange(1, codes.MOST + 1, dtype=np.uint16)[None]
    assert np.array_equal(scale.codes(scale.metres(every)), every)
    assert scale.codes(np.zeros((1, 1), np.float32)) == 0


def test_depth_codes_that_mean_nothing_are_refused(filmed: Path) -> None:
    path = filmed / "toy" / tables.INFO
    given = json.loads(path.read_text())
    given["features"][DEPTH]["info"]["video.depth_max"] = 0.1
    path.write_text(json.dumps(given))
    with pytest.raises(BadInput, match="depths that rise"):
        LeRobot().read(filmed, "toy/train/0")
