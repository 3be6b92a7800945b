"""Values among words: numbers with units, colors and textures, each read from one word on."""
# ruff: noqa: E501  # tables are easiest to read whole

import colorsys
import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from rpaug.assets.textures import shipped
from rpaug.core import color_space
from rpaug.language.lexicon import group
from rpaug.language.messages import NotUnderstood
from rpaug.scene.targets.relations import singular

SMALL = [
    "zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve", "thirteen",
    "fourteen", "fifteen", "sixteen", "seventeen", "eighteen", "nineteen",
]  # fmt: skip
TENS = ["twenty", "thirty", "forty", "fifty", "sixty", "seventy", "eighty", "ninety"]
NUMBERS: Mapping[str, float] = {
    **{word: n for n, word in enumerate(SMALL)},
    **{word: 10 * n for n, word in enumerate(TENS, 2)},
    **{f"{t}{gap}{o}": 10 * n + m for n, t in enumerate(TENS, 2) for m, o in enumerate(SMALL[1:10], 1) for gap in "- "},
    "a dozen": 12, "half a dozen": 6, "a couple of": 2, "a couple": 2, "a pair of": 2, "a hundred": 100,
    "one and a half": 1.5, "a": 1, "an": 1,
}  # fmt: skip
PARTS: Mapping[str, float] = {
    "half a": 0.5, "half an": 0.5, "a half": 0.5, "half": 0.5, "a third": 1 / 3, "a quarter": 0.25, "a fifth": 0.2,
    "a tenth": 0.1, "one half": 0.5, "one third": 1 / 3, "one quarter": 0.25, "one fifth": 0.2, "one tenth": 0.1,
    "two thirds": 2 / 3, "three quarters": 0.75,
}  # fmt: skip
SPOKEN = "|".join(map(re.escape, sorted({*NUMBERS, *PARTS}, key=len, reverse=True)))
NUMBER = rf"(?:-?(?:\d+(?:\.\d+)?|\.\d+)|(?:{SPOKEN})(?![a-z]))"
SOME = (2.0, 5.0)  # units that "a few centimeters" are
UNITS: Mapping[str, tuple[str, float]] = {
    word: (kind, factor)
    for words, kind, factor in (
        ("m meter meters metre metres", "length", 1.0),
        ("cm centimeter centimeters centimetre centimetres", "length", 0.01),
        ("mm millimeter millimeters millimetre millimetres", "length", 0.001),
        ("inch inches", "length", 0.0254),
        ("ft foot feet", "length", 0.3048),
        ("degree degrees deg degs", "angle", math.pi / 180),
        ("radian radians rad", "angle", 1.0),
        ("% percent", "share", 0.01),
        ("stop stops ev f-stop f-stops", "stops", 1.0),
        ("k kelvin", "kelvin", 1.0),
        ("px pixel pixels", "pixels", 1.0),
        ("x times", "times", 1.0),
    )
    for word in words.split()
}
HOW: Mapping[str, str] = {
    phrase: how
    for how, phrases in {
        "upto": "up to, at most, max, maximum, maximal, no more than, within, not more than, a maximum of, less than",
        "about": "±, by plus or minus",
        "least": "at least, no less than, more than",
        "exact": "about, around, roughly, approximately, some, exactly, by a factor of, a factor of, by, of, anywhere, "
        "uniformly, a height of",
        "from": "between, from, anything",
    }.items()
    for phrase in phrases.split(", ")
}
SHADES = {"dark": 0.5, "deep": 0.5, "light": -0.5, "pale": -0.5, "bright": 0.0, "vivid": 0.0, "plain": 0.0, "pure": 0.0, "mid": 0.0}  # fmt: skip
TINTS: Mapping[str, Any] = {
    "navy blue": "navy", "sky blue": "azure", "lime green": "lime", "olive green": "olive", "wine red": "maroon",
    **{name: {"rgb": list(rgb)} for name, rgb in {
        "light blue": (0.5, 0.75, 1.0), "forest green": (0.13, 0.4, 0.13), "royal blue": (0.25, 0.41, 0.88),
        "baby blue": (0.6, 0.8, 0.95), "off-white": (0.96, 0.94, 0.88), "off white": (0.96, 0.94, 0.88),
        "cream": (0.96, 0.94, 0.82), "anthracite": (0.22, 0.24, 0.26), "charcoal": (0.21, 0.22, 0.24),
        "mint": (0.6, 0.95, 0.75), "salmon": (0.98, 0.5, 0.45), "coral": (1.0, 0.5, 0.31), "peach": (1.0, 0.8, 0.64),
        "mustard": (0.85, 0.68, 0.2), "plum": (0.45, 0.2, 0.42), "bronze": (0.8, 0.5, 0.2), "cardboard": (0.76, 0.6, 0.42), "chocolate": (0.35, 0.2, 0.1),
    }.items()},
    **{name: name for name in color_space.NAMES}, **color_space.ALIASES,
}  # fmt: skip
MANNERS: Mapping[str, tuple[tuple[float, float], tuple[float, float]]] = {
    word: ends
    for words, ends in {  # saturation and value that colors of a manner have
        "pastel pale soft": ((0.15, 0.45), (0.85, 1)),
        "vivid saturated bright strong intense neon": ((0.8, 1), (0.75, 1)),
        "muted dull faded": ((0.15, 0.4), (0.4, 0.7)),
        "dark deep": ((0.5, 1), (0.15, 0.4)),
    }.items()
    for word in words.split()
}
NEUTRAL = ("white", "gray", "black")
LONGEST = 8  # words of a phrase
BANNED, STEP, NARROW = 30, 5, 20
"""Degrees of hue: about a color that is not wanted, in which hues are looked at, and least of what is drawn from."""
DIM = 0.3  # value of what is no black, saturation of what is no gray
ANYHOW = group("values_anyhow")
VARIOUS = frozenset(["random", "different", "various", "slightly"])
PAINTED = group("values_painted")
"""After a color: what is of that color, and has no look beside it."""
HUED = group("values_hued")
CHANNELS = {"hue": 0, "hues": 0, "sat": 1, "saturation": 1, "val": 2, "value": 2, "brightness": 2}
BETWEEN = {*CHANNELS, "hsv", "in", "(", ")", ",", "and", "uniformly"}
KINDS = {
    word: kind
    for kind, words in {
        "wood": "wood wooden timber veneer woods",
        "stone": "stone rock rocky",
        "fabric": "fabric cloth textile",
        "metal": "metal metallic metals",
        "checker": "checker checkered chequered checked checkerboard",
    }.items()
    for word in words.split()
}
LIKE = {"brick": "bricks", "tile": "tiles", "tiled": "tiles", "striped": "stripes", "stripe": "stripes", "plank": "planks",
        "dotted": "dots", "marbled": "marble"}  # fmt: skip


