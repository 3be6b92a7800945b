"""What a recording is known to show: handles, what moves, and exactly what was changed."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rpaug.twin.cameras import BUMPED
from rpaug.twin.look import Bump, Look
from rpaug.twin.world import Vector, World


@dataclass(frozen=True, kw_only=True)
class Truth:
    """The facts of one recorded episode.

    `handles` maps part names to mask handles, `bodies` body names to the handles rigid to each
    other, `manipulated` is the name of the part the task moves. `old` is the look before the
    change, `new` the one recorded: without a factor the same.
    """

    task: str
    seed: int
    episode: int
    variation: int
    manipulated: str
    handles: Mapping[str, int]
    bodies: Mapping[str, tuple[int, ...]]
    key_frames: tuple[int, ...]
    factor: str | None
    tints: Mapping[int, tuple[Vector, Vector]]
    albedos: Mapping[int, Vector]
    old: Look
    new: Look

    @property
    def light(self) -> tuple[Vector, Vector]:
        """The lamps' diffuse colour, old and new."""
        return self.old.light, self.new.light

    @property
    def bumps(self) -> dict[str, Bump]:
        """How the cameras were moved, by name, the unmoved ones left out."""
        return {
            name: self.new.bumps[name]
            for name in BUMPED
            if name in self.new.bumps and self.new.bumps[name] != self.old.bumps.get(name)
        }

    def describe(self) -> dict[str, Any]:
        """The facts as plain values; colours are display values, lengths metres, angles radians."""
        facts = asdict(self)
        facts["tints"] = {
            str(handle): {"old": old, "new": new} for handle, (old, new) in self.tints.items()
        }
        facts["albedos"] = {str(handle): albedo for handle, albedo in self.albedos.items()}
        facts["light"] = dict(zip(("old", "new"), self.light, strict=True))
        facts["bumps"] = {name: asdict(bump) for name, bump in self.bumps.items()}
        return facts


def changed_tints(world: World, old: Look, new: Look) -> dict[int, tuple[Vector, Vector]]:
    """Old and new tint of every part whose tint differs, by handle."""
    both = {
        part.name: (old.tints.get(part.name, part.tint), new.tints.get(part.name, part.tint))
        for body in world.bodies
        for part in body.parts
    }
    return {world.handles[name]: pair for name, pair in both.items() if pair[0] != pair[1]}


def mean_albedos(world: World, look: Look) -> dict[int, Vector]:
    """Tint times the mean of colour and texture over a part's shapes, rounded to 1e-6, by handle."""
    plain = np.full((1, 1, 3), 255, np.uint8)
    out = {}
    for part in (part for body in world.bodies for part in body.parts):
        shapes = [
            world.textures.get(geom.texture or "", plain).mean((0, 1)) / 255 * geom.colour
            for geom in part.geoms
        ]
        red, green, blue = np.mean(shapes, 0) * look.tints.get(part.name, part.tint)
        out[world.handles[part.name]] = (
            round(float(red), 6),
            round(float(green), 6),
            round(float(blue), 6),
        )
    return out
