"""Rearrange what lies around: everything that the robot leaves alone gets another place."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from rpaug.core.errors import Unsupported
from rpaug.core.interfaces import Edit, Examples, Needs, Operator
from rpaug.core.types import Effect, Scene
from rpaug.scene.lighting import shadows
from rpaug.scene.placement import standing, untouched
from rpaug.scene.placement.free_space import FreeSpace
from rpaug.scene.placement.placing import find_free_space
from rpaug.scene.targets.targets import Target


@dataclass(frozen=True, kw_only=True)
class Spread(Operator):
    """Give each of `targets` another free place within `shift`, and a turn of up to `turn`.

    None means all that stands on the table and is neither large nor acted on by the robot. A named target that the
    robot acts on is refused.
    """

    targets: tuple[Target, ...] | None = None
    shift: Annotated[float, Field(gt=0, le=10)] = 0.2  # metres, at most
    turn: Annotated[float, Field(ge=0, le=np.pi)] = 0.5  # radians, at most

    effect: ClassVar[Effect] = Effect.PIXELS | Effect.BODIES
    puts: ClassVar[bool] = True
    needs: ClassVar[Needs] = Needs(targets=("targets",))
    asked_as: ClassVar[Mapping[str, str]] = {
        "spread": "rearrange, shuffle where, shuffle, mix up where, scatter, spread, reorder, "
        "mix up the places of, rearranged, "
        "swap around, permute",
    }
    phrases: ClassVar[tuple[str, ...]] = ("rearrange everything", "shuffle {targets}")
    examples: ClassVar[Examples] = (
        ("shuffle whatever lies around", {}),
        (
            "rearrange the cup and the plate by up to 10 cm",
            {"targets": ["cup", "plate"], "shift": 0.1},
        ),
    )
    undone_as: ClassVar[tuple[str, ...]] = ("spread", "shuffle")

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        around = find_free_space(scene)
        things = self._named(scene, around) if self.targets else untouched.loose(scene, "spreading")
        around = find_free_space(
            scene, leaving=frozenset().union(*(one.instance_ids for one in things))
        )
        moves = []
        for one in sorted(things, key=lambda one: -float(np.ptp(one.outline, axis=0).max())):
            found = standing.settle(one, around, self.turn, rng, (one.middle, self.shift))
            spot, turn = found or (one.middle, 0.0)  # where there is no room it stays
            around = around.with_thing(standing.turned(one.outline, turn) + spot)
            if found:
                moves.append(
                    {
                        "handles": sorted(one.instance_ids),
                        "motion": one.placing(spot, turn).tolist(),
                    }
                )
        if not moves:
            raise Unsupported(
                f"spreading: no free place within {100 * self.shift:.0f} cm for anything"
            )
        return {"moves": moves, "lamps": shadows.lamps(scene)}

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        after = scene
        for move in edit["moves"]:
            after = standing.moved(after, frozenset(move["handles"]), np.array(move["motion"]))
        return shadows.follow(scene, after, edit["lamps"])

    def _named(self, scene: Scene, around: FreeSpace) -> list[standing.StandingInstance]:
        named = [untouched.find_untouched(scene, each, "spreading") for each in self.targets or ()]
        return [standing.thing(scene, instance_ids, around, "spreading") for instance_ids in named]
