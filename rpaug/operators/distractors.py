"""Put things onto the table that have nothing to do with the task."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from rpaug.assets import library
from rpaug.core.interfaces import Added, Edit, Operator
from rpaug.core.types import Effect, Scene
from rpaug.operators.insert import (
    AS_IT_COMES,
    Harmoniser,
    Sizes,
    added,
    draw,
    inserted,
    light,
    suited,
)
from rpaug.providers import harmonise
from rpaug.scene.placement.placing import find_free_space


@dataclass(frozen=True, kw_only=True)
class Distractors(Operator):
    """Insert `count` things drawn from the library, any that fits as likely; see `insert`.

    COLOSSEUM's distractor_object puts two into most scenes, 5 cm away from what is there.
    """

    count: Annotated[int, Field(ge=1, le=30)] = 2
    assets: tuple[str, ...] | None = None
    category: str | None = None
    color: str | None = None
    size: Sizes | None = (0.04, 0.16)  # metres of the longest side
    harmonise: bool = True
    harmoniser: Harmoniser = "scene"

    effect: ClassVar[Effect] = Effect.PIXELS | Effect.BODIES
    phrases: ClassVar[tuple[str, ...]] = ("add {count} distractors",)
    undone_as: ClassVar[tuple[str, ...]] = ("distractor", "distractors", "clutter")

    def ready(self) -> None:
        harmonise.ready(self.harmoniser)

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        if self.assets is not None:
            choices = tuple(library.get(name) for name in self.assets)
        else:
            choices = library.find(self.category, self.color, self.size)
        things, _ = draw(scene, find_free_space(scene), choices, self.count, 1.0, rng)
        if not self.harmonise:
            return {"things": things, **AS_IT_COMES}
        return suited(scene, {"things": things, **light(scene)}, self.harmoniser)

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        return inserted(scene, edit)

    def says(self, edit: Edit) -> tuple[Added, ...]:
        return added(edit)
