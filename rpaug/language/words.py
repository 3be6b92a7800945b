"""Words into tokens: quantities with units, colors, textures, cameras, what may be done, and what is left: things."""
# ruff: noqa: E501  # patterns and word lists are easiest to read whole

import colorsys
import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from rpaug.assets.textures import shipped
from rpaug.core import color_space
from rpaug.language.messages import NotUnderstood
from rpaug.scene.targets import relations

SMALL = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve",
         "thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen", "nineteen")  # fmt: skip
TENS = ("twenty", "thirty", "forty", "fifty", "sixty", "seventy", "eighty", "ninety")
WORDS: Mapping[str, float] = {
    **{word: n for n, word in enumerate(SMALL)},
    **{word: 10 * n for n, word in enumerate(TENS, 2)},
    **{f"{t}{gap}{o}": 10 * n + m for n, t in enumerate(TENS, 2) for m, o in enumerate(SMALL[1:10], 1) for gap in "- "},
    "a dozen": 12, "half a dozen": 6, "a couple of": 2, "a couple": 2, "couple of": 2, "a pair of": 2, "a hundred": 100,
    "half a": 0.5, "half an": 0.5, "one and a half": 1.5, "a half": 0.5, "half": 0.5, "a third": 1 / 3, "a quarter": 0.25,
    "a fifth": 0.2, "a tenth": 0.1, "two thirds": 2 / 3, "three quarters": 0.75, "a": 1, "an": 1,
}  # fmt: skip
UNITS: Mapping[str, tuple[str, float]] = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), ("length", 1.0)),
    **dict.fromkeys(("cm", "centimeter", "centimeters", "centimetre", "centimetres"), ("length", 0.01)),
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), ("length", 0.001)),
    **dict.fromkeys(("inch", "inches"), ("length", 0.0254)),
    **dict.fromkeys(("ft", "foot", "feet"), ("length", 0.3048)),
    **dict.fromkeys(("degree", "degrees", "deg", "degs", "°"), ("angle", math.pi / 180)),
    **dict.fromkeys(("radian", "radians", "rad"), ("angle", 1.0)),
    **dict.fromkeys(("%", "percent", "per cent"), ("share", 0.01)),
    **dict.fromkeys(("stop", "stops", "ev", "f-stop", "f-stops"), ("stops", 1.0)),
    **dict.fromkeys(("k", "kelvin"), ("kelvin", 1.0)),
    **dict.fromkeys(("px", "pixel", "pixels"), ("pixels", 1.0)),
    **dict.fromkeys(("x", "times", "×"), ("times", 1.0)),
}  # fmt: skip


def bag(text: str) -> frozenset[str]:
    """The words of a text."""
    return frozenset(text.split())


def any_of(words: Sequence[str] | Mapping[str, object]) -> str:
    """A pattern for one of these words, the longest first."""
    return "(?:" + "|".join(re.escape(w) for w in sorted(words, key=len, reverse=True)) + ")"


DIGITS = r"[-]?(?:\d+(?:\.\d+)?|\.\d+)"
NUMBER = rf"(?:{DIGITS}|{any_of(WORDS)}(?![a-z]))"
UNIT = rf"(?:{any_of(UNITS)}(?![a-z]))"
BEFORE = {
    "upto": ("up to", "at most", "max", "maximum", "maximal", "no more than", "within", "not more than", "a maximum of", "less than"),
    "about": ("±", "by plus or minus", "plus or minus"),
    "least": ("at least", "no less than", "more than"),
    "exact": ("about", "around", "roughly", "approximately", "some", "exactly", "by a factor of", "a factor of"),
}  # fmt: skip
HOW = {word: how for how, words in BEFORE.items() for word in words}
QUANTITY = re.compile(
    rf"(?:(?:by|of|anywhere|somewhere|uniformly|a) )*?(?:(?P<how>{any_of(HOW)}) ?)*(?:(?:between|from|anything) )?(?P<low>{NUMBER})[ -]?(?P<unit>{UNIT})?"
    rf"(?: ?(?:-|to|and) ?(?P<high>{NUMBER})[ -]?(?P<unit2>{UNIT})?)?(?P<most> at most| max| maximum)?(?![a-z0-9])"
)
POINT = re.compile(rf"\(? ?{DIGITS} ?, ?{DIGITS}(?: ?, ?{DIGITS})? ?\)?(?![\d%a-z])")

