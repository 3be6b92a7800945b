"""Color names, the Lab space in which colors are compared, and the typical color of some pixels."""

import re
from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
from jaxtyping import Float, Float64, UInt8

# RLBench's task colors are COLOSSEUM's too; values are display sRGB.
RLBENCH: Mapping[str, tuple[float, float, float]] = {
    "red": (1.0, 0.0, 0.0),
    "maroon": (0.5, 0.0, 0.0),
    "lime": (0.0, 1.0, 0.0),
    "green": (0.0, 0.5, 0.0),
    "blue": (0.0, 0.0, 1.0),
    "navy": (0.0, 0.0, 0.5),
    "yellow": (1.0, 1.0, 0.0),
    "cyan": (0.0, 1.0, 1.0),
    "magenta": (1.0, 0.0, 1.0),
    "silver": (0.75, 0.75, 0.75),
    "gray": (0.5, 0.5, 0.5),
    "orange": (1.0, 0.5, 0.0),
    "olive": (0.5, 0.5, 0.0),
    "purple": (0.5, 0.0, 0.5),
    "teal": (0.0, 0.5, 0.5),
    "azure": (0.0, 0.5, 1.0),
    "violet": (0.5, 0.0, 1.0),
    "rose": (1.0, 0.0, 0.5),
    "black": (0.0, 0.0, 0.0),
    "white": (1.0, 1.0, 1.0),
}

NAMES: Mapping[str, tuple[float, float, float]] = {
    **RLBENCH,
    "pink": (1.0, 0.75, 0.8),
    "brown": (0.55, 0.35, 0.17),
    "beige": (0.9, 0.82, 0.7),
    "tan": (0.75, 0.64, 0.48),
    "gold": (0.85, 0.65, 0.13),
}

ALIASES: Mapping[str, str] = {
    "grey": "gray",
    **dict.fromkeys(("turquoise", "aqua"), "cyan"),
    **dict.fromkeys(("crimson", "scarlet", "vermilion", "ruby"), "red"),
    **dict.fromkeys(("lilac", "indigo", "lavender", "mauve"), "violet"),
    "burgundy": "maroon",
    **dict.fromkeys(("emerald", "jade"), "green"),
    "sapphire": "blue",
    "amber": "orange",
    "fuchsia": "magenta",
    "golden": "gold",
    "ivory": "white",
    "khaki": "tan",
}

# A plain word also means the shades that people call by it.
SHADES: Mapping[str, frozenset[str]] = {
    "red": frozenset({"maroon", "rose"}),
    "green": frozenset({"lime", "olive"}),
    "blue": frozenset({"navy", "azure"}),
    "purple": frozenset({"violet", "magenta"}),
    "yellow": frozenset({"gold"}),
    "gray": frozenset({"silver"}),
    "brown": frozenset({"tan", "maroon"}),
    "pink": frozenset({"rose", "magenta"}),
    "cyan": frozenset({"teal"}),
}

# What people call by plain words, beside the pure colors: the light, dark, pale, bright, dull, dusty and deep ones of
# the survey at xkcd.com/color/rgb (CC0), but for those within 12 of another name's own color.
SURVEYED: Mapping[str, str] = {
    "blue": "00035b 0165fc 0343df 49759c 5a86ad 95d0fc d0fefe",
    "brown": "341c02 410200 653700 876e4b ad8150",
    "gray": "363737 929591",
    "green": "02590f 033500 15b01a 74a662 76a973 96f97b c7fdb5",
    "orange": "c65102 d8863b dc4d01 f0833a f97306 fdaa48 ff5b00 ffa756",
    "pink": "cb0162 cb416b d5869d d58a94 fe01b1 ff81c0 ffcfdc ffd1df",
    "purple": "35063e 36013f 7e1e9c 825f87 84597e b790d4 be03fd bf77f6",
    "red": "b9484e bb3f3f d9544d e50000 ff000d ff474c",
    "yellow": "d5b60a eedc5b fffd01 fffe7a ffff14 ffff84",
}

HEX = re.compile("#([0-9a-fA-F]{3}|[0-9a-fA-F]{6})")
D65 = np.array([0.95047, 1.0, 1.08883])
TO_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
FROM_XYZ = np.linalg.inv(TO_XYZ)
BEND = 6.0 / 29.0
COLORLESS = 8.0  # chroma below which a color has no hue to go by
VIVID = 50.0  # chroma that tells by what name a washed-out color goes
KINDRED = 50.0  # degrees of hue within which two words may mean one color
RIVAL = 16.0  # degrees by which another word may fit better

