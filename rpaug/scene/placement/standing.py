"""A thing that stands on the support: its outline from above, and the same thing put elsewhere."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float64

from rpaug.core import geometry
from rpaug.core.errors import Unsupported
from rpaug.core.types import Body, Scene
from rpaug.scene.placement.free_space import FreeSpace
from rpaug.scene.placement.placing import hull, points_of

LIFTED = (
    0.02  # metres: what is seen to begin higher than this over the support does not stand on it
)
TRIES = 24  # turns drawn before giving up

Around = tuple[Float[np.ndarray, "2"] | Float[np.ndarray, "c 2"], float]
"""A point or an outline in the world, and how many metres a place may be away from it."""


@dataclass(frozen=True)
class StandingInstance:
    """Some instances that stand together; `outline` is around `middle`, in metres, `top` above the support."""

    instance_ids: frozenset[int]
    middle: Float64[np.ndarray, "2"]
    outline: Float64[np.ndarray, "k 2"]
    top: float

    def placing(self, to: Float[np.ndarray, "2"], turn: float) -> Float64[np.ndarray, "4 4"]:
        """The world's motion that takes the thing's middle there and turns it about the vertical."""
        about = geometry.rigid(np.zeros(3), np.array([*-self.middle, 0.0]))
        return geometry.rigid(np.array([0.0, 0.0, turn]), np.array([*to, 0.0])) @ about


def thing(
    scene: Scene, instance_ids: frozenset[int], free_space: FreeSpace, doing: str
) -> StandingInstance:
    """What the instances look like from above. Raises Unsupported if they do not stand on the support."""
    points = points_of(scene, instance_ids)
    if len(points) < 4:
        raise Unsupported(f"{doing} {_names(instance_ids)}: too little of it was seen")
    height = points[:, 2] - free_space.level
    foot = float(np.quantile(height, 0.01))
    if not -LIFTED < foot < LIFTED:
        raise Unsupported(
            f"{doing} {_names(instance_ids)}: it does not stand on the table but {100 * foot:.0f} cm above it"
        )
    outline = hull(points)
    middle = (outline.min(0) + outline.max(0)) / 2
    return StandingInstance(instance_ids, middle, outline - middle, float(height.max()))


def beside(
    scene: Scene, instance_ids: frozenset[int], outline: Float[np.ndarray, "k 2"], within: float
) -> tuple[Float64[np.ndarray, "c 2"], float]:
    """Where a thing of that outline is near others: around whose outline, and how far its middle may be from it.

    The gap between the two is then at most about `within` metres. Raises Unsupported if too little was seen.
    """
    points = points_of(scene, instance_ids)
    if len(points) < 4:
        raise Unsupported(f"placing near {_names(instance_ids)}: too little of it was seen")
    return hull(points), within + float(np.linalg.norm(outline, axis=1).mean())


def turned(outline: Float[np.ndarray, "k 2"], turn: float) -> Float64[np.ndarray, "k 2"]:
    """An outline turned by radians about its middle."""
    return outline @ geometry.rotation(np.array([0.0, 0.0, turn]))[:2, :2].T


def settle(
    one: StandingInstance,
    free_space: FreeSpace,
    turn: float,
    rng: np.random.Generator,
    near: Around | None = None,
) -> tuple[Float64[np.ndarray, "2"], float] | None:
    """A free place near what is given, and a turn of at most `turn` radians; None if none."""
    for _ in range(TRIES):
        angle = float(rng.uniform(-turn, turn)) if turn else 0.0
        spot = free_space.draw(turned(one.outline, angle), one.top, rng, near)
        if spot is not None:
            return spot, angle
    return None


def moved(scene: Scene, instance_ids: frozenset[int], motion: Float[np.ndarray, "4 4"]) -> Scene:
    """The scene with those instances moved in the world, over the whole episode."""
    bodies: list[Body] = []
    for body in scene.bodies:
        held = body.instance_ids & instance_ids
        if not held or body.copy_of:
            bodies.append(body)
            continue
        bodies.append(replace(body, instance_ids=held, to_world=motion @ body.to_world))
        if rest := body.instance_ids - held:
            bodies.append(replace(body, instance_ids=rest))
    return replace(scene, bodies=tuple(bodies), recorded_bodies=scene.tracked)


def _names(instance_ids: frozenset[int]) -> str:
    return ", ".join(map(str, sorted(instance_ids)))
