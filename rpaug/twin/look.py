"""Everything about a recording that can be changed while its motion stays the same."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float, Int, UInt8

from rpaug.twin.covers import Cover
from rpaug.twin.world import Vector

# At this brightness an upward face is lit to 1.0: a lamp that COLOSSEUM's light factor changes only gets darker,
# so that OpenGL never clips the lit color and the truth is a plain ratio.
LAMPS: Vector = (0.5, 0.5, 0.5)


Finish = Literal["matte", "satin", "glossy", "metallic"]
"""How a part mirrors lamps: metals in their own color."""
FINISHES: tuple[Finish, ...] = get_args(Finish)


@dataclass(frozen=True)
class TwinLamp:
    """Parallel light from `heading` about the vertical (0: from +x) and `height` above the horizon, radians; its color
    over the look's `light`."""

    heading: float
    height: float
    gain: Vector = (1.0, 1.0, 1.0)


RIG = tuple(
    TwinLamp(float(np.deg2rad(heading)), float(np.deg2rad(height)))
    for heading, height in ((20, 33), (250, 25), (165, 25))
)


@dataclass(frozen=True, kw_only=True)
class Bump:
    """A rigid motion of a camera in its own frame: rotation vector in radians, shift in metres."""

    turn: Vector = (0.0, 0.0, 0.0)
    shift: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Extra:
    """A mesh that is no part of the world: its pose, the handle its pixels get, and an image laid on it.

    `uv` are one coordinate a point, (0, 0) at the image's lower left.
    """

    name: str
    handle: int
    points: Float[np.ndarray, "v 3"]
    normals: Float[np.ndarray, "v 3"]
    uv: Float[np.ndarray, "v 2"]
    faces: Int[np.ndarray, "f 3"]
    image: UInt8[np.ndarray, "h w 3"]
    pose: Float[np.ndarray, "4 4"]

    def describe(self) -> dict[str, Any]:
        """What it is and where it stands, as plain values."""
        return {"name": self.name, "handle": self.handle, "pose": self.pose.tolist()}


@dataclass(frozen=True, kw_only=True)
class Look:
    """How the world looks.

    `tints` replaces the color that multiplies a part's albedo, by part name. `light` is the
    diffuse color of every lamp; the ambient light goes with it. `bumps` moves cameras by name.
    `antialias` smooths the color images, never depth or ids. `texture_seed` draws the textures;
    None takes the recording's own seed. `covers` lays images on parts, by name; `lamps` says where
    the light comes from. `headlight` is the brightness of a lamp on the camera itself. Parts named in `absent` are not
    there; `scales` makes parts larger or smaller about their foot, `shifts` puts them elsewhere in their bodies.
    `extras` are meshes that stand there as well. With `specular` all parts are satin; `finishes` says what others are,
    by name.
    """

    tints: Mapping[str, Vector] = field(default_factory=dict)
    light: Vector = LAMPS
    bumps: Mapping[str, Bump] = field(default_factory=dict)
    antialias: bool = False
    specular: bool = False
    shadows: bool = False
    texture_seed: int | None = None
    covers: Mapping[str, Cover] = field(default_factory=dict)
    lamps: tuple[TwinLamp, ...] = RIG
    headlight: float = 0.0
    absent: frozenset[str] = frozenset()
    scales: Mapping[str, float] = field(default_factory=dict)
    shifts: Mapping[str, Vector] = field(default_factory=dict)
    extras: tuple[Extra, ...] = ()
    finishes: Mapping[str, Finish] = field(default_factory=dict)

    def finish(self, part: str) -> Finish:
        """That of a part."""
        return self.finishes.get(part, "satin" if self.specular else "matte")

    @property
    def shines(self) -> bool:
        """Whether anything mirrors lamps."""
        return self.specular or any(one != "matte" for one in self.finishes.values())

    def describe(self) -> dict[str, Any]:
        """The fields as plain values; those from covers on only where they are not the usual ones."""
        facts = asdict(replace(self, extras=()))
        facts["absent"] = sorted(self.absent)
        facts["extras"] = [extra.describe() for extra in self.extras]
        for name in ("absent", "scales", "shifts", "extras", "finishes"):
            if not facts[name]:
                del facts[name]
        if not self.covers:
            del facts["covers"]
        if self.lamps == RIG:
            del facts["lamps"]
        if not self.headlight:
            del facts["headlight"]
        return facts