# Names whose hues are those of the plain words for hues.
HUES: Mapping[str, tuple[str, ...]] = {
    "red": ("red",),
    "orange": ("orange",),
    "brown": ("orange",),
    "yellow": ("yellow",),
    "green": ("green",),
    "cyan": ("cyan",),
    "blue": ("blue", "azure"),
    "purple": ("purple", "violet"),
    "pink": ("pink", "rose"),
}


def to_linear(srgb: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Light intensities of display sRGB values in 0..1 (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((np.maximum(srgb, 0.0) + 0.055) / 1.055) ** 2.4)


def from_linear(linear: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Display sRGB of light intensities; the inverse of `to_linear`."""
    return np.where(
        linear <= 0.0031308, linear * 12.92, 1.055 * np.maximum(linear, 0.0) ** (1 / 2.4) - 0.055
    )


def to_lab(srgb: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """CIELAB (D65, 2 degrees) of display sRGB in 0..1: L in 0..100."""
    xyz = to_linear(np.asarray(srgb, float)) @ TO_XYZ.T / D65
    f = np.where(xyz > BEND**3, np.cbrt(xyz), xyz / (3 * BEND**2) + 4 / 29)
    return np.stack(
        [116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], -1
    )


def from_lab(lab: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Display sRGB of CIELAB, outside 0..1 where the display cannot show it."""
    lab = np.asarray(lab, float)
    middle = (lab[..., 0] + 16) / 116
    f = np.stack([middle + lab[..., 1] / 500, middle, middle - lab[..., 2] / 200], -1)
    xyz = np.where(f > BEND, f**3, 3 * BEND**2 * (f - 4 / 29)) * D65
    return from_linear(xyz @ FROM_XYZ.T)


def ciede2000(
    first: Float[np.ndarray, "*n 3"], second: Float[np.ndarray, "*n 3"]
) -> Float64[np.ndarray, "*n"]:
    """Color difference of CIELAB colors, all weights 1 (CIE 142-2001, as Sharma, Wu and Dalal 2005 state it)."""
    (l1, a1, b1), (l2, a2, b2) = (np.moveaxis(np.asarray(c, float), -1, 0) for c in (first, second))
    chroma = (np.hypot(a1, b1) + np.hypot(a2, b2)) / 2
    stretch = 1.5 - 0.5 * np.sqrt(chroma**7 / (chroma**7 + 25.0**7))
    a1, a2 = a1 * stretch, a2 * stretch
    c1, c2 = np.hypot(a1, b1), np.hypot(a2, b2)
    h1, h2 = (np.degrees(np.arctan2(b, a)) % 360 for a, b in ((a1, b1), (a2, b2)))
    grey = c1 * c2 == 0
    turn = np.where(grey, 0, (h2 - h1 + 180) % 360 - 180)
    turn = np.where((turn == -180) & (h2 > h1), 180, turn)
    dl, dc = l2 - l1, c2 - c1
    dh = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(turn / 2))
    middle_l, middle_c = (l1 + l2) / 2, (c1 + c2) / 2
    far = np.abs(h1 - h2) > 180
    middle_h = (h1 + h2) / 2 + np.where(far, np.where(h1 + h2 < 360, 180, -180), 0)
    middle_h = np.where(grey, h1 + h2, middle_h)
    t = 1 + sum(
        weight * np.cos(np.radians(times * middle_h + off))
        for weight, times, off in ((-0.17, 1, -30), (0.24, 2, 0), (0.32, 3, 6), (-0.20, 4, -63))
    )
    sl = 1 + 0.015 * (middle_l - 50) ** 2 / np.sqrt(20 + (middle_l - 50) ** 2)
    sc, sh = 1 + 0.045 * middle_c, 1 + 0.015 * middle_c * t
    blue = 60 * np.exp(-(((middle_h - 275) / 25) ** 2))
    cross = -2 * np.sqrt(middle_c**7 / (middle_c**7 + 25.0**7)) * np.sin(np.radians(blue))
    light, saturation, hue = dl / sl, dc / sc, dh / sh
    return np.sqrt(light**2 + saturation**2 + hue**2 + cross * saturation * hue)


def from_hex(text: str) -> tuple[float, float, float] | None:
    """The display sRGB of `#ff8000` or `#f80`, None for what is not written so."""
    if not HEX.fullmatch(text):
        return None
    digits = text[1:] if len(text) == 7 else "".join(2 * digit for digit in text[1:])
    red, green, blue = bytes.fromhex(digits)
    return red / 255, green / 255, blue / 255


def to_hex(color: Sequence[float]) -> str:
    """Display sRGB in 0..1 as `#ff8000`."""
    return "#" + bytes(round(255 * min(max(float(one), 0), 1)) for one in color).hex()


def canonical(word: str) -> str | None:
    """The name in NAMES that a word stands for, or None. "Reddish", "bluish" and "whitish" are near names.

    A color in hexadecimal stands for the name that people give it.
    """
    if (exact := from_hex(word)) is not None:
        return nearest(np.array(exact))
    word = word.lower()
    stem = word.removesuffix("ish")
    near = (stem, stem + "e", stem[:-1]) if stem and stem != word else ()
    for spelled in (word, *near):
        if (name := ALIASES.get(spelled, spelled)) in NAMES:
            return name
    return None


def rgb(name: str) -> tuple[float, float, float]:
    """The display sRGB of a color name, or of `#rrggbb`. Raises KeyError listing the known names."""
    if (exact := from_hex(name)) is not None:
        return exact
    known = canonical(name)
    if known is None:
        raise KeyError(f"no color is called {name!r}; there are: {', '.join(sorted(NAMES))}")
    return NAMES[known]


@cache
def _called() -> tuple[tuple[str, ...], Float64[np.ndarray, "n 3"]]:
    """Names, most of them many times, and the CIELAB colors that go by them."""
    shades = [
        (name, tuple(byte / 255 for byte in bytes.fromhex(one)))
        for name, listed in SURVEYED.items()
        for one in listed.split()
    ]
    names, colors = zip(*NAMES.items(), *shades, strict=True)
    return names, to_lab(np.array(colors))


def nearest(color: Float[np.ndarray, "3"]) -> str:
    """The name that people give a color: that of the nearest one in CIELAB (CIE 1976 distance)."""
    names, table = _called()
    return names[int(np.argmin(((table - to_lab(np.asarray(color, float))) ** 2).sum(-1)))]


def means(name: str, shade: str) -> bool:
    """Would a person call `shade` by `name`?"""
    return shade == name or shade in SHADES.get(name, ())


def akin(name: str, shade: str) -> bool:
    """Could people mean the color `shade` by `name`: one of its hue, or without hue as it is? Both stand in NAMES."""
    if means(name, shade) or means(shade, name):
        return True
    first, second = (
        np.hypot(*to_lab(np.array(NAMES[one]))[1:]) < COLORLESS for one in (name, shade)
    )
    if first or second:
        return bool(first and second and {name, shade} != {"black", "white"})
    return _kindred(name, shade) or _kindred(shade, name)


def hued(name: str, color: Float[np.ndarray, "3"]) -> bool:
    """Would a person call a washed-out color by a color word? Never so for greys, which have no hue (CIELAB).

    Cameras show few things as pure as their names: a sink that people call blue is nearest to grey. It goes by the name
    that it would have with some more chroma.
    """
    known = canonical(name)
    lab = to_lab(np.asarray(color, float))
    chroma = float(np.hypot(*lab[1:]))
    if known is None or chroma < COLORLESS:
        return False
    more = max(1.0, VIVID / chroma)
    return means(known, nearest(np.clip(from_lab(lab * [1.0, more, more]), 0, 1)))


def _kindred(name: str, shade: str) -> bool:
    """Has a color the hue of a word, and hardly another word's?"""
    off = _turn(name, shade)
    return off < min(KINDRED, min(_turn(word, shade) for word in HUES) + RIVAL)


def _turn(name: str, shade: str) -> float:
    """Degrees of hue between a color and a word, inf for a word without hue."""
    shades = np.array([NAMES[word] for word in HUES.get(name, (name,))])
    a, b = np.moveaxis(to_lab(shades), -1, 0)[1:]
    c, d = to_lab(np.array(NAMES[shade]))[1:]
    off = np.abs((np.degrees(np.arctan2(b, a) - np.arctan2(d, c)) + 180) % 360 - 180)
    return float(np.where(np.hypot(a, b) < COLORLESS, np.inf, off).min())


def typical(pixels: UInt8[np.ndarray, "n 3"]) -> Float[np.ndarray, "3"]:
    """The color of a thing from its pixels, in 0..1: their mean without the darkest and lightest quarter.

    Of two pixels none lies between the quarters: both count.
    """
    light = pixels @ np.array([0.299, 0.587, 0.114])
    low, high = np.percentile(light, [25, 75])
    inner = pixels[(light >= low) & (light <= high)]
    return (inner if len(inner) else pixels).mean(0) / 255.0
