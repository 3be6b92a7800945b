"""The light that new things are shown in is as bright as the whitest recorded thing needs, and no darker than 1."""

import numpy as np
import pytest
from analytic import BALL, BALL_RADIUS, BOX, BOX_HIGH, ball_at, scene, seen_by

from rpaug.core import geometry
from rpaug.scene.lighting import ambience, irradiance

EYES = {"front": (0.0, -1.3, 0.5), "side": (0.9, -0.9, 0.4)}
LENGTH = 2
SIDES = 0.6  # of the light on level faces


@pytest.mark.parametrize(("bright", "least", "most"), [(0.8, 1.0, 1.0), (1.2, 1.1, 1.2)])
def test_no_thing_reflects_more_than_falls_on_it(bright: float, least: float, most: float) -> None:
    bare = scene(EYES, length=LENGTH)

    def lit(name, t, rgb, depth, ids):  # type: ignore[no-untyped-def]
        points = geometry.world_points(depth.astype(float), bare.cameras[name], t)
        up = np.where(ids == BALL, (points[..., 2] - ball_at(t, LENGTH)[2]) / BALL_RADIUS, 1.0)
        up = np.where((ids == BOX) & (points[..., 2] < BOX_HIGH[2] - 0.01), 0.0, up)
        albedo = np.select([ids == BOX, ids == BALL], [0.5, 0.95], 0.3)
        color = np.clip(bright * albedo * (SIDES + (1 - SIDES) * up), 0, 1)
        return np.rint(255 * color[..., None].repeat(3, -1)).astype(np.uint8), depth, ids

    light = np.array(ambience.estimate(seen_by(bare, lit).episode).light)
    level, side = irradiance.shading(
        irradiance.basis(np.array([[0, 0, 1], [0, -1, 0]], np.float32)), light
    )
    assert least - 1e-3 < level < most + 1e-3  # the lowest light that explains the white ball
    assert side / level == pytest.approx(SIDES, abs=0.06)
