"""Numbers, units, colors and directions in English, as patterns and as values."""

import math
import re
from collections.abc import Mapping

from rpaug.core import color_space
from rpaug.language.messages import NotUnderstood

WORDS: dict[str, float] = {
    **{w: n for n, w in enumerate(("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine"))},
    **{w: n for n, w in enumerate(("ten", "eleven", "twelve", "thirteen", "fourteen", "fifteen"), 10)},
    **{w: 10 * n for n, w in enumerate(("twenty", "thirty", "forty", "fifty", "sixty", "seventy", "eighty"), 2)},
    "ninety": 90,
    "a dozen": 12, "half a": 0.5, "half an": 0.5, "a quarter": 0.25, "half": 0.5, "a third": 1 / 3,
    "a hundred": 100, "one and a half": 1.5, "two and a half": 2.5, "a": 1, "an": 1, "a couple of": 2, "a pair of": 2,
}  # fmt: skip
WORDS = WORDS | {
    f"{tens}{between}{ones}": WORDS[tens] + WORDS[ones]
    for tens in ("twenty", "thirty", "forty", "fifty", "sixty", "seventy", "eighty", "ninety")
    for between in ("-", " ")
    for ones in ("one", "two", "three", "four", "five", "six", "seven", "eight", "nine")
}
METRES: Mapping[str, float] = {
    **dict.fromkeys(("m", "metre", "metres", "meter", "meters"), 1.0),
    **dict.fromkeys(("cm", "centimetre", "centimetres", "centimeter", "centimeters"), 0.01),
    **dict.fromkeys(("mm", "millimetre", "millimetres", "millimeter", "millimeters"), 0.001),
    **dict.fromkeys(("inch", "inches"), 0.0254),
    **dict.fromkeys(("ft", "foot", "feet"), 0.3048),
}
RADIANS: Mapping[str, float] = {
    **dict.fromkeys(("degree", "degrees", "deg", "°"), math.pi / 180),
    **dict.fromkeys(("radian", "radians", "rad"), 1.0),
}


def any_of(words: Mapping[str, object] | frozenset[str] | tuple[str, ...]) -> str:
    """A pattern for one of these words, the longest first."""
    return "(?:" + "|".join(re.escape(w) for w in sorted(words, key=len, reverse=True)) + ")"


DIGITS = r"-?(?:\d+(?:\.\d+)?|\.\d+)"
NUMBER = rf"(?:{DIGITS}|{any_of(WORDS)})"
LENGTH = rf"(?:{NUMBER} ?{any_of(METRES)})(?![a-z])"
ANGLE = rf"(?:{NUMBER} ?{any_of(RADIANS)})(?![a-z])"
PERCENT = rf"(?:{NUMBER} ?(?:%|percent|per cent)|a half|half|a quarter|a third)"
POINT = rf"\(? ?{DIGITS} ?, ?{DIGITS} ?\)?"
TRIPLE = rf"\(? ?{DIGITS} ?, ?{DIGITS} ?, ?{DIGITS} ?\)?"

SHADES = {"dark": "dark", "deep": "dark", "light": "light", "pale": "light", "bright": ""}
ONE_COLOR = rf"(?:(?:{any_of(SHADES)} )?{any_of({**color_space.NAMES, **color_space.ALIASES})})"
TINT = rf"(?:{ONE_COLOR}|rgb ?{TRIPLE}|#[0-9a-f]{{6}})"
ANY_COLOR = r"(?:(?:a |any |some |another )?(?:random|other|different|new)? ?colou?r)"
COLOR = rf"(?:(?:an? )?{TINT}(?: colou?r)?|{ANY_COLOR})"


def number(text: str) -> float:
    """The value of digits or number words."""
    text = text.strip()
    return float(WORDS[text]) if text in WORDS else float(text)


def tidy(value: float) -> float:
    """A whole number as one."""
    return int(value) if value == int(value) else value


def rounded(value: float) -> float:
    """To a tenth of a millimetre, or of a milliradian."""
    return round(value, 4)


def _measured(text: str, units: Mapping[str, float]) -> float:
    unit = next(u for u in sorted(units, key=len, reverse=True) if text.endswith(u))
    return rounded(number(text[: -len(unit)]) * units[unit])


def length(text: str) -> float:
    """Metres."""
    return _measured(text, METRES)


def angle(text: str) -> float:
    """Radians."""
    return _measured(text, RADIANS)


def share(text: str) -> float:
    """0.2 for "20%", and 0.5 for "half"."""
    bare = re.sub(r" ?(?:%|percent|per cent)$", "", text)
    value = number(bare.removeprefix("a ") if bare == "a half" else bare)
    return rounded(value / 100 if bare != text else value)


def count(text: str) -> int:
    """A whole number of at least 1. Raises NotUnderstood."""
    value = number(text)
    if value != int(value) or value < 1:
        raise NotUnderstood(f"{text!r} is no number of things")
    return int(value)


def numbers(text: str) -> list[float]:
    """All numbers in digits, whole ones as they are."""
    return [int(v) if v == int(v) else v for v in (float(d) for d in re.findall(DIGITS, text))]


def color(text: str) -> str | dict[str, object]:
    """A recipe's color for what matched `COLOR`. Raises NotUnderstood."""
    if re.fullmatch(ANY_COLOR, text):
        return {"sample": "colosseum"}
    text = re.sub(r"^an? | colou?r$", "", text)
    if text.startswith("#"):
        return {"rgb": [round(int(text[i : i + 2], 16) / 255, 3) for i in (1, 3, 5)]}
    if text.startswith("rgb"):
        values = [float(v) for v in numbers(text)]
        scale = 255 if max(values) > 1 else 1
        if not all(0 <= v <= scale for v in values):
            raise NotUnderstood(f"{text!r}: rgb values lie within 0..1 or 0..255")
        return {"rgb": [round(v / scale, 3) for v in values]}
    shade, _, name = text.rpartition(" ")
    name = color_space.canonical(name) or name
    if SHADES.get(shade, "") == "dark":
        return {"rgb": darker(name, 0.5)}
    if SHADES.get(shade, "") == "light":
        return {"rgb": lighter(name, 0.5)}
    return name


def darker(tint: str | dict[str, object], factor: float) -> list[float]:
    """A color's rgb times a factor."""
    return [round(factor * v, 3) for v in rgb(tint)]


def lighter(tint: str | dict[str, object], part: float) -> list[float]:
    """A color's rgb taken a part of the way to white."""
    return [round(v + part * (1 - v), 3) for v in rgb(tint)]


def rgb(tint: str | dict[str, object]) -> list[float]:
    """The display sRGB of a recipe's color. Raises NotUnderstood for one that is drawn."""
    if isinstance(tint, str):
        return list(color_space.rgb(tint))
    values = tint.get("rgb")
    if not isinstance(values, list):
        raise NotUnderstood("its colour is drawn at random, so it has no darker or lighter one")
    return [float(v) for v in values]
