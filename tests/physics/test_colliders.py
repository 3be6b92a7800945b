"""Distances to what stands still, and boxes between the frames they were recorded in."""

import numpy as np

from rpaug.core import geometry
from rpaug.physics.colliders import Boxes, still


def test_the_floor_lies_on_nodes_and_points_are_balls() -> None:
    point = np.array([[0.051, 0.049, 0.2]])
    found = still(np.zeros(3) - 0.013, np.full(3, 0.3), 0.01, level=0.0, points=point)
    heights = found.origin[2] + 0.01 * np.arange(found.distance.shape[2])
    assert np.abs(heights).min() < 1e-9
    assert ((found.distance[0, 0] < 0) == (heights < 1e-9)).all()
    i, j, n = np.rint((point[0] - found.origin) / 0.01).astype(int)
    assert found.distance[i, j, n] < 0
    assert found.distance[i + 3, j, n] > 0
    up = found.normals[i, j, n + 1]
    assert up[2] > 0.8


def test_boxes_go_evenly_between_frames_and_stop_at_the_last() -> None:
    track = np.stack([np.eye(4), geometry.rigid(np.array([0, 0, 0.5]), np.array([0.1, 0, 0]))])
    boxes = Boxes.of([track], [np.eye(4)], [np.full(3, 0.01)], [0.0], 0.1)
    half = boxes(0.05)[0]
    np.testing.assert_allclose(half[:3], [0.05, 0, 0], atol=1e-12)
    np.testing.assert_allclose(
        half[3:12].reshape(3, 3), geometry.rotation(np.array([0, 0, 0.25])), atol=1e-9
    )
    np.testing.assert_allclose(half[16:22], [1.0, 0, 0, 0, 0, 5.0], atol=1e-9)
    assert (boxes(0.2)[0, 16:22] == 0).all()
    np.testing.assert_allclose(boxes(0.2)[0, :3], [0.1, 0, 0], atol=1e-12)
