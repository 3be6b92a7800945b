"""Colours by name, and the CIELAB space in which distances mean something."""

import numpy as np
from jaxtyping import Float

COLOSSEUM = {  # robot-colosseum/robot-colosseum, colosseum/variations/const.py; RLBench's colour words
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
NAMES = COLOSSEUM | {
    "brown": (0.55, 0.35, 0.17),
    "pink": (1.0, 0.65, 0.75),
    "beige": (0.9, 0.85, 0.7),
    "tan": (0.8, 0.68, 0.5),
}
SPELLINGS = {"grey": "gray", "turquoise": "cyan", "golden": "yellow", "violett": "violet"}

WHITE = np.array([0.95047, 1.0, 1.08883])  # CIE 1931 2-degree observer, D65 (IEC 61966-2-1)
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
FROM_XYZ = np.linalg.inv(TO_XYZ)
EPSILON, KAPPA = 216 / 24389, 24389 / 27  # CIE 15: where the cube root turns linear


def named(name: str) -> tuple[float, float, float] | None:
    """Display sRGB 0..1 of a colour word, None if it is not one."""
    word = name.strip().lower()
    return NAMES.get(SPELLINGS.get(word, word))


def to_lab(rgb: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """CIELAB (L 0..100) of display sRGB 0..1 under D65."""
    rgb = np.asarray(rgb, float)
    linear = np.where(
        rgb <= 0.04045, rgb / 12.92, ((np.maximum(rgb, 0.04045) + 0.055) / 1.055) ** 2.4
    )
    ratio = linear @ TO_XYZ.T / WHITE
    f = np.where(ratio > EPSILON, np.cbrt(ratio), (KAPPA * ratio + 16) / 116)
    return np.stack(
        [116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], -1
    )


def from_lab(lab: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Display sRGB of CIELAB under D65, clipped to 0..1."""
    lab = np.asarray(lab, float)
    middle = (lab[..., 0] + 16) / 116
    f = np.stack([middle + lab[..., 1] / 500, middle, middle - lab[..., 2] / 200], -1)
    ratio = np.where(f**3 > EPSILON, f**3, (116 * f - 16) / KAPPA)
    linear = np.clip(ratio * WHITE @ FROM_XYZ.T, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def nearest(rgb: Float[np.ndarray, "3"]) -> str:
    """The colour word closest in CIELAB.

    Hue counts twice as much as lightness: a shaded red is red before it is maroon or brown.
    """
    words = list(NAMES)
    away = to_lab(np.array([NAMES[word] for word in words])) - to_lab(np.asarray(rgb))
    return words[int(((away * [0.5, 1.0, 1.0]) ** 2).sum(-1).argmin())]