@dataclass(frozen=True)
class Amount:
    """A quantity in metres, radians, parts, stops, ...: `how` is exact, upto, about, least or range."""

    low: float
    high: float
    how: str = "exact"

    @property
    def ends(self) -> tuple[float, float]:
        """Between which values it lies, along one direction."""
        return {"upto": 0.0, "about": -self.high}.get(self.how, self.low), self.high


def tidy(value: float) -> float:
    """A whole number as one, any other to a tenth of a thousandth."""
    return int(value) if value == int(value) else round(value, 4)


def longest(words: Sequence[str], at: int, table: Collection[str]) -> str:
    """The longest phrase of a table that begins at a word; "" for none."""
    for size in range(min(LONGEST, len(words) - at), 0, -1):
        phrase = " ".join(words[at : at + size])
        if phrase in table:
            return phrase
    return ""


def number(words: Sequence[str], at: int) -> tuple[int, float, str]:
    """How many words a number takes, its value, and whether it is a number, a part of something or an article."""
    if at < len(words) and re.fullmatch(r"-?\d*\.?\d+", words[at]):
        return 1, float(words[at]), "number"
    part, said = longest(words, at, PARTS), longest(words, at, NUMBERS)
    if len(part) > len(said):
        return len(part.split()), PARTS[part], "part"
    if said:
        return len(said.split()), NUMBERS[said], "article" if said in ("a", "an") else "number"
    return 0, 0.0, ""


