"""What shadows along a direction take of the light: the fast way says what the plain one says, bit for bit."""

import cv2
import numpy as np
import pytest
from jaxtyping import Bool, Float64

from rpaug.core.pixels import grown
from rpaug.scene.lighting import shadows
from rpaug.scene.placement.placing import hull

TABLE = shadows._SupportPlane(frozenset({1}), np.array([-0.4, -0.3]), 0.0, 0.01, (60, 80))


def look(rng: np.random.Generator, relative: bool, things: int) -> shadows._Look:
    """Uneven light, not known everywhere, and things that stand here and there."""
    light = rng.uniform(0, 255, TABLE.shape)
    light[rng.random(TABLE.shape) < 0.1] = np.nan
    places = rng.uniform((-0.3, -0.2, 0.0), (0.3, 0.2, 0.05), (things, 3))
    outlines = [at + rng.uniform(-0.03, 0.03, (12, 3)) for at in places]
    return shadows._Look(light, rng.random(TABLE.shape) < 0.05, [outlines], relative)


def cast(
    outlines: list[Float64[np.ndarray, "n 3"]], direction: Float64[np.ndarray, "3"]
) -> Bool[np.ndarray, "r c"]:
    mask = np.zeros(TABLE.shape, np.uint8)
    for points in outlines:
        corners = (hull(shadows._slid(points, direction)) - TABLE.origin) / TABLE.cell
        cv2.fillConvexPoly(mask, np.rint(16 * corners).astype(np.int32), 1, shift=4)
    return mask > 0


def plainly(looks: list[shadows._Look], direction: Float64[np.ndarray, "3"]) -> tuple[float, float]:
    """Over the whole table, thing by thing."""
    shades = [cast(one.outlines, direction) for one in looks]
    known = [~one.covered & ~np.isnan(one.light) for one in looks]
    bare = [
        seen & ~shade for one, shade, seen in zip(looks, shades, known, strict=True) if one.relative
    ]
    comes_and_goes = np.any(bare, 0) if bare else np.zeros(TABLE.shape, bool)
    offs, weights = [], []
    for one, shade, seen in zip(looks, shades, known, strict=True):
        use = seen & comes_and_goes if one.relative else seen
        sides = shade & use, grown(shade, shadows.BESIDE) & ~shade & use
        inside, beside = (np.log(np.maximum(one.light[side], 1)) for side in sides)
        if min(len(inside), len(beside)) >= shadows.FEW:
            error = np.hypot(*(side.std() / np.sqrt(len(side)) for side in (inside, beside)))
            offs.append(float(np.median(beside) - np.median(inside)))
            weights.append(1 / max(float(error), 1e-3) ** 2)
    if not offs:
        return 0.0, 0.0
    off = float(np.average(offs, weights=weights))
    return 1 - float(np.exp(-off)), off * float(np.sqrt(sum(weights)))


@pytest.mark.parametrize("up", [15, 40, 80])
@pytest.mark.parametrize("things", [1, 6])
def test_the_fast_way_says_what_the_plain_one_says(up: float, things: int) -> None:
    rng = np.random.default_rng(things)
    looks = [look(rng, relative, things) for relative in (False, True, True)]
    told = set()
    for heading in np.linspace(0, 2 * np.pi, 7):
        direction = shadows._towards(heading, np.deg2rad(up))
        found = shadows._contrast(looks, direction, TABLE)
        assert found == plainly(looks, direction)
        told.add(found)
    assert len(told) > 1
    assert shadows._contrast([], direction, TABLE) == (0.0, 0.0)
