"""A moved camera shows, in color, depth and ids of every frame, what truly lies there."""

import numpy as np
import pytest
from analytic import EYES, LENGTH, ball_at, scene, shoot

from rpaug.operators.camera_pose import CameraPose
from rpaug.pipeline.contracts import shown

ALIKE = (
    0.95  # of the pixels, and of their ids: outlines are off by a pixel, and some places nobody saw
)


@pytest.mark.parametrize("name", ["front", "wrist"])
def test_every_image_of_a_moved_camera_is_from_where_it_is_now(name: str) -> None:
    """`wrist` moves while it records."""
    recorded = scene(EYES, moving="wrist")
    edit = {name: {"turn": [0.0, 0.04, 0.03], "shift": [0.03, 0.01, 0.05]}}
    moved = CameraPose(camera=name).apply(recorded, edit)
    camera, view = moved.cameras[name], shown(moved).views[name]
    before = recorded.episode.views[name]
    assert view.depth is not None
    assert view.ids is not None
    for t in (0, LENGTH - 1):
        place = camera.cam_to_world[t]
        rgb, depth, ids = shoot(camera.K, place, camera.width, camera.height, ball_at(t, LENGTH))
        assert np.abs(view.depth(t) - depth)[view.ids(t) == ids].mean() < 0.004  # metres
        assert (np.abs(view.depth(t) - depth) < 0.01).mean() > ALIKE
        assert (view.ids(t) == ids).mean() > ALIKE
        assert (np.abs(view.rgb(t).astype(int) - rgb).max(-1) < 40).mean() > ALIKE
        assert before.depth is not None
        assert (np.abs(before.depth(t) - depth) < 0.01).mean() < 0.5  # the camera did move
