"""A lens out of focus."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import cv2
import numpy as np
from jaxtyping import UInt8
from pydantic import Field

from rpaug.core.interfaces import Edit, Examples, Operator
from rpaug.core.types import Effect, Scene
from rpaug.operators.fields import Interval


@dataclass(frozen=True)
class Blur:
    """A Gaussian blur of `sigma` pixels, the same in every frame."""

    sigma: float
    seed: int = 0

    def __call__(
        self, image: UInt8[np.ndarray, "h w 3"], rng: np.random.Generator
    ) -> UInt8[np.ndarray, "h w 3"]:
        blurred = cv2.GaussianBlur(image, (0, 0), self.sigma, borderType=cv2.BORDER_REFLECT)
        return np.asarray(blurred, np.uint8)


@dataclass(frozen=True, kw_only=True)
class SensorBlur(Operator):
    """Draw the blur's standard deviation in pixels from `sigma`, once for all cameras and frames."""

    sigma: Interval[Annotated[float, Field(gt=0, le=50)]] = (0.3, 1.0)

    effect: ClassVar[Effect] = Effect.RGB
    phrases: ClassVar[tuple[str, ...]] = (
        "blur the images [by between {sigma:number} and {sigma:number} pixels]",
    )
    examples: ClassVar[Examples] = (
        ("slightly out of focus", {"sigma": [0.5, 1.0]}),
        ("blur by 2 pixels", {"sigma": [2, 2]}),
    )
    undone_as: ClassVar[tuple[str, ...]] = ("blur",)
    settles: ClassVar[str] = "sensor blur"

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        return {"sigma": float(rng.uniform(*self.sigma))}

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        return replace(scene, sensor=(*scene.sensor, Blur(**edit)))
