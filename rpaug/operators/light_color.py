"""Turn the scene's lamps to another color, as COLOSSEUM's `light_color` does."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from jaxtyping import Float32, Float64
from pydantic import Field

from rpaug.core.errors import Unsupported
from rpaug.core.interfaces import Edit, Examples, Needs, Operator
from rpaug.core.jit import kernel
from rpaug.core.types import Effect, Relit, Scene, Stacked, Surface
from rpaug.operators.fields import RGB, Unit
from rpaug.operators.shadows import NONE
from rpaug.scene.lighting import black_body, light, rig, shadows

COLOSSEUM: tuple[RGB, RGB] = ((0.0, 0.0, 0.0), (0.5, 0.5, 0.5))
Kelvin = Annotated[float, Field(ge=black_body.COLDEST, le=black_body.HOTTEST)]
Times = Annotated[float, Field(gt=0, le=4)]
MIRED = 1e6  # over kelvin
WHITE = "lights are dimmer than drawn, since white would be cut off"
DIMMED = 0.95  # times as bright as drawn: less is told


@dataclass(frozen=True)
class Gain:
    """Every surface's color times one gain per channel: light is a factor of what a matte surface shows.

    What is `unlit` shows no surface and keeps its color.
    """

    gain: tuple[float, float, float]
    unlit: tuple[int, ...] = ()
    instance_ids: frozenset[int] | None = None
    scales: ClassVar[bool] = True  # light beyond white too

    @property
    def everywhere(self) -> bool:
        """Whether it asks for no surfaces."""
        return not self.unlit and self.instance_ids is None

    def __call__(
        self, color: Float32[np.ndarray, "n 3"], surface: Surface
    ) -> Float32[np.ndarray, "n 3"]:
        lit = _scaled(color, np.array(self.gain, np.float32))
        if not self.unlit:
            return lit
        return np.where(np.isin(surface.ids, self.unlit)[:, None], color, lit)

    @staticmethod
    def stacked(several: Sequence["Gain"], device: Any) -> Stacked:
        """Edits of many images at once."""
        from rpaug.operators import stacked  # only here: it brings torch

        return stacked.gains(several, device)


@kernel
def _scaled(
    color: Float32[np.ndarray, "n 3"], gain: Float32[np.ndarray, "3"]
) -> Float32[np.ndarray, "n 3"]:
    out = np.empty_like(color)
    for n in range(len(color)):
        for k in range(3):
            out[n, k] = min(color[n, k] * gain[k], np.float32(1))
    return out


@dataclass(frozen=True, kw_only=True)
class LightColor(Operator):
    """Draw the lamps' color and scale every pixel by new over recorded.

    It is drawn uniformly from `range`, or as lamps and daylight are: a black body of a `temperature` in kelvin, drawn
    evenly in mired (10^6 / K, in which equal steps look about equal), `brightness` times as bright as recorded.
    Brightness without a temperature keeps the recorded tint.

    `recorded` is the color the episode was lit with, in the same unit: COLOSSEUM's lamps have (0.5, 0.5, 0.5), and
    `estimate` keeps that brightness and reads the chromaticity off grey surfaces. `ambient` is the share of the
    recorded light that does not come from the lamps and stays. One draw for all cameras and frames. A renderer's sky
    stays as it was. Photographs were exposed for the light that there was: what is drawn from `range` is brighter than
    that as often as darker. In them, and of lamps that are drawn, no more than up to where white would be cut off.

    `lamp` colors one lamp of those that moving shadows tell, by its number (1 is the strongest), the `strongest`, or
    `all` of them without the ambient light: each pixel's share of that light changes. Refused where they are not told.
    """

    range: tuple[RGB, RGB] = COLOSSEUM
    temperature: tuple[Kelvin, Kelvin] | None = None
    brightness: tuple[Times, Times] | None = None
    recorded: RGB | Literal["estimate"] = "estimate"
    ambient: Unit = 0.0
    lamp: Annotated[int, Field(ge=1, le=rig.MOST_LAMPS)] | Literal["strongest", "all"] | None = None

    effect: ClassVar[Effect] = Effect.RGB
    everywhere: ClassVar[bool] = True
    needs: ClassVar[Needs] = Needs(lamps="lamp")
    asked_as: ClassVar[Mapping[str, str]] = {
        "light": "mood, atmosphere, ambience, tone, ambient light, light level, sunshine, "
        "daylight, light, lights, lighting, the light, lit, illuminate, illuminated, "
        "lamp, lamps, illumination, light source, light sources, light bulb, sun, "
        "sunlight, key light, color temperature, light color, light colors, brightness, "
        "light intensity, intensity, strength, light strength, light temperature, white balance, lamp light, "
        "lighting conditions, light conditions, lighting condition, illumination conditions",
        "darker": "night, at night, night time, low light, poor light, poorly lit, darker, dark, "
        "dim, dimming, dimmer, weaker, dimmed, darken, darkened, less light, less bright, underexpose, "
        "underexposed, lower light, reduce the light",
        "brighter": "brighter, bright, brighten, lighten, lighter, more light, strong, bright light, "
        "intense, overexpose, overexposed, stronger, well lit, less dark, "
        "a bit less dark",
        "warm": "warm, warmer, evening, evening light, sunset, like evening, like in the evening, late afternoon, "
        "golden hour",
        "cool": "cool, cooler, cold, colder, bluish, blueish",
    }
    phrases: ClassVar[tuple[str, ...]] = ("change the color of the lights",)
    examples: ClassVar[Examples] = (
        ("dim the lights by half", {"brightness": [0.5, 0.5]}),
        ("a warm evening light", {"range": [[0.5, 0.38, 0.25], [0.5, 0.38, 0.25]]}),
    )
    undone_as: ClassVar[tuple[str, ...]] = (
        "light",
        "lights",
        "lighting",
        "lamp",
        "lamps",
        "illumination",
    )
    settles: ClassVar[str] = "light color"

    def __post_init__(self) -> None:
        if any(low > high for low, high in zip(*self.range, strict=True)):
            raise ValueError(f"range: low {self.range[0]} exceeds high {self.range[1]}")
        for name in ("temperature", "brightness"):
            low, high = getattr(self, name) or (0, 0)
            if low > high:
                raise ValueError(f"{name}: low {low:g} exceeds high {high:g}")
        if self._natural and self.range != COLOSSEUM:
            raise ValueError(
                "range: it says all of a color; leave out either it or `temperature` and `brightness`"
            )
        if self.recorded != "estimate" and min(self.recorded) <= 0:
            raise ValueError("recorded: each channel must exceed 0, or no gain could be told")
        if self.lamp is not None and self.ambient:
            raise ValueError("ambient: a lamp has none; leave out either it or `lamp`")

    @property
    def _natural(self) -> bool:
        return self.temperature is not None or self.brightness is not None

    @property
    def _drawn(self) -> bool:
        """Whether it is drawn at all; one exact color is as it is asked for, even where white is cut off."""
        ranges = (self.temperature, self.brightness) if self._natural else (self.range,)
        return any(one is not None and one[0] != one[1] for one in ranges)

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        recorded = (
            light.estimate(scene.episode)
            if self.recorded == "estimate"
            else np.array(self.recorded)
        )
        color = self._lamp(recorded, rng) if self._natural else rng.uniform(*np.array(self.range))
        exposed = any(view.proxy is not None for view in scene.episode.views.values())
        if exposed and not self._natural and self._drawn:
            color = color * light.LAMP / np.mean(self.range)
        held = 1.0
        if (exposed or self._natural) and self._drawn:
            held = min(held, float(light.headroom(scene.episode) / np.max(color / recorded)))
        color = held * color
        gain = self.ambient + (1 - self.ambient) * color / recorded
        edit = {
            "color": color.tolist(),
            "recorded": recorded.tolist(),
            "gain": gain.tolist(),
            "unlit": list(light.unlit(scene.episode)),
        } | ({"held_back": held} if held < 1 else {})
        return edit if self.lamp is None else edit | self._chosen(scene, self.lamp)

    def falls_short(self, edit: Edit) -> dict[str, tuple[int, int]]:
        return {WHITE: (int(edit.get("held_back", 1.0) < DIMMED), 1)}

    def _lamp(
        self, recorded: Float64[np.ndarray, "3"], rng: np.random.Generator
    ) -> Float64[np.ndarray, "3"]:
        """A black body's color, or the recorded one, so many times as bright as recorded."""
        tint = recorded / recorded.mean()
        if self.temperature is not None:
            coldest, hottest = self.temperature
            tint = black_body.hue(MIRED / rng.uniform(MIRED / hottest, MIRED / coldest))
        return np.asarray(recorded.mean() * tint * rng.uniform(*(self.brightness or (1.0, 1.0))))

    def _chosen(self, scene: Scene, lamp: int | str) -> Edit:
        """All lamps as they were recorded and are now, and the indices of those that are colored."""
        known = shadows.relit(scene)
        if known is None:
            raise Unsupported(f"light_color: which light is a lamp's is not told: {NONE}")
        count = len(known.recorded.directions)
        if isinstance(lamp, int) and lamp > count:
            raise Unsupported(f"light_color: lamp {lamp} of the {count} that cast shadows")
        both = {"recorded": shadows.plain(known.recorded), "now": shadows.plain(known.now)}
        return {"lamps": both, "colored": rig.chosen(known.recorded, lamp)}

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        red, green, blue = edit["gain"]
        if "lamps" not in edit:
            gain = Gain((red, green, blue), tuple(edit["unlit"]))
            return replace(scene, appearance=(*scene.appearance, gain))
        recorded, now = (shadows.rig_of(edit["lamps"][one]) for one in ("recorded", "now"))
        before = scene.relit or Relit(recorded, now, unlit=tuple(edit["unlit"]))
        gains = list(before.gains or [(1.0, 1.0, 1.0)] * len(recorded.directions))
        for one in edit["colored"]:
            old = gains[one]
            gains[one] = old[0] * red, old[1] * green, old[2] * blue
        return replace(scene, relit=replace(before, gains=tuple(gains)))
