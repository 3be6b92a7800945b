"""Sampled frames lie where their cameras stood when they were taken."""

from dataclasses import replace

import numpy as np
from rolling import demonstration

from rpaug.core import geometry
from rpaug.scene.sampled_frames import look


def test_a_moving_cameras_pixels_are_lifted_from_where_it_stood_by_then() -> None:
    episode = demonstration(6)
    name, view = next(iter(episode.views.items()))
    way = np.tile(np.eye(4), (6, 1, 1))
    way[:, 0, 3] = 0.1 * np.arange(6)
    camera = replace(view.camera, cam_to_world=way @ view.camera.cam_to_world)
    moving = replace(view, camera=camera)
    sampled = look(replace(episode, views={name: moving}), [1, 4])
    assert sampled.frames.tolist() == [1, 4]
    assert view.depth is not None
    for s, t in enumerate([1, 4]):
        assert np.array_equal(sampled.cam_to_world[s, 0], camera.cam_to_world[t])
        true = geometry.world_points(view.depth(t), camera, t)
        known = sampled.depth[s, 0] > 0
        assert known.any()
        assert np.allclose(sampled.points[s, 0][known], true[known], atol=1e-5)