def numeral(text: str) -> float:
    """The value of text that fits `NUMBER`."""
    return float({**NUMBERS, **PARTS}.get(text) or text)


def _unit(words: Sequence[str], at: int) -> int:
    """How many words a unit takes: none, one, or two with a hyphen before it."""
    if at < len(words) and words[at] in UNITS:
        return 1
    return (
        2
        if words[at : at + 1] == ["-"] and words[at + 1 : at + 2] and words[at + 1] in UNITS
        else 0
    )


def amount(words: Sequence[str], at: int) -> tuple[int, str, Amount] | None:
    """How many words an amount takes, its kind ("length", "share", "number", ...) and value; None for none."""
    if list(words[at : at + 1]) == ["some"] and (step := _unit(words, at + 1)):
        of, factor = UNITS[words[at + step]]
        least, most = SOME
        return 1 + step, of, Amount(tidy(least * factor), tidy(most * factor), "range")
    k, how, between = at, "", False
    while phrase := longest(words, k, HOW):
        between |= HOW[phrase] == "from"
        how = HOW[phrase] if HOW[phrase] not in ("exact", "from") else how
        k += len(phrase.split())
    size, low, kind = number(words, k)
    if not size:
        return None
    k, high, unit = k + size, low, ""
    if step := _unit(words, k):
        unit, k = words[k + step - 1], k + step
    either = words[k : k + 1] == ["or"] and not unit
    if words[k : k + 1] and (words[k] in ("-", "to", "and") or either):
        more, other, _ = number(words, k + 1)
        more = more if not either or other == low + 1 else 0  # "2 or 3"
        step = _unit(words, k + 1 + more) if more else 0
        second = words[k + more + step] if step else unit
        mixed = unit and second and UNITS[unit][0] != UNITS[second][0]
        apart = words[k] == "and" and not between  # "2 cm and 3 degrees" are two
        if more and not (mixed or apart or words[k + 1] in ("a", "an")):
            high, unit, k, how = other, second or unit, k + 1 + more + step, how or "range"
    if kind == "article" and not unit:
        return None
    if words[k : k + 2] == ["at", "most"] or words[k : k + 1] in (["max"], ["maximum"]):
        how, k = "upto", k + (2 if words[k] == "at" else 1)
    if not unit and kind == "part":
        unit = "x"
    of, factor = UNITS[unit] if unit else ("number", 1.0)
    low, high = tidy(low * factor), tidy(high * factor)
    if low == -high and high:
        return k - at, of, Amount(abs(high), abs(high), "about")
    return k - at, of, Amount(min(low, high), max(low, high), how or "exact")


def point(words: Sequence[str], at: int) -> tuple[int, list[float]] | None:
    """A place or direction in parentheses, two or three numbers."""
    found = re.match(r"\( -?[\d.]+ (?:, -?[\d.]+ ){1,2}\)", " ".join(words[at : at + 7]))
    if found is None:
        return None
    said = found.group().split()
    return len(said), [tidy(float(one)) for one in said if one not in "(,)"]


