"""Cut-outs of recorded views around one thing: the same whatever the scene's unit is."""

from dataclasses import replace

import numpy as np
import torch
from analytic import BOX, TABLE, scene

from rpaug.core.types import Body, Scene
from rpaug.gaussians import windows
from rpaug.gaussians.gaussians import LiftedImage, joined, lifted

EYES = {"front": (0.0, -0.8, 0.7), "side": (0.8, -0.2, 0.8)}


def in_unit(unit: float) -> Scene:
    """Two still views with one Gaussian a pixel; lengths times `unit`."""
    plain = scene(EYES, length=1, ball=False)
    views, parts = {}, []
    for name, view in plain.episode.views.items():
        pose = view.camera.cam_to_world.copy()
        pose[:, :3, 3] *= unit
        depth = (unit * view.depth(0)).astype(np.float32)
        camera = replace(view.camera, cam_to_world=pose)
        views[name] = replace(view, camera=camera, depth=lambda _, d=depth: d)
        parts.append(
            lifted(LiftedImage(view.rgb(0), depth, view.ids(0), camera.K, pose[0], depth > 0))
        )
    body = Body(frozenset({TABLE, BOX}), np.eye(4)[None], "static")
    return replace(
        plain,
        episode=replace(plain.episode, views=views),
        cameras={name: view.camera for name, view in views.items()},
        bodies=(body,),
        gaussians=joined(parts),
    )


def test_things_a_millimetre_from_the_lens_are_seen() -> None:
    """A camera 1 m away stands at 1 mm where a scene is given in kilometres: before a near plane of 1 cm."""
    shown = []
    for unit in (1.0, 1e-3):
        small = in_unit(unit)
        assert small.gaussians is not None
        rows = np.flatnonzero(small.gaussians.ids == BOX)
        (first, _) = windows.windows(small, frozenset({BOX}), rows, 1)
        colors = torch.from_numpy(windows.colors_of(small.gaussians.sh[rows]))
        image = windows.render(first, rows, colors).numpy().reshape(first.recorded.shape)
        assert np.abs(image - first.recorded)[first.mask].mean() < 0.05
        shown.append(image)
    np.testing.assert_allclose(shown[0], shown[1], atol=0.02)