SHADES = {"dark": "dark", "deep": "dark", "light": "light", "pale": "light", "bright": "", "vivid": "", "plain": "", "pure": "", "mid": ""}  # fmt: skip
TINTS: Mapping[str, Any] = {
    "navy blue": "navy", "sky blue": "azure", "light blue": {"rgb": [0.5, 0.75, 1.0]}, "lime green": "lime", "olive green": "olive",
    "forest green": {"rgb": [0.13, 0.4, 0.13]}, "royal blue": {"rgb": [0.25, 0.41, 0.88]}, "baby blue": {"rgb": [0.6, 0.8, 0.95]},
    "off-white": {"rgb": [0.96, 0.94, 0.88]}, "off white": {"rgb": [0.96, 0.94, 0.88]}, "cream": {"rgb": [0.96, 0.94, 0.82]},
    "wine red": "maroon", "anthracite": {"rgb": [0.22, 0.24, 0.26]}, "charcoal": {"rgb": [0.21, 0.22, 0.24]}, "mint": {"rgb": [0.6, 0.95, 0.75]},
    "salmon": {"rgb": [0.98, 0.5, 0.45]}, "coral": {"rgb": [1.0, 0.5, 0.31]}, "peach": {"rgb": [1.0, 0.8, 0.64]}, "mustard": {"rgb": [0.85, 0.68, 0.2]},
    "plum": {"rgb": [0.45, 0.2, 0.42]}, "bronze": {"rgb": [0.8, 0.5, 0.2]}, "chocolate": {"rgb": [0.35, 0.2, 0.1]},
    "golden": "gold", **{name: name for name in color_space.NAMES}, **color_space.ALIASES,
}  # fmt: skip
TINT = rf"(?:(?:{any_of(SHADES)}[ -])*{any_of(TINTS)}(?:ish)?(?![a-z]))"
MANNERS: Mapping[str, Any] = {  # saturation and value that colors of a manner have
    **dict.fromkeys(("pastel", "pale", "soft"), ((0.15, 0.45), (0.85, 1))),
    **dict.fromkeys(("vivid", "saturated", "bright", "strong", "intense", "neon"), ((0.8, 1), (0.75, 1))),
    **dict.fromkeys(("muted", "dull", "faded"), ((0.15, 0.4), (0.4, 0.7))),
    **dict.fromkeys(("dark", "deep"), ((0.5, 1), (0.15, 0.4))),
}  # fmt: skip
ANYHOW = r"(?:(?:random|randomly|different|various|some|any|an?|slightly|other|in) )*"
HUED = r"(?:colou?rs?|tones?|shades?|hues?|tints?)"
PART = rf"(?:hue|sat(?:uration)?|val(?:ue)?|brightness)(?: of| in| between| from)? ?{DIGITS} ?(?:-|to|and) ?{DIGITS}(?: ?degrees)?"
HSV = rf"(?=[^;]*\b(?:hsv|hue|sat))(?:uniformly )?(?:in )?(?:hsv )?\(? ?{PART}(?: ?, ?(?:and )?{PART})* ?\)?"
VARIED = rf"{ANYHOW}{HUED} of {TINT}|{ANYHOW}{TINT}(?: {HUED}|s? with (?:a bit of|a little|some|slight|small|mild|little) variations?)|random {TINT}"
COLOR = rf"(?:{HSV}|{ANYHOW}(?:{any_of(MANNERS)}|neutral) {HUED}(?![a-z])|(?:{VARIED})(?<!color)(?<!colors)(?![a-z])|{TINT}|rgb ?\(? ?{DIGITS} ?, ?{DIGITS} ?, ?{DIGITS} ?\)?|#[0-9a-f]{{6}})"
COLORS = re.compile(rf"(?:(?:either|an?|one of|some) )*{COLOR}(?:(?:, ?or |, ?| or )(?:an? )?{COLOR}(?=.* or |,? or ))*(?:,? or (?:an? )?{COLOR})*(?: colou?r| paint)?(?![a-z])")  # fmt: skip
KINDS = {
    **dict.fromkeys(("wood", "wooden", "timber", "veneer"), "wood"),
    **dict.fromkeys(("stone", "rock", "rocky"), "stone"),
    **dict.fromkeys(("fabric", "cloth", "textile"), "fabric"),
    **dict.fromkeys(("metal", "metallic"), "metal"),
    **dict.fromkeys(("checker", "checkered", "chequered", "checked", "checkerboard"), "checker"),
}
LIKE = {"brick": "bricks", "tile": "tiles", "tiled": "tiles", "striped": "stripes", "stripe": "stripes", "plank": "planks", "dotted": "dots", "grey": "gray"}  # fmt: skip


