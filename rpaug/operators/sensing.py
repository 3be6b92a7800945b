"""What the operators share that change what a camera makes of its picture: once for all cameras, or for each alone."""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rpaug.core.errors import TargetError, there_are
from rpaug.core.interfaces import Edit, Operator
from rpaug.core.types import Effect, Scene, Sensor


@dataclass(frozen=True, kw_only=True)
class Sensing(Operator):
    """Base of the sensor operators. `cameras` names those it happens in, None for all; `each` draws for each anew."""

    cameras: tuple[str, ...] | None = None
    each: bool = False

    effect: ClassVar[Effect] = Effect.RGB
    everywhere: ClassVar[bool] = True
    makes: ClassVar[Callable[..., Sensor]]

    @abstractmethod
    def draw(self, rng: np.random.Generator) -> Edit:
        """The values of one effect."""

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        names = self.cameras or tuple(scene.cameras)
        if unknown := sorted(set(names) - set(scene.cameras)):
            raise TargetError(
                f"no camera is called {unknown[0]!r}; {there_are(unknown[0], scene.cameras)}"
            )
        if self.each:
            return {"each": {name: self.draw(rng) for name in names}}
        return self.draw(rng) | ({"cameras": list(names)} if self.cameras else {})

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        drawn = [one | {"cameras": [name]} for name, one in edit.get("each", {}).items()]
        return replace(
            scene, sensor=(*scene.sensor, *(self._effect(one) for one in drawn or [edit]))
        )

    def _effect(self, values: Edit) -> Sensor:
        cameras = values.get("cameras")
        given = {name: value for name, value in values.items() if name != "cameras"}
        return type(self).makes(**given, cameras=None if cameras is None else tuple(cameras))
