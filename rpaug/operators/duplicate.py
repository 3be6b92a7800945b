"""Put more of a thing on the table."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from rpaug.core import instance_ids
from rpaug.core.errors import Unsupported
from rpaug.core.interfaces import Edit, Examples, Needs, Operator
from rpaug.core.types import Body, Effect, Scene
from rpaug.scene.lighting import shadows
from rpaug.scene.placement import standing, untouched
from rpaug.scene.placement.placing import find_free_space
from rpaug.scene.targets import targets


@dataclass(frozen=True, kw_only=True)
class Duplicate(Operator):
    """Put `count` copies of `target` on free places of the table, each turned by up to `turn`.

    Without a target one thing that the robot leaves alone is drawn.
    Copies have instance ids of their own. They show what was recorded of the original: sides that nobody saw are
    missing, so `turn` is best kept small where cameras stand on one side. Things that the robot acts on are refused.
    """

    target: targets.Target | None = None
    count: Annotated[int, Field(ge=1, le=20)] = 1
    turn: Annotated[float, Field(ge=0, le=np.pi)] = 0.5  # radians, at most

    effect: ClassVar[Effect] = Effect.PIXELS | Effect.BODIES
    puts: ClassVar[bool] = True
    needs: ClassVar[Needs] = Needs(targets=("target",))
    asked_as: ClassVar[Mapping[str, str]] = {
        "copy": "duplicate, clone, copy, replicate, double up, copies of, copy of, more of, "
        "more of the, another of",
    }
    phrases: ClassVar[tuple[str, ...]] = ("duplicate {target} [{count} times]",)
    examples: ClassVar[Examples] = (
        ("another two of the blue block", {"target": "blue block", "count": 2}),
        ("clone instance 12", {"target": {"handle": 12}}),
    )

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        target = untouched.pick(scene, self.target, rng, "duplicating")
        originals = sorted(untouched.find_untouched(scene, target, "duplicating"))
        around = find_free_space(scene)
        one = standing.thing(scene, frozenset(originals), around, "duplicating")
        copies: list[Edit] = []
        fresh = iter(instance_ids.free(scene, self.count * len(originals)))
        for _ in range(self.count):
            found = standing.settle(one, around, self.turn, rng)
            if found is None:
                raise Unsupported(
                    f"duplicating {target}: no free place for copy {len(copies) + 1} of {self.count}"
                )
            spot, turn = found
            around = around.with_thing(standing.turned(one.outline, turn) + spot)
            names = {str(old): next(fresh) for old in originals}
            copies.append({"handles": names, "motion": one.placing(spot, turn).tolist()})
        return {"copies": copies, "lamps": shadows.lamps(scene)}

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        bodies = list(scene.bodies)
        for copy in edit["copies"]:
            names = {int(old): new for old, new in copy["handles"].items()}
            bodies += [
                _copy(
                    body,
                    {old: new for old, new in names.items() if old in body.instance_ids},
                    copy["motion"],
                )
                for body in scene.bodies
                if not body.copy_of and body.instance_ids & names.keys()
            ]
        after = replace(scene, bodies=tuple(bodies), recorded_bodies=scene.tracked)
        return shadows.follow(scene, after, edit["lamps"])


def _copy(body: Body, names: dict[int, int], motion: list[list[float]]) -> Body:
    return replace(
        body,
        instance_ids=frozenset(names.values()),
        to_world=np.array(motion) @ body.to_world,
        copy_of=names,
    )
