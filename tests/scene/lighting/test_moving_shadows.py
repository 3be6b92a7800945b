"""The lamp told by the shadow of what moves: no thing that stands casts one here."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import BALL, BALL_RADIUS, TABLE, ball_at, scene, seen_by

from rpaug.core import geometry
from rpaug.core.types import Body, Scene
from rpaug.scene.lighting import shadows

EYES = {"front": (0.0, -1.3, 1.2), "side": (0.9, -0.9, 1.2)}
LENGTH = 4
TAKEN = 0.3  # of the light


def rolling(lamp: np.ndarray, taken: float) -> Scene:
    """The ball rolls over a patterned table under one lamp, which it keeps `taken` of the light from."""
    bare = scene(EYES, length=LENGTH)

    def shaded(name, t, rgb, depth, ids):  # type: ignore[no-untyped-def]
        points = geometry.world_points(depth.astype(float), bare.cameras[name], t)
        way = ball_at(t, LENGTH) - points
        beside = np.linalg.norm(way - (way @ lamp)[..., None] * lamp, axis=-1)
        dark = (ids == TABLE) & (beside < BALL_RADIUS)
        return np.where(dark[..., None], (1 - taken) * rgb, rgb).astype(np.uint8), depth, ids

    rolls = np.tile(np.eye(4), (LENGTH, 1, 1))
    rolls[:, :3, 3] = [ball_at(t, LENGTH) - ball_at(0, LENGTH) for t in range(LENGTH)]
    ball = Body(frozenset({BALL}), rolls, "aligned")
    bodies = (*(one for one in bare.bodies if BALL not in one.instance_ids), ball)
    return replace(seen_by(bare, shaded), bodies=bodies, roles={"table": frozenset({TABLE})})


@pytest.mark.parametrize("heading", [2.4, -0.8])
def test_a_shadow_that_comes_and_goes_tells_the_lamp(heading: float) -> None:
    lamp = np.array([0.8 * np.cos(heading), 0.8 * np.sin(heading), 0.6])
    recorded = rolling(lamp, TAKEN)
    ((*direction, share),) = shadows.of_table(recorded)
    assert np.dot(direction, lamp) > np.cos(0.06)
    assert share == pytest.approx(TAKEN, abs=0.05)
    whole = shadows.lamps(
        recorded
    )  # its things are lit from nowhere: another lamp may be told beside this one
    assert isinstance(whole, dict)
    assert (np.array(whole["directions"]) @ lamp).max() > np.cos(0.06)


def test_where_nothing_is_darker_there_is_no_lamp() -> None:
    assert shadows.lamps(rolling(np.array([0.0, 0.6, 0.8]), 0.0)) == []