def color(words: Sequence[str], at: int) -> tuple[int, list[Any]] | None:
    """How many words a color takes, and the recipe's colors of which one is meant. Raises NotUnderstood."""
    found = _exact(words, at) or _channels(words, at)
    if list(words[at : at + 4]) == ["in", "black", "and", "white"]:
        return 4, list(NEUTRAL)
    if found:
        return found
    k = at
    while k < len(words) and words[k] in ANYHOW:
        k += 1
    manner = words[k] if words[k : k + 1] and words[k + 1 : k + 2] and words[k + 1] in HUED else ""
    if manner in MANNERS:
        return k + 2 - at, [{"hsv": [[0, 360], *map(list, MANNERS[manner])]}]
    if manner == "neutral":
        return k + 2 - at, list(NEUTRAL)
    if words[k : k + 1] in (["pastel"], ["pastels"]) and not _named(words, k + 1):
        return k + 1 - at, [{"hsv": [[0, 360], *map(list, MANNERS["pastel"])]}]
    if (
        words[k : k + 1]
        and words[k] in HUED - {"color", "colors"}
        and words[k + 1 : k + 2] == ["of"]
    ):
        of = _named(words, k + 2)
        return (k + 2 + of[0] - at, [_around(of[1])]) if of else None
    several = singular(words[k]) if words[k : k + 1] and words[k] not in TINTS else ""
    named = (1, TINTS[several]) if several in TINTS else _named(words, k)
    if named is None:
        return None
    size, tint = named
    k += size
    varied = bool(VARIOUS & set(words[at : k - size]))
    if words[k : k + 1] and words[k] in ("tones", "shades", "hues", "tints"):
        k, varied = k + 1, True
    elif tail := re.match(
        r"(?:colou?r )?with (?:a bit of |a little |some |slight |small |mild |little )?variations?",
        " ".join(words[k : k + 6]),
    ):
        k, varied = k + len(tail.group().split()), True
    elif words[k : k + 1] and words[k] in PAINTED and words[k + 1 : k + 2] != ["of"]:
        k += 1
    return k - at, [_around(tint) if varied else tint]


def _exact(words: Sequence[str], at: int) -> tuple[int, list[Any]] | None:
    """A color in digits. Raises NotUnderstood for an rgb beyond its range."""
    first = words[at]
    if re.fullmatch("#[0-9a-f]{6}", first):
        return 1, [{"rgb": [round(int(first[i : i + 2], 16) / 255, 3) for i in (1, 3, 5)]}]
    found = re.match(
        r"rgb \(? ?([\d.]+) , ([\d.]+) , ([\d.]+)(?: \))?", " ".join(words[at : at + 8])
    )
    if found is None:
        return None
    values = [float(one) for one in found.groups()]
    scale = 255 if max(values) > 1 else 1
    if not all(0 <= value <= scale for value in values):
        raise NotUnderstood(f"{found.group()!r}: rgb values lie within 0..1 or 0..255")
    return len(found.group().split()), [{"rgb": [round(value / scale, 3) for value in values]}]


def _channels(words: Sequence[str], at: int) -> tuple[int, list[Any]] | None:
    """Colors drawn in ranges of hue, saturation and value: "in hsv ( hue 0 - 360 , sat 0.3 - 0.9 )"."""
    k, ends = at, [[0, 360], [0.5, 1], [0.3, 1]]
    last = at
    while k < len(words) and words[k] in BETWEEN:
        found = None
        if words[k] in CHANNELS:
            found = amount(words, k + 1)
            if found is None or found[2].how not in ("range", "least"):
                break
            low, high = found[2].low, found[2].high if found[2].how == "range" else 1
            ends[CHANNELS[words[k]]] = (
                [low, high] if found[1] == "number" else [math.degrees(low), math.degrees(high)]
            )
        k += 1 + (found[0] if found else 0)
        last = k if found or words[k - 1] == ")" else last
    return (last - at, [{"hsv": ends}]) if CHANNELS.keys() & set(words[at:last]) else None


