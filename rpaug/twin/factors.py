"""What can be changed between two recordings of one motion: COLOSSEUM's factors, from a given or a drawn value.

A factor is a function of the look; it never touches the world or the motion. Add one here and it
can be recorded.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from rpaug.errors import RpaugError
from rpaug.twin.cameras import BUMPED
from rpaug.twin.look import Bump, Look
from rpaug.twin.world import Vector, World

BRIGHTEST_LAMP = 0.5  # COLOSSEUM draws the lamps' diffuse colour from U[0, 0.5]^3
FURTHEST_SHIFT = 0.1  # metres, each way along each axis
FURTHEST_TURN = 0.05  # radians
_DARKEST_TINT = 0.1  # darker ones leave too little light to measure an error by


def object_color(
    look: Look, world: World, target: str, value: Any, rng: np.random.Generator
) -> Look:
    """Another tint (r, g, b in 0..1) for the part `target`."""
    return replace(look, tints={**look.tints, target: _vector(value, rng, _DARKEST_TINT, 1.0)})


def light_color(
    look: Look, world: World, target: str, value: Any, rng: np.random.Generator
) -> Look:
    """Another diffuse colour (r, g, b) for every lamp; the ambient light follows."""
    return replace(look, light=_vector(value, rng, 0.0, BRIGHTEST_LAMP))


def camera_pose(
    look: Look, world: World, target: str, value: Any, rng: np.random.Generator
) -> Look:
    """Bumped front and shoulder cameras; a value maps camera names to a `Bump`."""
    drawn = {
        name: Bump(
            turn=_vector(None, rng, -FURTHEST_TURN, FURTHEST_TURN),
            shift=_vector(None, rng, -FURTHEST_SHIFT, FURTHEST_SHIFT),
        )
        for name in BUMPED
    }
    return replace(look, bumps={**look.bumps, **(drawn if value is None else value)})


FACTORS: Mapping[str, Callable[[Look, World, str, Any, np.random.Generator], Look]] = {
    "object_color": object_color,
    "light_color": light_color,
    "camera_pose": camera_pose,
}


def change(
    factor: str, look: Look, world: World, target: str, value: Any, rng: np.random.Generator
) -> Look:
    """`look` with one factor changed to `value`, or to a draw if that is None. Raises RpaugError for unknown names."""
    if factor not in FACTORS:
        raise RpaugError(f"no factor is called {factor!r}; there are: {', '.join(FACTORS)}")
    if target not in world.handles:
        raise RpaugError(f"no part is called {target!r}; there are: {', '.join(world.handles)}")
    return FACTORS[factor](look, world, target, value, rng)


def _vector(value: Any, rng: np.random.Generator, low: float, high: float) -> Vector:
    x, y, z = rng.uniform(low, high, 3) if value is None else value
    return float(x), float(y), float(z)
