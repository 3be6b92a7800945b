"""An operator from outside: a thing glows in one color."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rpaug import Edit, Effect, Needs, Operator, Painted, Scene, Target, find_target

HUES = {"yellow": (1, 1, 0), "violet": (0.6, 0, 1)}


@dataclass(frozen=True)
class Shine:
    instance_ids: frozenset[int]
    hue: tuple[float, float, float]
    share: float

    def __call__(self, colors, surface):
        return (colors + self.share * (np.array(self.hue) - colors)).astype(np.float32)


@dataclass(frozen=True, kw_only=True)
class Glow(Operator):
    """Let a thing glow in one color."""

    target: Target
    color: Literal["yellow", "violet"] = "yellow"
    least: float = 0.5

    effect = Effect.RGB
    needs = Needs(targets=("target",))
    phrases = ("(make|let) {target} glow {color:yellow|violet} [by at least {least:share}]",)
    examples = (
        ("a faint violet shine on the cup", {"target": "cup", "color": "violet", "least": 0.2}),
    )
    settles = "look"

    def sample(self, scene: Scene, rng) -> Edit:
        ids = sorted(find_target(scene, self.target))
        return {"ids": ids, "share": float(rng.uniform(self.least, 1))}

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        shine = Shine(frozenset(edit["ids"]), HUES[self.color], edit["share"])
        return replace(scene, appearance=(*scene.appearance, shine))

    def says(self, edit: Edit):
        return (Painted(frozenset(edit["ids"]), self.color),)
