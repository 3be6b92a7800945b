"""What can be changed between two recordings of one motion: COLOSSEUM's factors, from a given or a drawn value.

A factor is a function of the look and of part names; it never touches the world or the motion. Add
one here and it can be recorded.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rpaug.core.errors import RpaugError
from rpaug.twin import textures
from rpaug.twin.cameras import BUMPED
from rpaug.twin.covers import Cover
from rpaug.twin.look import FINISHES, Bump, Look
from rpaug.twin.staging import StagedTask
from rpaug.twin.world import Vector, World

BRIGHTEST_LAMP = 0.5  # COLOSSEUM draws the lamps' diffuse color from U[0, 0.5]^3
DARKEST_TABLE = 0.25  # and the table's from U[0.25, 1]^3
FURTHEST_SHIFT = 0.1  # metres, each way along each axis
FURTHEST_TURN = 0.05  # radians
FURTHEST_LAMP = np.pi / 3  # radians the lamps are turned by, each way
LOWEST_LAMP = 0.6  # times their height: a lamp that rises would light upward faces beyond 1
FURTHEST_PLACE = 0.05  # metres that a thing is shifted by, each way
SIZES = (0.75, 1.25)  # COLOSSEUM's widest usual range
_DARKEST_TINT = 0.1  # darker ones leave too little light to measure an error by

NO_RECEIVER = "in this task nothing receives what is moved"
BACKGROUND = ("wall_back", "wall_left", "wall_right", "wall_far", "floor")
Names = tuple[str, ...]


def color(darkest: float) -> "Change":
    """Another tint (r, g, b in 0..1) for the named parts, drawn from `darkest` upwards."""

    def change(look: Look, names: Names, value: Any, rng: np.random.Generator) -> Look:
        tint = _vector(value, rng, darkest, 1.0)
        return replace(look, tints={**look.tints, **dict.fromkeys(names, tint)})

    return change


def texture(smallest: float, largest: float) -> "Change":
    """One image (a `Cover`) for the named parts, its tiles drawn between two sides in metres."""

    def change(look: Look, names: Names, value: Any, rng: np.random.Generator) -> Look:
        kind = str(rng.choice(textures.KINDS))
        drawn = Cover(
            kind=kind,
            seed=int(rng.integers(2**32)),
            side=round(float(rng.uniform(smallest, largest)), 3),
        )
        cover = drawn if value is None else value
        return replace(look, covers={**look.covers, **dict.fromkeys(names, cover)})

    return change


def object_finish(look: Look, names: Names, value: Any, rng: np.random.Generator) -> Look:
    """Another finish for the named parts, one of `look.FINISHES`."""
    finish = FINISHES[int(rng.integers(len(FINISHES)))] if value is None else value
    if finish not in FINISHES:
        raise RpaugError(f"no finish is called {finish!r}; there are: {', '.join(FINISHES)}")
    return replace(look, finishes={**look.finishes, **dict.fromkeys(names, finish)})


def light_color(look: Look, names: Names, value: Any, rng: np.random.Generator) -> Look:
    """Another diffuse color (r, g, b) for every lamp; the ambient light follows."""
    return replace(look, light=_vector(value, rng, 0.0, BRIGHTEST_LAMP))


def lamp_color(look: Look, names: Names, value: Any, rng: np.random.Generator) -> Look:
    """Another color of one lamp; a value is its number and what its color is over the recorded one."""
    drawn = int(rng.integers(len(look.lamps))), _vector(None, rng, 0.0, 1.0)
    number, gain = drawn if value is None else value
    lamps = list(look.lamps)
    lamps[number] = replace(lamps[number], gain=_vector(gain, rng, 0.0, 0.0))
    return replace(look, lamps=tuple(lamps))


def light_direction(look: Look, names: Names, value: Any, rng: np.random.Generator) -> Look:
    """All lamps turned together and lowered; a value is the new tuple of `Lamp`s."""
    turn, lower = rng.uniform(-FURTHEST_LAMP, FURTHEST_LAMP), rng.uniform(LOWEST_LAMP, 1.0)
    drawn = tuple(
        replace(lamp, heading=lamp.heading + float(turn), height=lamp.height * float(lower))
        for lamp in look.lamps
    )
    return replace(look, lamps=drawn if value is None else tuple(value))


def camera_pose(look: Look, names: Names, value: Any, rng: np.random.Generator) -> Look:
    """Bumped front and shoulder cameras; a value maps camera names to a `Bump`."""
    drawn = {
        name: Bump(
            turn=_vector(None, rng, -FURTHEST_TURN, FURTHEST_TURN),
            shift=_vector(None, rng, -FURTHEST_SHIFT, FURTHEST_SHIFT),
        )
        for name in BUMPED
    }
    return replace(look, bumps={**look.bumps, **(drawn if value is None else value)})


def object_size(look: Look, names: Names, value: Any, rng: np.random.Generator) -> Look:
    """The named parts larger or smaller by one factor, each about its foot."""
    scale = float(rng.uniform(*SIZES)) if value is None else float(value)
    return replace(look, scales={**look.scales, **dict.fromkeys(names, scale)})


def object_place(look: Look, names: Names, value: Any, rng: np.random.Generator) -> Look:
    """The named parts elsewhere, each by one shift (x, y, z in metres) in its body's frame."""
    x, y = rng.uniform(-FURTHEST_PLACE, FURTHEST_PLACE, 2)
    shift = (float(x), float(y), 0.0) if value is None else _vector(value, rng, 0.0, 0.0)
    return replace(look, shifts={**look.shifts, **dict.fromkeys(names, shift)})


