"""Paint the table, as COLOSSEUM's `table_color` does."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rpaug.core.interfaces import Edit, Examples, Needs, Operator, Painted
from rpaug.core.types import Effect, Scene
from rpaug.operators.fields import RGB
from rpaug.operators.painting import painted
from rpaug.operators.recolor import named, ratio
from rpaug.scene.lighting import albedo, shading
from rpaug.scene.targets import targets


@dataclass(frozen=True, kw_only=True)
class TableColor(Operator):
    """Draw the table's color uniformly from `range` and swap its albedo for it; its grain and shadows stay.

    `albedo` is the old color where it is known; else it is estimated from the pixels of each instance.
    """

    target: targets.Target = targets.TABLE
    range: tuple[RGB, RGB] = ((0.25, 0.25, 0.25), (1.0, 1.0, 1.0))
    albedo: RGB | None = None

    effect: ClassVar[Effect] = Effect.RGB
    needs: ClassVar[Needs] = Needs(targets=("target",))
    phrases: ClassVar[tuple[str, ...]] = ("change the color of the table",)
    examples: ClassVar[Examples] = (
        ("a gray tabletop", {"range": [[0.5, 0.5, 0.5], [0.5, 0.5, 0.5]]}),
        ("random table colors", {}),
    )
    undone_as: ClassVar[tuple[str, ...]] = (
        "table",
        "table color",
        "table colour",
        "color",
        "colour",
        "colors",
        "colours",
        "paint",
    )
    settles: ClassVar[str] = "look"

    def __post_init__(self) -> None:
        if any(low > high for low, high in zip(*self.range, strict=True)):
            raise ValueError(f"range: low {self.range[0]} exceeds high {self.range[1]}")

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        instance_ids = sorted(targets.find(scene, self.target))
        described = shading.describe(scene, instance_ids, self.albedo)
        return {"color": rng.uniform(*np.array(self.range)).tolist(), **described}

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        red, green, blue = edit["color"]
        return painted(scene, [ratio(one, (red, green, blue)) for one in edit["surfaces"]])

    def says(self, edit: Edit) -> tuple[Painted, ...]:
        return named(edit)

    def falls_short(self, edit: Edit) -> dict[str, tuple[int, int]]:
        return albedo.guessed(edit["surfaces"])
