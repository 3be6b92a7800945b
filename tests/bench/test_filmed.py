"""The large recording: what is written in runs, side by side, is what was made; a camera that moves sees one table."""

import numpy as np

from rpaug.core import geometry, registry
from tools.bench.harness import filmed

SIZE = (5, 48, 32)


def test_runs_of_frames_come_together(tmp_path):
    made = registry.read(filmed.written(tmp_path / "a", *SIZE, moves=True, processes=2), None)
    truth = filmed.recording(*SIZE, moves=True)
    assert made.length == truth.length == 5
    view, true = made.views["front"], truth.views["front"]
    assert not view.camera.fixed
    np.testing.assert_allclose(view.camera.cam_to_world, true.camera.cam_to_world, atol=1e-12)
    for t in range(5):
        np.testing.assert_array_equal(view.rgb(t), true.rgb(t))
        np.testing.assert_array_equal(view.ids(t), true.ids(t))
        np.testing.assert_allclose(view.depth(t), true.depth(t), atol=1e-5)
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_the_table_lies_at_the_floor_of_the_world_from_everywhere():
    for moves in (False, True):
        view = filmed.recording(*SIZE, moves=moves).views["front"]
        for t in (0, 4):
            rows, columns = np.nonzero(view.ids(t) == 1)
            rays = geometry.rays(columns, rows, view.camera.K)
            points = geometry.transform(
                view.camera.cam_to_world[t], rays * view.depth(t)[rows, columns, None]
            )
            np.testing.assert_allclose(points[:, 2], 0, atol=1e-6)


def test_a_ball_that_lies_has_one_middle_from_everywhere():
    view = filmed.recording(*SIZE, moves=True).views["front"]
    for t in (0, 4):
        rows, columns = np.nonzero(view.ids(t) == 3)
        rays = geometry.rays(columns, rows, view.camera.K)
        local = rays * view.depth(t)[rows, columns, None]
        points = geometry.transform(view.camera.cam_to_world[t], local)
        middle = filmed.balls(t, 5)[3][:3]
        np.testing.assert_allclose(np.linalg.norm(points - middle, axis=1), filmed.LYING, atol=1e-5)
