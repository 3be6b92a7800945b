"""4D Gaussians start on the surface that was seen, from where the images were truly taken."""

from dataclasses import replace

import boxes
import numpy as np

from rpaug.core.types import Scene
from rpaug.gaussians import seeds4


def test_they_start_where_the_corrected_cameras_saw_the_surface(
    placed: tuple[boxes.World, Scene],
) -> None:
    _, scene = placed
    shift = np.array([0.02, -0.01, 0.03])
    moved = np.tile(np.eye(4), (scene.episode.length, 1, 1))
    moved[:, :3, 3] = shift
    corrected = replace(scene, pose_correction=dict.fromkeys(scene.episode.views, moved))
    ids, times = frozenset({boxes.OTHER}), (0, 3)
    plain, made = (seeds4.seeds(one, ids, times) for one in (scene, corrected))
    before, after = (one.means[:, :3].astype(float) + one.origin for one in (plain, made))
    assert np.allclose(np.median(after, 0) - np.median(before, 0), shift, atol=2e-3)
