"""Put a thing that the robot leaves alone somewhere else on the table."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from rpaug.errors import Unsupported
from rpaug.interfaces import Edit, Operator
from rpaug.scene import shadows, standing, targets, untouched
from rpaug.scene.placing import room
from rpaug.types import Effect, Scene


@dataclass(frozen=True, kw_only=True)
class Move(Operator):
    """Move `target` to a free place within `shift` and turn it about the vertical by up to `turn`.

    Free is what stays 5 cm away from other things and from all that moves, over the whole episode. `to` asks for a
    place of the target's middle in the world instead. Things that the robot acts on are refused.
    """

    target: targets.Target
    shift: Annotated[float, Field(gt=0, le=10)] = 0.15  # metres, at most
    turn: Annotated[float, Field(ge=0, le=np.pi)] = 0.5  # radians, at most
    to: tuple[float, float] | None = None

    effect: ClassVar[Effect] = Effect.PIXELS | Effect.BODIES

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        handles = untouched.find_untouched(scene, self.target, "moving")
        around = room(scene, leaving=handles)
        one = standing.thing(scene, handles, around, "moving")
        if self.to is not None:
            spot, turn = np.array(self.to), float(rng.uniform(-self.turn, self.turn))
            if not around.free(standing.turned(one.outline, turn), one.top, spot):
                raise Unsupported(f"moving {self.target}: there is no room at {list(self.to)}")
        else:
            found = standing.settle(one, around, self.turn, rng, within=self.shift)
            if found is None:
                raise Unsupported(
                    f"moving {self.target}: no free place within {100 * self.shift:.0f} cm of where it stands"
                )
            spot, turn = found
        return {
            "handles": sorted(handles),
            "motion": one.placing(spot, turn).tolist(),
            "lamps": shadows.lamps(scene),
        }

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        after = standing.moved(scene, frozenset(edit["handles"]), np.array(edit["motion"]))
        return shadows.follow(scene, after, edit["lamps"])