def removal(look: Look, names: Names, value: Any, rng: np.random.Generator) -> Look:
    """The named parts are not there."""
    return replace(look, absent=look.absent | set(names))


def distractor(look: Look, names: Names, value: Any, rng: np.random.Generator) -> Look:
    """More things stand there; a value is the tuple of `Extra`s."""
    return replace(look, extras=look.extras + tuple(value or ()))


Change = Callable[[Look, Names, Any, np.random.Generator], Look]


@dataclass(frozen=True)
class Factor:
    """One thing to change, and the parts it is changed on unless others are named.

    `parts` are names, "manipulated" among them for what the task moves; None: it belongs to no part
    and everything may look different.
    """

    change: Change
    parts: Names | None


FACTORS: Mapping[str, Factor] = {
    "object_color": Factor(color(_DARKEST_TINT), ("manipulated",)),
    "object_texture": Factor(texture(0.08, 0.20), ("manipulated",)),
    "object_finish": Factor(object_finish, ("manipulated",)),
    "light_color": Factor(light_color, None),
    "lamp_color": Factor(lamp_color, None),
    "light_direction": Factor(light_direction, None),
    "table_color": Factor(color(DARKEST_TABLE), ("table",)),
    "table_texture": Factor(texture(0.3, 0.8), ("table",)),
    "background_texture": Factor(texture(0.8, 1.6), BACKGROUND),
    "camera_pose": Factor(camera_pose, None),
    "object_size": Factor(object_size, ("manipulated",)),
    "object_place": Factor(object_place, ("cylinder",)),
    "removal": Factor(removal, ("cylinder",)),
    "distractor": Factor(distractor, None),
}


def find(factor: str) -> Factor:
    """The factor called so. Raises RpaugError listing those there are."""
    if factor not in FACTORS:
        raise RpaugError(f"no factor is called {factor!r}; there are: {', '.join(FACTORS)}")
    return FACTORS[factor]


def parts(factor: Factor, target: str | None, world: World, job: StagedTask) -> Names:
    """The parts it may change. `target` is a part's name, "manipulated" or "receiver". Raises RpaugError."""
    if factor.parts is None:
        return tuple(world.handles)
    roles = {"manipulated": job.manipulated, "receiver": job.receiver}
    names = factor.parts if target is None else (target,)
    found = [roles.get(name, name) for name in names]
    for name in found:
        if name not in world.handles:
            known = f"there are: {', '.join(world.handles)}"
            raise RpaugError(f"no part is called {name!r}; {known}" if name else NO_RECEIVER)
    return tuple(name for name in found if name)


def _vector(value: Any, rng: np.random.Generator, low: float, high: float) -> Vector:
    x, y, z = rng.uniform(low, high, 3) if value is None else value
    return float(x), float(y), float(z)
