"""Values that recipes give to several operators."""

import colorsys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema

from rpaug.core import color_space as color
from rpaug.core.errors import there_are

Unit = Annotated[float, Field(ge=0, le=1)]


def _channels(value: Any) -> Any:
    return color.from_hex(value) or value if isinstance(value, str) else value


HEX_SCHEMA = {"type": "string", "pattern": f"^{color.HEX.pattern}$"}
RGB = Annotated[
    tuple[Unit, Unit, Unit],
    BeforeValidator(_channels),
    WithJsonSchema(
        {
            "oneOf": [
                {
                    "type": "array",
                    "items": {"type": "number", "minimum": 0, "maximum": 1},
                    "minItems": 3,
                    "maxItems": 3,
                },
                HEX_SCHEMA,
            ]
        }
    ),
]
"""Three channels in 0..1, or `#rrggbb`."""

Triple = tuple[float, float, float]
ALIKE = 0.95  # cosine between two colors: those of lime and green are 1, of red and orange 0.89
REDRAWN = 20  # times a color of a range, before it is one like another thing's

Number = TypeVar("Number", int, float)


def _ordered(value: tuple[Number, Number]) -> tuple[Number, Number]:
    if value[0] > value[1]:
        raise ValueError(f"low {value[0]} exceeds high {value[1]}")
    return value


Interval = Annotated[tuple[Number, Number], AfterValidator(_ordered)]
"""Low and high of what is drawn uniformly."""


def seed(rng: np.random.Generator) -> int:
    """A seed to be stored with an edit, from which its noise is made again."""
    return int(rng.integers(2**32))


@dataclass(frozen=True)
class Palette:
    """Display sRGB colors of which one is drawn: some, or those whose hue (degrees), saturation and value lie within
    `hsv`, two bounds each.

    A range of hues may go through 0: from 350 to 10 is red. An `exact` color is shown as it is, others as paint is.
    """

    colors: tuple[Triple, ...] = ()
    hsv: tuple[tuple[float, float], ...] = ()
    exact: bool = False

    def draw(self, rng: np.random.Generator, taken: Sequence[Triple] = ()) -> list[float]:
        """One color, each as likely; drawn again while it is like one that is `taken`, if there are others."""
        if self.hsv:
            drawn = self._ranged(rng)
            for _ in range(REDRAWN):
                if not _any_alike(drawn, taken):
                    break
                drawn = self._ranged(rng)
            return list(drawn)
        apart = [one for one in self.colors if not _any_alike(one, taken)]
        drawn = self.colors[int(rng.integers(len(self.colors)))]
        if apart and drawn not in apart:
            drawn = apart[int(rng.integers(len(apart)))]
        return list(drawn)

    def _ranged(self, rng: np.random.Generator) -> Triple:
        (low, high), *rest = self.hsv
        hue = rng.uniform(low, high if high >= low else high + 360) % 360
        saturation, value = (float(rng.uniform(*one)) for one in rest)
        return colorsys.hsv_to_rgb(hue / 360, saturation, value)


def _any_alike(one: Triple, others: Sequence[Triple]) -> bool:
    return any(_alike(one, other) for other in others)


def _alike(one: Triple, other: Triple) -> bool:
    """Can shading make one color look like the other? It scales a color and leaves its direction."""
    long = np.linalg.norm(one) * np.linalg.norm(other)
    return float(np.dot(one, other)) > ALIKE * float(long)


def _palette(value: Any) -> Palette:
    if isinstance(value, Palette):
        return value
    if isinstance(value, str):
        if (exact := color.from_hex(value)) is not None:
            return Palette((exact,), exact=True)
        name = color.canonical(value)
        if name is None:
            raise ValueError(f"no such color word; {there_are(value, color.NAMES)}")
        return Palette((color.NAMES[name],))
    if isinstance(value, dict) and len(value) == 1:
        ((kind, content),) = value.items()
        if kind == "sample" and content == "colosseum":
            return Palette(tuple(color.RLBENCH.values()))
        if kind == "rgb":
            return Palette((_triple(content, [(0, 1)] * 3),), exact=True)
        if kind == "lab":
            lab = _triple(content, [(0, 100), (-128, 128), (-128, 128)])
            red, green, blue = np.clip(color.from_lab(np.array(lab)), 0, 1)
            return Palette(((float(red), float(green), float(blue)),), exact=True)
        if kind == "hsv":
            return Palette(hsv=_ranges(content))
    raise ValueError(
        "expected a color word, '#rrggbb' in quotes, {rgb: [r, g, b]} in 0..1, {lab: [L, a, b]}, "
        "{hsv: [[low, high] of hue in degrees, of saturation, of value]} or {sample: colosseum}"
    )


def _ranges(content: Any) -> tuple[tuple[float, float], ...]:
    if not isinstance(content, list | tuple) or len(content) != 3:
        raise ValueError("expected ranges of hue, saturation and value")
    given = []
    for value, most in zip(content, (360, 1, 1), strict=True):
        low, high, _ = _triple(
            [*value, 0] if isinstance(value, list | tuple) else value, [(0, most)] * 3
        )
        if most == 1 and low > high:
            raise ValueError(f"low {low} exceeds high {high}")
        given.append((low, high))
    return tuple(given)


def _triple(content: Any, bounds: list[tuple[float, float]]) -> Triple:
    if not isinstance(content, list | tuple) or len(content) != 3:
        raise ValueError("expected three numbers")
    for value, (low, high) in zip(content, bounds, strict=True):
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not low <= value <= high
        ):
            raise ValueError(f"{value!r} is not within {low}..{high}")
    first, second, third = map(float, content)
    return first, second, third


Color = Annotated[
    Palette,
    BeforeValidator(_palette),
    WithJsonSchema(
        {
            "oneOf": [
                {"enum": list(color.NAMES)},
                HEX_SCHEMA,
                *(
                    {
                        "type": "object",
                        "properties": {
                            kind: {
                                "type": "array",
                                "items": {"type": "number"},
                                "minItems": 3,
                                "maxItems": 3,
                            }
                        },
                        "required": [kind],
                        "additionalProperties": False,
                    }
                    for kind in ("rgb", "lab")
                ),
                {
                    "type": "object",
                    "properties": {
                        "hsv": {
                            "type": "array",
                            "items": {
                                "type": "array",
                                "items": {"type": "number"},
                                "minItems": 2,
                                "maxItems": 2,
                            },
                            "minItems": 3,
                            "maxItems": 3,
                        }
                    },
                    "required": ["hsv"],
                    "additionalProperties": False,
                },
                {
                    "type": "object",
                    "properties": {"sample": {"const": "colosseum"}},
                    "required": ["sample"],
                    "additionalProperties": False,
                },
            ]
        }
    ),
]
