"""Change the shadows that the lamps cast: make them deeper, fainter or softer, or let them fall elsewhere."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from rpaug.core.errors import Unsupported
from rpaug.core.interfaces import Edit, Examples, Needs, Operator
from rpaug.core.types import Effect, Relit, Scene
from rpaug.operators.fields import Interval
from rpaug.scene.lighting import rig, shadows

NONE = (
    "no shadow was seen to pass over what rests that known things cast, so that shadows and patterns "
    "cannot be told apart"
)


@dataclass(frozen=True, kw_only=True)
class Shadows(Operator):
    """Draw how much light cast shadows take away, `depth` times what they took, and how soft their edges are.

    `softness` is the radius in radians of the lamps' discs as things see them: 0 leaves edges as they were recorded.
    `turn` lets all lamps turn about the vertical by up to so much, and what they light with them. Refused where moving
    shadows do not tell the lamps.
    """

    depth: Interval[Annotated[float, Field(ge=0, le=2)]] = (0.4, 1.0)
    softness: Interval[Annotated[float, Field(ge=0, le=0.3)]] = (0.0, 0.0)
    turn: Annotated[float, Field(ge=0, le=np.pi)] = 0.0  # radians, at most

    effect: ClassVar[Effect] = Effect.RGB
    needs: ClassVar[Needs] = Needs(depth=True, lamps=True)
    phrases: ClassVar[tuple[str, ...]] = (
        "vary the [depth of the] shadows [to between {depth:number} and {depth:number} times]",
        "move the shadows by up to {turn:angle}",
    )
    examples: ClassVar[Examples] = (
        ("take the cast shadows away", {"depth": [0, 0]}),
        ("shadows with soft edges", {"depth": [1, 1], "softness": [0.05, 0.1]}),
    )
    undone_as: ClassVar[tuple[str, ...]] = ("cast shadows",)
    settles: ClassVar[str] = "shadows"

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        known = shadows.relit(scene)
        if known is None:
            raise Unsupported(f"shadows: {NONE}")
        depth, softness = (float(rng.uniform(*one)) for one in (self.depth, self.softness))
        turn = float(rng.uniform(-self.turn, self.turn))
        return {
            "depth": depth,
            "softness": softness,
            "lamps": {
                "recorded": shadows.plain(known.recorded),
                "now": shadows.plain(rig.turned(known.now, turn, 1.0) if turn else known.now),
            },
            "unlit": list(known.unlit),
        }

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        recorded, now = (shadows.rig_of(edit["lamps"][one]) for one in ("recorded", "now"))
        before = scene.relit or Relit(recorded, now, unlit=tuple(edit["unlit"]))
        softness = max(before.softness, edit["softness"])
        relit = replace(before, now=now, depth=before.depth * edit["depth"], softness=softness)
        return replace(scene, relit=relit)
