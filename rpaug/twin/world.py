"""What stands where: rigid bodies, the parts they are made of, and the shapes of the parts."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float, Int, UInt8

from rpaug.twin import textures

Vector = tuple[float, float, float]
Pose = Float[np.ndarray, "4 4"]

WHITE: Vector = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Geom:
    """One primitive in its body's frame.

    `size` is MuJoCo's: half extents of a box or a plane in metres, the radius of the others. A
    capsule or cylinder runs from `start` to `end`; the others sit at `start`, a box turned by `yaw`
    about z. Its albedo is tint of the part * `color` * texture.
    """

    shape: Literal["box", "plane", "sphere", "capsule", "cylinder"]
    size: tuple[float, ...]
    start: Vector = (0.0, 0.0, 0.0)
    end: Vector | None = None
    color: Vector = WHITE
    texture: str | None = None
    yaw: float = 0.0


@dataclass(frozen=True)
class Print:
    """An image that repeats every `side` metres: one of `textures.KINDS`, drawn from `seed`."""

    kind: str
    seed: int
    side: float

    @property
    def image(self) -> UInt8[np.ndarray, "n n 3"]:
        """The tile, its first row uppermost."""
        return textures.picture(self.kind, self.seed)


@dataclass(frozen=True)
class Flex:
    """What bends: vertices at rest in the world, triangles (of a sheet) or tetrahedra (of a body), and its image.

    `tiles` are image coordinates of each vertex, in repeats of the image.
    """

    points: Float[np.ndarray, "v 3"]
    elements: Int[np.ndarray, "e k"]
    tiles: Float[np.ndarray, "v 2"]
    printed: Print

    @property
    def dim(self) -> int:
        """2 for a sheet, 3 for a body."""
        return self.elements.shape[1] - 1


@dataclass(frozen=True)
class Part:
    """What one mask handle names; `tint` multiplies the albedo of all its shapes. What bends is a flex, not geoms.

    The room's walls cast no shadow: lamps hang inside it.
    """

    name: str
    geoms: tuple[Geom, ...]
    tint: Vector = WHITE
    flex: Flex | None = None
    casts: bool = True


@dataclass(frozen=True)
class TwinBody:
    """A rigid set of parts.

    `pose` is in the frame of `parent`, or in the world. A body with a `joint` turns about (hinge)
    or slides along the given axis of its own frame; a `movable` one is put where the motion says.
    """

    name: str
    parts: tuple[Part, ...]
    pose: Pose = field(default_factory=lambda: np.eye(4))
    parent: str | None = None
    joint: tuple[Literal["hinge", "slide"], Vector] | None = None
    movable: bool = False


@dataclass(frozen=True)
class World:
    """All bodies, parents before their children, the images of their textures, and the mask handle of every part."""

    bodies: tuple[TwinBody, ...]
    textures: Mapping[str, UInt8[np.ndarray, "n n 3"]]
    handles: Mapping[str, int]

    def body(self, name: str) -> TwinBody:
        """The body called `name`."""
        return next(body for body in self.bodies if body.name == name)

    def part(self, name: str) -> Part:
        """The part called `name`."""
        return next(part for body in self.bodies for part in body.parts if part.name == name)


def draw_instance_ids(bodies: tuple[TwinBody, ...], rng: np.random.Generator) -> dict[str, int]:
    """A positive integer for each part, unlike for every seed, as a simulator numbers its objects."""
    names = [part.name for body in bodies for part in body.parts]
    numbers = rng.choice(np.arange(8, 250), len(names), replace=False)
    return {name: int(number) for name, number in zip(names, numbers, strict=True)}
