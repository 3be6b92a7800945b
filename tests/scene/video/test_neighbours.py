"""What one frame alone calls the table, and those before and after it do not, is no table there."""

from dataclasses import replace

import numpy as np
import pytest
import walks

from rpaug.core import geometry
from rpaug.scene.video import world
from rpaug.scene.video.instances import InstanceMap, Support, plane_depth
from rpaug.scene.video.video_scene import VideoScene

LENGTH, TABLE, ARM = 9, 2, 3
SHEET = (-0.2, 0.0), (-0.05, 0.15)  # metres: where the red sheet lies


def on_sheet(k: int) -> np.ndarray:
    """Pixels of frame `k` that show the sheet."""
    pose = walks.poses(LENGTH)[k]
    depth = plane_depth(walks.K(), pose, (walks.HEIGHT, walks.WIDTH), walks.LEVEL)
    points = geometry.transform(pose, geometry.unproject(depth, walks.K()))
    inside = [
        (low < points[..., i]) & (points[..., i] < high) for i, (low, high) in enumerate(SHEET)
    ]
    return inside[0] & inside[1]


def video(monkeypatch: pytest.MonkeyPatch, wrong: set[int], covers: set[int]) -> VideoScene:
    """A walk along a table with a sheet on it in the frames `covers`, that the frames `wrong` call the table."""
    none = np.zeros(0, np.int32)
    support = Support(frozenset([TABLE]), np.zeros(3, np.float32))
    found = InstanceMap(0.02, none.astype(np.int64), none, 2, (support,), walks.LEVEL)
    track = walks.poses(LENGTH)
    shape = walks.HEIGHT, walks.WIDTH
    depths = tuple(
        np.maximum(plane_depth(walks.K(), pose, shape, walks.LEVEL), 0.1).astype(np.float32)
        for pose in track
    )
    model = replace(walks.model(LENGTH), cam_to_world=track)

    def alone(_: VideoScene, k: int) -> np.ndarray:
        sheet = on_sheet(k) & (k in covers and k not in wrong)
        return np.where(sheet, ARM, TABLE).astype(np.uint16)

    monkeypatch.setattr(VideoScene, "_tell_alone", alone)
    return VideoScene(walks.walk(LENGTH), model, depths, found, world.RELATIVE)


@pytest.mark.parametrize("wrong", [{4}, {4, 5}, {0}, {8}], ids=str)
def test_frames_that_take_an_arm_for_the_table_are_mended_by_those_beside(
    monkeypatch: pytest.MonkeyPatch, wrong: set[int]
) -> None:
    made = video(monkeypatch, wrong, {*range(LENGTH)})
    for k in wrong:
        sheet = on_sheet(k)
        assert sheet.sum() > 100
        told = made._tell(k)
        assert (told[sheet] == ARM).mean() > 0.9
        assert (told[~sheet] == TABLE).mean() > 0.98


def test_what_leaves_or_comes_uncovers_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    made = video(monkeypatch, set(), {0, 1, 2, 3})
    for k in range(LENGTH):
        told, sheet = made._tell(k), on_sheet(k)
        assert (told[sheet] == (ARM if k < 4 else TABLE)).mean() > 0.95


def test_one_frame_alone_that_shows_something_is_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    made = video(monkeypatch, set(), {4})
    assert (made._tell(4)[on_sheet(4)] == ARM).all()
    assert (made._tell(3) == TABLE).all()
