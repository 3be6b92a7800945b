"""Everything about a recording that can be changed while its motion stays the same."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from rpaug.twin.covers import Cover
from rpaug.twin.world import Vector

# At this brightness an upward face is lit to 1.0: a lamp that COLOSSEUM's light factor changes only gets darker,
# so that OpenGL never clips the lit colour and the truth is a plain ratio.
LAMPS: Vector = (0.5, 0.5, 0.5)


@dataclass(frozen=True)
class Lamp:
    """Parallel light from `heading` about the vertical (0: from +x) and `height` above the horizon, radians."""

    heading: float
    height: float


RIG = tuple(
    Lamp(float(np.deg2rad(heading)), float(np.deg2rad(height)))
    for heading, height in ((20, 33), (250, 25), (165, 25))
)


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
    None takes the recording's own seed. `covers` lays images on parts, by name; `lamps` says where
    the light comes from. `headlight` is the brightness of a lamp on the camera itself.
    """

    tints: Mapping[str, Vector] = field(default_factory=dict)
    light: Vector = LAMPS
    bumps: Mapping[str, Bump] = field(default_factory=dict)
    antialias: bool = False
    specular: bool = False
    shadows: bool = False
    texture_seed: int | None = None
    covers: Mapping[str, Cover] = field(default_factory=dict)
    lamps: tuple[Lamp, ...] = RIG
    headlight: float = 0.0

    def describe(self) -> dict[str, Any]:
        """The fields as plain values; covers, lamps and headlight only where they are not the usual ones."""
        facts = asdict(self)
        if not self.covers:
            del facts["covers"]
        if self.lamps == RIG:
            del facts["lamps"]
        if not self.headlight:
            del facts["headlight"]
        return facts
