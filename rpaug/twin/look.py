"""Everything about a recording that can be changed while its motion stays the same."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from rpaug.twin.world import Vector

# At this brightness an upward face is lit to 1.0: a lamp that COLOSSEUM's light factor changes only gets darker,
# so that OpenGL never clips the lit colour and the truth is a plain ratio.
LAMPS: Vector = (0.5, 0.5, 0.5)


@dataclass(frozen=True, kw_only=True)
class Bump:
    """A rigid motion of a camera in its own frame: rotation vector in radians, shift in metres."""

    turn: Vector = (0.0, 0.0, 0.0)
    shift: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Look:
    """How the world looks.

    `tints` replaces the colour that multiplies a part's albedo, by part name. `light` is the
    diffuse colour of every lamp; the ambient light goes with it. `bumps` moves cameras by name.
    `antialias` smooths the colour images, never depth or ids. `texture_seed` draws the textures;
    None takes the recording's own seed.
    """

    tints: Mapping[str, Vector] = field(default_factory=dict)
    light: Vector = LAMPS
    bumps: Mapping[str, Bump] = field(default_factory=dict)
    antialias: bool = False
    specular: bool = False
    shadows: bool = False
    texture_seed: int | None = None
