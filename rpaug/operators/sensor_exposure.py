"""A camera that exposes longer or shorter."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np
from jaxtyping import UInt8
from pydantic import Field

from rpaug.core import color_space
from rpaug.core.interfaces import Edit, Examples, Operator
from rpaug.core.types import Effect, Scene
from rpaug.operators.fields import Interval


@dataclass(frozen=True)
class Exposure:
    """Twice the light for each of `stops`, clipped where the display ends."""

    stops: float
    seed: int = 0

    def __call__(
        self, image: UInt8[np.ndarray, "h w 3"], rng: np.random.Generator
    ) -> UInt8[np.ndarray, "h w 3"]:
        return self._table[image]

    @cached_property
    def _table(self) -> UInt8[np.ndarray, "256"]:
        light = color_space.to_linear(np.arange(256) / 255.0) * 2.0**self.stops
        return np.rint(255 * np.clip(color_space.from_linear(light), 0, 1)).astype(np.uint8)


@dataclass(frozen=True, kw_only=True)
class SensorExposure(Operator):
    """Draw the change in stops (photographic doublings of light) from `stops`, once for all cameras and frames."""

    stops: Interval[Annotated[float, Field(ge=-8, le=8)]] = (-1.0, 1.0)

    effect: ClassVar[Effect] = Effect.RGB
    phrases: ClassVar[tuple[str, ...]] = ("vary the exposure",)
    examples: ClassVar[Examples] = (
        ("one stop brighter", {"stops": [1, 1]}),
        ("under- and overexposed by up to half a stop", {"stops": [-0.5, 0.5]}),
    )
    undone_as: ClassVar[tuple[str, ...]] = ("exposure",)
    settles: ClassVar[str] = "sensor exposure"

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        return {"stops": float(rng.uniform(*self.stops))}

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        return replace(scene, sensor=(*scene.sensor, Exposure(**edit)))
