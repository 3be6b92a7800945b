"""A lens out of focus."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import cv2
import numpy as np
from jaxtyping import Float64, UInt8
from pydantic import Field

from rpaug.core.interfaces import Edit, Examples
from rpaug.operators.fields import Interval
from rpaug.operators.sensing import Sensing


@dataclass(frozen=True)
class Blur:
    """A Gaussian blur of `sigma` pixels, then a straight smear of `length` pixels at `angle` (radians)."""

    sigma: float
    length: float = 0.0
    angle: float = 0.0
    seed: int = 0
    cameras: tuple[str, ...] | None = None

    def __call__(
        self, image: UInt8[np.ndarray, "h w 3"], rng: np.random.Generator
    ) -> UInt8[np.ndarray, "h w 3"]:
        blurred: object = image
        if self.sigma > 0:
            blurred = cv2.GaussianBlur(image, (0, 0), self.sigma, borderType=cv2.BORDER_REFLECT)
        if self.length > 0:
            blurred = cv2.filter2D(
                np.asarray(blurred), -1, self._smear(), borderType=cv2.BORDER_REFLECT
            )
        return np.asarray(blurred, np.uint8)

    def _smear(self) -> Float64[np.ndarray, "k k"]:
        """How much of each pixel around is seen: a line as long as the smear, its points shared by the pixels there."""
        reach = int(np.ceil(self.length / 2))
        kernel = np.zeros((2 * reach + 3, 2 * reach + 3))
        for along in np.linspace(-self.length / 2, self.length / 2, 4 * reach + 1):
            x, y = reach + 1 + along * np.cos(self.angle), reach + 1 + along * np.sin(self.angle)
            column, row = int(x), int(y)
            right, down = x - column, y - row
            kernel[row, column] += (1 - right) * (1 - down)
            kernel[row, column + 1] += right * (1 - down)
            kernel[row + 1, column] += (1 - right) * down
            kernel[row + 1, column + 1] += right * down
        return kernel / kernel.sum()


@dataclass(frozen=True, kw_only=True)
class SensorBlur(Sensing):
    """Draw the blur's standard deviation in pixels from `sigma`; all frames get the same.

    `motion` draws the length in pixels of a straight smear, as of a camera that was moved; its direction is drawn too.
    """

    sigma: Interval[Annotated[float, Field(ge=0, le=50)]] = (0.3, 1.0)
    motion: Interval[Annotated[float, Field(ge=0, le=50)]] = (0.0, 0.0)

    makes: ClassVar = Blur
    asked_as: ClassVar[Mapping[str, str]] = {
        "blur": "lens blur, gaussian blur, as if out of focus, blur, blurry, blurrier, blurred, blurring, "
        "out of focus, defocus, motion blur, simulate motion blur, motion smear",
    }
    phrases: ClassVar[tuple[str, ...]] = (
        "blur the images [by between {sigma:number} and {sigma:number} pixels]",
    )
    examples: ClassVar[Examples] = (
        ("slightly out of focus", {"sigma": [0.5, 1.0]}),
        (
            "a little motion blur in the front camera",
            {"sigma": [0, 0], "motion": [2, 4], "cameras": ["front"]},
        ),
    )
    undone_as: ClassVar[tuple[str, ...]] = ("blur",)
    settles: ClassVar[str] = "sensor blur"

    def draw(self, rng: np.random.Generator) -> Edit:
        drawn: Edit = {"sigma": float(rng.uniform(*self.sigma))}
        if self.motion[1] > 0:
            drawn["length"] = float(rng.uniform(*self.motion))
            drawn["angle"] = float(rng.uniform(0, np.pi))
        return drawn
