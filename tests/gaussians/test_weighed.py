"""Edited things in a video's Gaussians: a pixel is theirs where they are most of its light."""

import numpy as np

from rpaug.core.types import Gaussians
from rpaug.gaussians import ids_by_weight
from rpaug.gaussians.gaussian_view import SHARP
from rpaug.render.splat import Rasteriser, Splats, View

ONE, OTHER = 5, 6


def through_one_another(count: int = 4000) -> Gaussians:
    """A plane a metre ahead, ONE on its left and OTHER on its right, whose Gaussians lie a little before or behind."""
    rng = np.random.default_rng(0)
    means = rng.uniform((-0.5, -0.5, 0.97), (0.5, 0.5, 1.03), (count, 3)).astype(np.float32)
    ids = np.where(means[:, 0] < 0, ONE, OTHER)
    stray = rng.random(count) < 0.15  # named wrongly
    return Gaussians(
        means=means,
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        scales=np.full((count, 3), 0.03, np.float32),
        opacities=np.full(count, 0.3, np.float32),
        sh=np.zeros((count, 1, 3), np.float32),
        ids=np.where(stray, ONE + OTHER - ids, ids).astype(np.int32),
    )


def test_what_makes_up_most_of_the_light_is_what_a_pixel_shows() -> None:
    cloud = through_one_another()
    K = np.array([[64.0, 0, 31.5], [0, 64, 31.5], [0, 0, 1]])
    splats = Splats.of(cloud).with_features(ids_by_weight.marks(cloud.ids, [ONE]))
    drawn = Rasteriser(SHARP).forward(splats, View(K, np.eye(4), 64, 64))
    surface = np.where(drawn.surface_index >= 0, cloud.ids[drawn.surface_index], 0)
    named = ids_by_weight.named(drawn, surface, [ONE])
    left = np.broadcast_to(np.arange(64) < 31, (64, 64))
    inside = (np.abs(np.arange(64) - 31.5) > 2) & (np.abs(np.arange(64) - 31.5) < 26)
    inside = inside[None, :] & (np.abs(np.arange(64) - 31.5) < 26)[:, None]
    assert ((named == ONE) == left)[inside].mean() > 0.99
    assert ((surface == ONE) == left)[inside].mean() < 0.95
    assert set(np.unique(named[(surface == ONE) & (named != ONE)])) <= {0}