@dataclass(frozen=True)
class Amount:
    """A quantity in metres, radians, parts, stops, ...: `how` says whether it is exact, at most, at least or a range."""

    low: float
    high: float
    how: str = "exact"

    @property
    def ends(self) -> tuple[float, float]:
        """Between which values it lies, along one direction."""
        low = {"upto": 0.0, "about": -self.high}.get(self.how, self.low)
        return low, self.high


@dataclass(frozen=True)
class Token:
    """Some words, what kind they are of, and their value."""

    kind: str
    text: str
    value: Any = None


def number(text: str) -> float:
    """The value of digits or number words."""
    return float(WORDS[text]) if text in WORDS else float(text)


def tidy(value: float) -> float:
    """A whole number as one, any other to a tenth of a thousandth."""
    return int(value) if value == int(value) else round(value, 4)


def quantity(found: re.Match[str]) -> Token | None:
    """The quantity that a match of `QUANTITY` stands for; None for an article."""
    joined = re.search(r"\band\b", found.group()) is not None and "between" not in found.group()
    mixed = found["unit"] and found["unit2"] and UNITS[found["unit"]][0] != UNITS[found["unit2"]][0]
    if found["high"] and (mixed or joined):  # "2 cm and 3 degrees" are two
        first = QUANTITY.fullmatch(
            found.group()[
                : (found.end("unit") if found["unit"] else found.end("low")) - found.start()
            ]
        )
        return quantity(first) if first else None
    unit = found["unit2"] or found["unit"]
    if unit is None and (
        found["low"] in ("a", "an", "half a", "half an") or found["how"] == "some"
    ):
        return None
    if unit is None and (
        found["low"] == "half" or found["low"].startswith(("a ", "two th", "three q"))
    ):
        unit = (
            "x"
            if found["low"] not in ("a dozen", "a couple of", "a couple", "a pair of", "a hundred")
            else None
        )
    kind, factor = UNITS[unit] if unit else ("number", 1.0)
    low = tidy(number(found["low"]) * factor)
    high = tidy(number(found["high"]) * factor) if found["high"] else low
    if low == -high and high:
        return Token(kind, found.group(), Amount(abs(high), abs(high), "about"))
    how = (
        "upto"
        if found["most"]
        else HOW.get(found["how"] or "", "range" if found["high"] else "exact")
    )
    return Token(kind, found.group(), Amount(min(low, high), max(low, high), how))


def colors(text: str) -> list[Any]:
    """The recipe's colors that a text lists. Raises NotUnderstood for an rgb beyond its range."""
    return list(
        itertools.chain.from_iterable(_tints(one.group()) for one in re.finditer(COLOR, text))
    )


def _tints(text: str) -> list[Any]:
    """A color, several, or a range of hues, saturations and values, of which one is drawn."""
    if parts := re.findall(PART, text):
        ends = {
            part[:3]: sorted(map(float, re.findall(DIGITS.removeprefix("[-]?"), part)))
            for part in parts
        }
        ends["val"] = ends.get("val") or ends.get("bri") or [0.3, 1]
        return [{"hsv": [ends.get("hue", [0, 360]), ends.get("sat", [0.5, 1]), ends["val"]]}]
    manner = re.fullmatch(rf"{ANYHOW}({any_of(MANNERS)}|neutral) {HUED}", text)
    if manner:
        return (
            ["white", "gray", "black"]
            if manner[1] == "neutral"
            else [{"hsv": [[0, 360], *map(list, MANNERS[manner[1]])]}]
        )
    tint = re.search(TINT, text)
    if tint is None or tint.group() == text or re.fullmatch(rf"{TINT} colou?rs?", text):
        return [_color(tint.group() if tint else text)]
    hue, saturation, value = colorsys.rgb_to_hsv(*rgb(_color(tint.group())))
    near = [(360 * hue - 12) % 360, (360 * hue + 12) % 360] if saturation else [0, 0]
    around = [
        [max(0.0, one - wide), min(1.0, one + wide)]
        for one, wide in ((saturation, 0.25 * (saturation > 0)), (value, 0.2))
    ]
    return [{"hsv": [[tidy(one) for one in ends] for ends in (near, *around)]}]


