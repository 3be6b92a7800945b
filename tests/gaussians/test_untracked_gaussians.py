"""What moves in an unknown way is shown where the camera saw it, wherever that stood by then."""

from dataclasses import replace

import boxes
import numpy as np

from rpaug.core import geometry
from rpaug.core.types import ProxyGeometry, Scene
from rpaug.gaussians import untracked_gaussians


def test_they_lie_where_the_moving_camera_saw_them(placed: tuple[boxes.World, Scene]) -> None:
    _, scene = placed
    name, view = next((name, one) for name, one in scene.episode.views.items() if one.camera.fixed)
    assert view.depth is not None
    assert view.ids is not None
    way = np.eye(4) + np.zeros((scene.episode.length, 1, 1))
    way[:, 0, 3] = 0.1 * np.arange(scene.episode.length)
    eye = replace(view.camera, cam_to_world=way @ view.camera.cam_to_world)
    moving = replace(view, camera=eye, proxy=ProxyGeometry(eye, None))
    body = next(body for body in scene.bodies if boxes.OTHER in body.instance_ids)
    loose = replace(
        scene,
        episode=replace(scene.episode, views={**scene.episode.views, name: moving}),
        bodies=(replace(body, motion="unknown"),),
    )
    t = 5
    made = untracked_gaussians.of(loose, name, t)
    assert made is not None
    points = geometry.transform(geometry.inverse(eye.cam_to_world[t]), made.means.astype(float))
    right, down = np.rint((points / points[:, 2:] @ eye.K.T)[:, :2]).astype(int).T
    assert len(made) == np.isin(view.ids(t), list(body.instance_ids)).sum()
    assert np.isin(view.ids(t)[down, right], list(body.instance_ids)).all()
    assert np.allclose(
        points[:, 2], untracked_gaussians.NEARER * view.depth(t)[down, right], rtol=1e-4
    )
