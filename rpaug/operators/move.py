"""Put a thing that the robot leaves alone somewhere else on the table."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from jaxtyping import Float64
from pydantic import Field

from rpaug.core.errors import Unsupported
from rpaug.core.interfaces import Edit, Examples, Needs, Operator
from rpaug.core.types import Effect, Scene
from rpaug.scene.lighting import shadows
from rpaug.scene.placement import standing, untouched
from rpaug.scene.placement.placing import find_free_space
from rpaug.scene.sampled_frames import look
from rpaug.scene.targets import places, targets


@dataclass(frozen=True, kw_only=True)
class Move(Operator):
    """Move `target` to a free place within `shift` and turn it about the vertical by up to `turn`.

    Free is what stays 5 cm away from other things and from all that moves, over the whole episode. `to` asks for a
    place of the target's middle in the world instead, `by` for one so many metres ahead and to the left of where it
    stands, as the robot sees it, both 2 cm away from other things, and `near` for a draw from places `within` so many
    metres of another thing.
    Things that the robot acts on are refused. Without a target one thing that the robot leaves alone is drawn.
    """

    target: targets.Target | None = None
    shift: Annotated[float, Field(gt=0, le=10)] = 0.15  # metres, at most
    turn: Annotated[float, Field(ge=0, le=np.pi)] = 0.5  # radians, at most
    to: tuple[float, float] | None = None
    by: tuple[float, float] | None = None  # metres
    near: targets.Target | None = None
    within: Annotated[float, Field(gt=0, le=10)] = 0.15  # metres

    effect: ClassVar[Effect] = Effect.PIXELS | Effect.BODIES
    puts: ClassVar[bool] = True
    needs: ClassVar[Needs] = Needs(targets=("target",), anchors=("near",))
    asked_as: ClassVar[Mapping[str, str]] = {
        "move": "move, moving, shift, push, pull, slide, displace, relocate, nudge, drag, transfer, "
        "pulled, pushed, end up, ends up, reposition, translate, offset, moved, shifted",
    }
    phrases: ClassVar[tuple[str, ...]] = (
        "move {target} by up to {shift:length}",
        "move {target} next to {near}",
    )
    examples: ClassVar[Examples] = (
        ("shift the mug 5 cm to the left", {"target": "mug", "by": [0, 0.05], "turn": 0}),
        ("the plate somewhere else near the box", {"target": "plate", "near": "box"}),
    )
    settles: ClassVar[str] = "place"

    def __post_init__(self) -> None:
        if sum(value is not None for value in (self.to, self.by, self.near)) > 1:
            raise ValueError("give one of `to`, `by` and `near`")

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        target = untouched.pick(scene, self.target, rng, "moving")
        instance_ids = untouched.find_untouched(scene, target, "moving")
        around = find_free_space(scene, leaving=instance_ids)
        one = standing.thing(scene, instance_ids, around, "moving")
        asked = self._asked(scene, one)
        if asked is not None:
            spot, turn = asked, float(rng.uniform(-self.turn, self.turn))
            if not around.free(standing.turned(one.outline, turn), one.top, spot):
                place = np.round(spot, 3).tolist()
                raise Unsupported(f"moving {target}: there is no room at {place}")
        else:
            found = standing.settle(one, around, self.turn, rng, self._near(scene, one))
            if found is None:
                raise Unsupported(f"moving {target}: no free place {self._where()}")
            spot, turn = found
        return {
            "handles": sorted(instance_ids),
            "motion": one.placing(spot, turn).tolist(),
            "lamps": shadows.lamps(scene),
        }

    def _asked(
        self, scene: Scene, one: standing.StandingInstance
    ) -> Float64[np.ndarray, "2"] | None:
        """The very place that is asked for, in the world."""
        if self.to is not None:
            return np.array(self.to, float)
        if self.by is None:
            return None
        frame = places.robot_frame(scene, look(scene.episode))
        return one.middle + frame[:2, :2].T @ np.array(self.by)

    def _near(self, scene: Scene, one: standing.StandingInstance) -> standing.Around:
        """What a drawn place must be close to: a point or an outline in the world, and metres."""
        if self.near is None:
            return one.middle, self.shift
        return standing.beside(scene, targets.find(scene, self.near), one.outline, self.within)

    def _where(self) -> str:
        if self.near is None:
            return f"within {100 * self.shift:.0f} cm of where it stands"
        return f"within {100 * self.within:.0f} cm of {self.near}"

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        after = standing.moved(scene, frozenset(edit["handles"]), np.array(edit["motion"]))
        return shadows.follow(scene, after, edit["lamps"])