def _color(text: str) -> Any:
    if text.startswith("#"):
        return {"rgb": [round(int(text[i : i + 2], 16) / 255, 3) for i in (1, 3, 5)]}
    if text.startswith("rgb"):
        values = [float(one) for one in re.findall(DIGITS, text)]
        scale = 255 if max(values) > 1 else 1
        if not all(0 <= value <= scale for value in values):
            raise NotUnderstood(f"{text!r}: rgb values lie within 0..1 or 0..255")
        return {"rgb": [round(value / scale, 3) for value in values]}
    text = text.removesuffix("ish")
    name = next(one for one in sorted(TINTS, key=len, reverse=True) if text.endswith(one))
    shade = {SHADES[word] for word in re.findall(r"[a-z]+", text.removesuffix(name))} - {""}
    tint = TINTS[name]
    if not shade:
        return tint
    return {"rgb": shaded(tint, 0.5 if shade == {"dark"} else -0.5)}


def rgb(tint: Any) -> list[float]:
    """The display sRGB of a recipe's color. Raises NotUnderstood for one that is drawn."""
    if isinstance(tint, str):
        return list(color_space.rgb(tint))
    if "rgb" not in tint:
        raise NotUnderstood("its color is drawn at random, so it has no darker or lighter one")
    return [float(value) for value in tint["rgb"]]


def shaded(tint: Any, factor: float) -> list[float]:
    """A color's rgb times a factor; below 0 the part of its way to white."""
    return [round(v * factor if factor > 0 else v - factor * (1 - v), 3) for v in rgb(tint)]


@cache
def _texture_words() -> frozenset[str]:
    return (
        frozenset(part for name in shipped.NAMES for part in name.split("_")) - {"paint"}
        | set(KINDS)
        | set(LIKE) - {"grey"}
    )


UNSAID = bag("a an some the random other another different new one of any")


def texture(words: Sequence[str]) -> tuple[int, list[Any]]:
    """How many words from the first on tell of a texture, and the textures that they may mean; 0 if they tell of none.

    "light birch wood" is one, "marble" any of three, "wood" a draw of its kind. Raises NotUnderstood for a texture in
    a color that none has.
    """
    known, taken, tints, kinds = [], 0, [], []
    for k, word in enumerate(words):
        plain = LIKE.get(word, word)
        tint = color_space.canonical(plain)
        if word in ("dark", "darker", "light", "lighter") or (
            tint and plain not in ("orange", "rose")
        ):
            tints.append(tint or word[:4])
        elif word in KINDS or (word == "noise" and words[k + 1 : k + 2] == ["texture"]):
            kinds.append(KINDS.get(word, word))
            taken = k + 1
        elif plain in _texture_words() and not tint:
            known.append(plain)
            taken = k + 1
        elif known and word == "texture":
            continue
        else:
            break
    said = " ".join(words[:taken])
    tints = [tint for tint in tints if tint][: taken - len(known) - len(kinds)]
    if not (known or kinds):
        return 0, []
    if not known and not tints:
        return taken, [{"sample": kinds[0]}]
    fits = [
        n
        for n in shipped.NAMES
        if set(known) <= set(n.split("_")) and all(n in shipped.KINDS[kind] for kind in kinds)
    ]
    for tint in tints:
        exact = [name for name in fits if tint in map(color_space.canonical, name.split("_"))]
        fits = exact or [name for name in fits if _toned(name, tint)]
    if not fits:
        raise NotUnderstood(f"no texture is called {said!r}; names are: {', '.join(shipped.NAMES)}")
    return taken, list(fits)


def _toned(name: str, tint: str) -> bool:
    """Is a texture of about that color on the whole, or dark, or light?"""
    mean = shipped.image(name).reshape(-1, 3).mean(0) / 255
    lab = color_space.to_lab(mean)
    if tint in ("dark", "ligh"):
        return bool(lab[0] < 45) if tint == "dark" else bool(lab[0] > 65)
    return color_space.canonical(color_space.nearest(mean)) == tint or (
        tint == "gray" and math.hypot(*lab[1:]) < 8
    )


def words_of(blocks: Mapping[str, str]) -> dict[str, str]:
    """What each phrase of the blocks is: the block's name. Phrases are parted by commas."""
    return {
        phrase.strip(): kind
        for kind, text in blocks.items()
        for phrase in text.split(",")
        if phrase.strip()
    }


def merged(parts: Iterator[Any]) -> list[Any]:
    """All parts in a list."""
    return list(itertools.chain.from_iterable(parts))


def is_rank(word: str) -> bool:
    """Does a word describe a thing by its rank among others: "largest", "second", "left"?"""
    return word in relations.RANKS or word in relations.ORDINALS
