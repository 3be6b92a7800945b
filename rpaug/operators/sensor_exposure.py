"""A camera that exposes longer or shorter."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from jaxtyping import UInt8
from pydantic import Field

from rpaug.core import color_space
from rpaug.core.interfaces import Edit, Examples
from rpaug.operators.fields import Interval, seed
from rpaug.operators.sensing import Sensing

Factor = Annotated[float, Field(gt=0, le=8)]
Factors = tuple[Factor, Factor, Factor]
FAINTEST = 0.25  # times as recorded: fainter colors would not be told by an instruction's words
LUMA = np.array([0.299, 0.587, 0.114], np.float32)


@dataclass(frozen=True)
class Exposure:
    """Twice the light for each of `stops`, times `gains` of red, green and blue, clipped where the display ends.

    What is displayed (0..1) is then raised to `gamma`: above 1 the middle tones are darker. Its distance from a half is
    taken `contrast` times, then a color's distance from the gray of its luma (ITU-R BT.601) `saturation` times. Each
    frame is up to `flicker` stops off, evenly.
    """

    stops: float
    gains: tuple[float, float, float] = (1.0, 1.0, 1.0)
    gamma: float = 1.0
    contrast: float = 1.0
    saturation: float = 1.0
    flicker: float = 0.0
    seed: int = 0
    cameras: tuple[str, ...] | None = None

    def __call__(
        self, image: UInt8[np.ndarray, "h w 3"], rng: np.random.Generator
    ) -> UInt8[np.ndarray, "h w 3"]:
        off = rng.uniform(-self.flicker, self.flicker) if self.flicker else 0.0
        shown = np.take_along_axis(self._table(off), image.reshape(-1, 3), 0).reshape(image.shape)
        if self.saturation == 1:
            return shown
        gray = shown @ LUMA
        apart = self.saturation * (shown - gray[..., None])
        return np.clip(np.rint(gray[..., None] + apart), 0, 255).astype(np.uint8)

    def _table(self, off: float) -> UInt8[np.ndarray, "256 3"]:
        """What each level is displayed as where a frame is so many stops off."""
        light = color_space.to_linear(np.arange(256) / 255.0)[:, None] * 2.0 ** (self.stops + off)
        shown = np.clip(color_space.from_linear(light * np.array(self.gains)), 0, 1)
        apart = self.contrast * (shown**self.gamma - 0.5)
        return np.rint(255 * np.clip(0.5 + apart, 0, 1)).astype(np.uint8)


@dataclass(frozen=True, kw_only=True)
class SensorExposure(Sensing):
    """Draw the change in stops (photographic doublings of light) from `stops`; all frames get the same.

    `gain` draws a factor of light for red, green and blue each, as a wrong white balance has it: between two numbers,
    or between two of each channel's own. `gamma` is the power to which what is displayed is raised; `contrast` and
    `saturation` are times as recorded, of what is displayed. `flicker` draws by how many stops frames are off at most:
    lamps on mains, which every camera meets at another moment in every frame.
    """

    stops: Interval[Annotated[float, Field(ge=-8, le=8)]] = (-1.0, 1.0)
    gain: Interval[Factor] | tuple[Factors, Factors] = (1.0, 1.0)
    gamma: Interval[Annotated[float, Field(ge=0.1, le=10)]] = (1.0, 1.0)
    contrast: Interval[Annotated[float, Field(ge=FAINTEST, le=8)]] = (1.0, 1.0)
    saturation: Interval[Annotated[float, Field(ge=FAINTEST, le=8)]] = (1.0, 1.0)
    flicker: Interval[Annotated[float, Field(ge=0, le=4)]] = (0.0, 0.0)

    makes: ClassVar = Exposure
    asked_as: ClassVar[Mapping[str, str]] = {
        "exposure": "exposure, exposures, overexpose, overexposed, underexpose, underexposed",
        "gain": "white balance gain, white balance gains, gains, gain",
        "gamma": "gamma",
        "contrast": "contrast, contrasts, image contrast, contrasty",
        "saturation": "saturation, saturations, color saturation, saturated, desaturate, desaturated",
        "flicker": "flicker, flickers, flickering, mains flicker, light flicker, simulate flicker, "
        "simulate mains flicker, from frame to frame, frame to frame, frame by frame, between frames, per frame, "
        "from one frame to the next",
    }
    phrases: ClassVar[tuple[str, ...]] = ("vary the exposure",)
    examples: ClassVar[Examples] = (
        ("one stop brighter", {"stops": [1, 1]}),
        (
            "each camera off by up to half a stop and 5 % of white balance",
            {"stops": [-0.5, 0.5], "gain": [0.95, 1.05], "each": True},
        ),
        (
            "a bluish cast in the wrist camera alone",
            {"stops": [0, 0], "gain": [[0.9, 1, 1.15], [0.9, 1, 1.15]], "cameras": ["wrist"]},
        ),
        ("colors of half to full strength", {"stops": [0, 0], "saturation": [0.5, 1]}),
        ("flickering lights", {"stops": [0, 0], "flicker": [0.2, 0.5]}),
    )
    undone_as: ClassVar[tuple[str, ...]] = ("exposure", "flicker", "contrast", "saturation")
    settles: ClassVar[str] = "sensor exposure"

    def __post_init__(self) -> None:
        low, high = np.array(self.gain)
        if np.any(low > high):
            raise ValueError(f"gain: low {self.gain[0]} exceeds high {self.gain[1]}")

    def draw(self, rng: np.random.Generator) -> Edit:
        drawn: Edit = {"stops": float(rng.uniform(*self.stops))}
        if self.gain != (1, 1):
            low, high = np.array(self.gain)
            drawn["gains"] = rng.uniform(low, high, 3).tolist()
        for name in ("gamma", "contrast", "saturation"):
            if (ends := getattr(self, name)) != (1, 1):
                drawn[name] = float(rng.uniform(*ends))
        if self.flicker[1] > 0:
            drawn["flicker"], drawn["seed"] = float(rng.uniform(*self.flicker)), seed(rng)
        return drawn