def _named(words: Sequence[str], at: int) -> tuple[int, Any] | None:
    """A color by its name, after words of shade."""
    k = at
    while words[k : k + 1] and (words[k] in SHADES or words[k : k + 2] == ["-", words[k]]):
        if longest(words, k, TINTS):
            break
        k += 1
    name = longest(words, k, TINTS)
    if not name and words[k : k + 1] and words[k].endswith("ish"):
        name = words[k] if words[k].removesuffix("ish") in TINTS or words[k] == "reddish" else ""
    if not name:
        return None
    tint = TINTS.get(name) or TINTS["red" if name == "reddish" else name.removesuffix("ish")]
    factor = next((SHADES[word] for word in words[at:k] if SHADES[word]), 0.0)
    return k + len(name.split()) - at, {"rgb": shaded(tint, factor)} if factor else tint


def _around(tint: Any) -> Any:
    """The colors about one, drawn by hue, saturation and value."""
    hue, saturation, value = colorsys.rgb_to_hsv(*rgb(tint))
    near = [(360 * hue - 12) % 360, (360 * hue + 12) % 360] if saturation else [0, 0]
    around = [
        [max(0.0, one - wide), min(1.0, one + wide)]
        for one, wide in ((saturation, 0.25 * (saturation > 0)), (value, 0.2))
    ]
    return {"hsv": [[tidy(one) for one in ends] for ends in (near, *around)]}


def apart(tint: Any, banned: Sequence[Any]) -> list[Any]:
    """The colors of a draw without those that are like some others: what is left of its hues, each part a draw.

    A named color is left as it is.
    """
    if not isinstance(tint, dict) or "hsv" not in tint:
        return [tint]
    (low, high), saturation, value = tint["hsv"]
    hued = [one for one in banned if colorsys.rgb_to_hsv(*rgb(one))[1]]
    for one in banned:
        if one not in hued:
            saturation, value = _strong(saturation, value, max(rgb(one)))
    whole = range(int(low), int(high if high > low else high + 360) + 1, STEP)
    left = [one for one in whole if not any(_near(one, saturation, value, b) for b in hued)]
    starts = [one for one in left if one - STEP not in left]
    ends = [one for one in left if one + STEP not in left]
    pairs = list(zip(starts, ends, strict=True))
    if len(pairs) > 1 and pairs[0][0] + 360 == pairs[-1][1]:
        pairs = [*pairs[1:-1], (pairs[-1][0], pairs[0][1])]
    return [
        {"hsv": [[a % 360, b % 360 or 360], saturation, value]}
        for a, b in pairs
        if (b - a) % 360 >= NARROW or (a == 0 and b == 360)
    ]


def _near(degree: int, saturation: Any, value: Any, banned: Any) -> bool:
    """Is a hue near that of another color, or called by its name, pale or strong?"""
    other = 360 * colorsys.rgb_to_hsv(*rgb(banned))[0]
    if min((degree - other) % 360, (other - degree) % 360) <= BANNED:
        return True
    name = color_space.nearest(color_space.np.array(rgb(banned)))
    shown = (colorsys.hsv_to_rgb(degree % 360 / 360, s, v) for s in saturation for v in value)
    return any(
        color_space.akin(name, color_space.nearest(color_space.np.array(one))) for one in shown
    )


def _strong(saturation: Any, value: Any, level: float) -> tuple[Any, Any]:
    """Bounds without what goes by black, or by white or gray."""
    if level < DIM:
        return saturation, [max(value[0], DIM), max(value[1], DIM)]
    return [max(saturation[0], DIM), max(saturation[1], DIM)], value


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
    named = frozenset(part for name in shipped.NAMES for part in name.split("_"))
    return named - {"paint"} | set(KINDS) | set(LIKE)


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
        elif plain in shipped.NAMES and "_" in plain:
            known += plain.split("_")
            taken = k + 1
        else:
            break
    tints = [tint for tint in tints if tint][: taken - len(known) - len(kinds)] if taken else []
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
        said = " ".join(words[:taken])
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
