"""What a recording is known to show: handles, what moves, and exactly what was changed."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from rpaug.twin.cameras import BUMPED
from rpaug.twin.covers import Cover
from rpaug.twin.look import Bump, Look
from rpaug.twin.world import WHITE, Part, Vector, World


@dataclass(frozen=True, kw_only=True)
class Laid:
    """A cover as it lies on a part: its mapping is that of `rpaug.twin.covers`, in the frame of the part's body.

    `file` names the image beside the truth. `body_to_world` is where the body is at frame 0, 4 x 4.
    """

    cover: Cover
    file: str
    body_to_world: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, kw_only=True)
class Truth:
    """The facts of one recorded episode.

    `handles` maps part names to mask handles, `bodies` body names to the handles rigid to each
    other, `manipulated` is the name of the part the task moves and `receiver` of the one it is
    brought to. `old` is the look before the change, `new` the one recorded: without a factor the
    same. `changed` are the handles that may look different, `covers` the images laid on parts,
    `roam` how many metres each way the task may lie elsewhere.
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
    receiver: str | None = None
    changed: tuple[int, ...] = ()
    covers: Mapping[int, Laid] = field(default_factory=dict)
    roam: float = 0.0

    @property
    def light(self) -> tuple[Vector, Vector]:
        """The lamps' diffuse color, old and new."""
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
        """The facts as plain values; colors are display values, lengths metres, angles radians.

        A receiver, changed handles, covers and a distance to roam are left out where there are none.
        """
        facts = asdict(self) | {"old": self.old.describe(), "new": self.new.describe()}
        facts["covers"] = {str(handle): asdict(laid) for handle, laid in self.covers.items()}
        for name in ("receiver", "changed", "covers", "roam"):
            if not facts[name]:
                del facts[name]
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
    """Tint times the mean of color and texture over a part's shapes, rounded to 1e-6, by handle."""
    out = {}
    for part in (part for body in world.bodies for part in body.parts):
        cover = look.covers.get(part.name) or (part.flex.printed if part.flex else None)
        if cover:
            mean, tint = cover.image.mean((0, 1)) / 255, look.tints.get(part.name, WHITE)
        else:
            mean, tint = _own_color(world, part), look.tints.get(part.name, part.tint)
        red, green, blue = mean * tint
        out[world.handles[part.name]] = (
            round(float(red), 6),
            round(float(green), 6),
            round(float(blue), 6),
        )
    return out


def laid(
    world: World, look: Look, objects: Mapping[str, Float[np.ndarray, "t 4 4"]]
) -> dict[int, Laid]:
    """The covers of a look with where they lie, by handle; `objects` are the tracks of what can move."""
    out = {}
    for body in world.bodies:
        pose = objects[body.name][0] if body.name in objects else body.pose
        for part in body.parts:
            if cover := look.covers.get(part.name):
                rows = tuple(tuple(row) for row in pose.tolist())
                name = f"truth-{cover.kind}-{cover.seed}.png"
                out[world.handles[part.name]] = Laid(cover=cover, file=name, body_to_world=rows)
    return out


def _own_color(world: World, part: Part) -> Float[np.ndarray, "3"]:
    plain = np.full((1, 1, 3), 255, np.uint8)
    shapes = [
        world.textures.get(geom.texture or "", plain).mean((0, 1)) / 255 * geom.color
        for geom in part.geoms
    ]
    return np.mean(shapes, 0)
