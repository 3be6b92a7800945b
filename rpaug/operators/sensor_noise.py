"""Noise of the camera's sensor: some in the dark, and more in bright light."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from jaxtyping import UInt8
from pydantic import Field

from rpaug.core.interfaces import Edit, Examples
from rpaug.operators.fields import Interval, seed
from rpaug.operators.sensing import Sensing

Amount = Annotated[float, Field(ge=0, le=1)]


@dataclass(frozen=True)
class Noise:
    """Gaussian noise of variance read^2 + shot x value, new in every frame."""

    read: float
    shot: float
    seed: int
    cameras: tuple[str, ...] | None = None

    def __call__(
        self, image: UInt8[np.ndarray, "h w 3"], rng: np.random.Generator
    ) -> UInt8[np.ndarray, "h w 3"]:
        spread = np.sqrt(self.read**2 + self.shot * np.arange(256) / 255).astype(np.float32) * 255
        noise = rng.standard_normal(image.shape, np.float32)
        return np.clip(np.rint(image + spread[image] * noise), 0, 255).astype(np.uint8)


@dataclass(frozen=True, kw_only=True)
class SensorNoise(Sensing):
    """Draw the noise's strength once, uniformly; the noise itself is new in every camera and frame.

    `read` is its standard deviation in the dark and `shot` the variance that full brightness adds, both of values 0..1
    (the Poissonian-Gaussian model, Foi et al. 2008).
    """

    read: Interval[Amount] = (0.0, 0.02)
    shot: Interval[Amount] = (0.0, 0.001)

    makes: ClassVar = Noise
    asked_as: ClassVar[Mapping[str, str]] = {
        "noise": "noise sigma, noise level, noise std, white noise, camera noise, gaussian noise, "
        "noise, noisy, grain, grainy, sensor noise, image noise, noisier",
    }
    phrases: ClassVar[tuple[str, ...]] = ("add noise to the images",)
    examples: ClassVar[Examples] = (
        ("grainy images", {"read": [0.01, 0.03]}),
        ("noise of up to 3 %", {"read": [0, 0.03]}),
    )
    undone_as: ClassVar[tuple[str, ...]] = ("noise",)
    settles: ClassVar[str] = "sensor noise"

    def draw(self, rng: np.random.Generator) -> Edit:
        return {
            "read": float(rng.uniform(*self.read)),
            "shot": float(rng.uniform(*self.shot)),
            "seed": seed(rng),
        }
