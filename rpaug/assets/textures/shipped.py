"""The textures that ship, by name: drawn from a seed of their own whenever they are asked for, never stored."""

import hashlib
from collections.abc import Callable, Mapping
from functools import lru_cache, partial

import numpy as np
from jaxtyping import UInt8

from rpaug.assets.textures import patterns as p
from rpaug.core import color_space
from rpaug.core.errors import RpaugError, there_are

Draw = Callable[[np.random.Generator], p.Picture]

KINDS: Mapping[str, Mapping[str, Draw]] = {
    "wood": {
        "oak": partial(p.wood, light=(0.76, 0.60, 0.40), dark=(0.55, 0.38, 0.21)),
        "pine": partial(p.wood, light=(0.90, 0.76, 0.53), dark=(0.76, 0.55, 0.30), rings=4),
        "walnut": partial(p.wood, light=(0.48, 0.33, 0.22), dark=(0.26, 0.16, 0.10), rings=6),
        "cherry": partial(p.wood, light=(0.72, 0.42, 0.26), dark=(0.52, 0.25, 0.14)),
        "mahogany": partial(p.wood, light=(0.50, 0.22, 0.14), dark=(0.30, 0.10, 0.07), rings=7),
        "ebony": partial(p.wood, light=(0.22, 0.18, 0.16), dark=(0.09, 0.07, 0.06), rings=8),
        "birch": partial(p.wood, light=(0.93, 0.86, 0.72), dark=(0.82, 0.71, 0.53), rings=3),
        "ash_grey": partial(p.wood, light=(0.72, 0.70, 0.66), dark=(0.50, 0.48, 0.45)),
        "oak_planks": partial(p.wood, light=(0.76, 0.60, 0.40), dark=(0.50, 0.34, 0.19), planks=4),
        "teak_planks": partial(p.wood, light=(0.66, 0.45, 0.24), dark=(0.42, 0.26, 0.12), planks=6),
    },
    "stone": {
        "granite_grey": partial(
            p.speckle, ground=(0.62, 0.62, 0.63), grains=[(0.2,) * 3, (0.88,) * 3, (0.42,) * 3]
        ),
        "granite_pink": partial(
            p.speckle,
            ground=(0.74, 0.56, 0.50),
            grains=[(0.25, 0.22, 0.22), (0.9, 0.82, 0.78), (0.6, 0.36, 0.32)],
        ),
        "granite_black": partial(
            p.speckle, ground=(0.15, 0.15, 0.17), grains=[(0.55,) * 3, (0.32, 0.34, 0.4)]
        ),
        "marble_white": partial(p.marble, ground=(0.93, 0.93, 0.92), vein=(0.52, 0.53, 0.56)),
        "marble_green": partial(p.marble, ground=(0.16, 0.36, 0.27), vein=(0.74, 0.84, 0.76)),
        "marble_black": partial(p.marble, ground=(0.10, 0.10, 0.11), vein=(0.82, 0.78, 0.68)),
        "sandstone": partial(p.layers, first=(0.85, 0.70, 0.49), second=(0.66, 0.47, 0.30)),
        "slate": partial(p.layers, first=(0.36, 0.40, 0.44), second=(0.22, 0.25, 0.29), count=6),
        "concrete": partial(
            p.grain, ground=(0.66, 0.65, 0.63), other=(0.48, 0.47, 0.46), wavelength=90
        ),
        "terrazzo": partial(
            p.cells,
            stones=[(0.75, 0.42, 0.34), (0.33, 0.45, 0.47), (0.86, 0.74, 0.5), (0.35, 0.33, 0.33)],
            gap=(0.90, 0.88, 0.84),
            count=110,
            width=16,
        ),
        "cobbles": partial(
            p.cells,
            stones=[(0.45, 0.44, 0.42), (0.55, 0.52, 0.48), (0.38, 0.39, 0.42)],
            gap=(0.20, 0.19, 0.18),
            count=40,
            width=6,
        ),
    },
    "fabric": {
        "denim": partial(
            p.weave, warp=[(0.18, 0.27, 0.46)], weft=[(0.46, 0.54, 0.68)], threads=64, twill=2
        ),
        "linen": partial(p.weave, warp=[(0.82, 0.77, 0.66)], weft=[(0.74, 0.68, 0.57)], threads=48),
        "burlap": partial(
            p.weave, warp=[(0.64, 0.49, 0.31)], weft=[(0.53, 0.39, 0.23)], threads=24
        ),
        "tweed": partial(
            p.weave,
            warp=[(0.38, 0.31, 0.25), (0.62, 0.55, 0.46)] * 8,
            weft=[(0.55, 0.50, 0.42), (0.28, 0.25, 0.22)] * 8,
            threads=64,
            twill=4,
        ),
        "plaid_red": partial(
            p.weave,
            warp=[(0.7, 0.1, 0.12), (0.7, 0.1, 0.12), (0.1, 0.16, 0.14), (0.9, 0.85, 0.7)] * 2,
            weft=[(0.7, 0.1, 0.12), (0.7, 0.1, 0.12), (0.1, 0.16, 0.14), (0.9, 0.85, 0.7)] * 2,
            threads=64,
        ),
        "plaid_green": partial(
            p.weave,
            warp=[(0.12, 0.36, 0.22), (0.10, 0.14, 0.30), (0.12, 0.36, 0.22), (0.85, 0.8, 0.3)] * 2,
            weft=[(0.12, 0.36, 0.22), (0.10, 0.14, 0.30), (0.12, 0.36, 0.22), (0.85, 0.8, 0.3)] * 2,
            threads=64,
        ),
        "stripes_blue": partial(
            p.weave,
            warp=[(0.93, 0.93, 0.9), (0.15, 0.3, 0.62)] * 4,
            weft=[(0.85, 0.86, 0.88)],
            threads=64,
        ),
        "stripes_orange": partial(
            p.weave,
            warp=[(0.92, 0.47, 0.12), (0.96, 0.9, 0.78)] * 3,
            weft=[(0.93, 0.7, 0.45)],
            threads=60,
        ),
        "felt_purple": partial(
            p.grain, ground=(0.42, 0.20, 0.50), other=(0.30, 0.12, 0.38), wavelength=14
        ),
        "felt_green": partial(
            p.grain, ground=(0.10, 0.45, 0.26), other=(0.06, 0.32, 0.18), wavelength=14
        ),
        "polka_dots": partial(p.dots, ground=(0.86, 0.25, 0.32), dot=(0.97, 0.95, 0.92)),
    },
    "checker": {
        "checker_black": partial(p.checker, first=(0.93, 0.93, 0.93), second=(0.07, 0.07, 0.07)),
        "checker_red": partial(p.checker, first=(0.95, 0.92, 0.88), second=(0.75, 0.10, 0.12)),
        "checker_blue": partial(p.checker, first=(0.90, 0.93, 0.96), second=(0.12, 0.28, 0.65)),
        "checker_green": partial(p.checker, first=(0.93, 0.95, 0.84), second=(0.14, 0.48, 0.25)),
        "chessboard": partial(
            p.checker, first=(0.87, 0.74, 0.53), second=(0.38, 0.22, 0.12), count=8
        ),
        "bricks_red": partial(
            p.bricks, brick=(0.62, 0.27, 0.20), mortar=(0.78, 0.75, 0.70), rows=8, columns=4
        ),
        "bricks_white": partial(
            p.bricks, brick=(0.86, 0.85, 0.82), mortar=(0.62, 0.61, 0.59), rows=8, columns=4
        ),
        "tiles_white": partial(
            p.bricks, brick=(0.92, 0.93, 0.93), mortar=(0.55, 0.56, 0.57), rows=4, columns=4, bond=0
        ),
        "tiles_teal": partial(
            p.bricks, brick=(0.12, 0.48, 0.50), mortar=(0.85, 0.86, 0.84), rows=6, columns=6, bond=0
        ),
    },
    "noise": {
        "plaster": partial(
            p.grain, ground=(0.90, 0.87, 0.81), other=(0.76, 0.72, 0.66), wavelength=120
        ),
        "plaster_blue": partial(
            p.grain, ground=(0.55, 0.68, 0.78), other=(0.42, 0.55, 0.66), wavelength=120
        ),
        "plaster_yellow": partial(
            p.grain, ground=(0.92, 0.80, 0.48), other=(0.80, 0.64, 0.32), wavelength=120
        ),
        "rust": partial(
            p.grain,
            ground=(0.60, 0.29, 0.13),
            other=(0.28, 0.15, 0.11),
            wavelength=100,
            contrast=0.4,
        ),
        "moss": partial(
            p.grain,
            ground=(0.38, 0.48, 0.18),
            other=(0.16, 0.24, 0.10),
            wavelength=50,
            contrast=0.4,
        ),
        "sand": partial(p.grain, ground=(0.86, 0.75, 0.55), other=(0.70, 0.57, 0.38), wavelength=8),
        "clouds": partial(
            p.grain,
            ground=(0.95, 0.96, 0.98),
            other=(0.38, 0.58, 0.85),
            wavelength=180,
            contrast=0.4,
        ),
        "cork": partial(
            p.speckle,
            ground=(0.76, 0.58, 0.38),
            grains=[(0.42, 0.28, 0.17), (0.87, 0.72, 0.52), (0.58, 0.40, 0.25)],
        ),
        "camouflage": partial(
            p.patches,
            colors=[
                (0.45, 0.46, 0.30),
                (0.27, 0.31, 0.19),
                (0.35, 0.26, 0.17),
                (0.12, 0.13, 0.11),
            ],
            wavelength=80,
        ),
        "paint": partial(
            p.patches,
            colors=[
                (0.95, 0.93, 0.88),
                (0.90, 0.25, 0.20),
                (0.15, 0.45, 0.75),
                (0.97, 0.78, 0.15),
            ],
            wavelength=50,
        ),
    },
    "metal": {
        "steel_brushed": partial(p.brushed, ground=(0.62, 0.63, 0.65)),
        "steel_dark": partial(p.brushed, ground=(0.30, 0.31, 0.33)),
        "brass_brushed": partial(p.brushed, ground=(0.78, 0.64, 0.30)),
        "copper_brushed": partial(p.brushed, ground=(0.74, 0.45, 0.31)),
    },
}

NAMES: Mapping[str, Draw] = {name: draw for kind in KINDS.values() for name, draw in kind.items()}

# What people call a thing that such a texture is laid on, by the first part of its name.
PATTERNS = {
    **dict.fromkeys(("oak", "pine", "walnut", "cherry", "mahogany", "ebony", "birch", "ash", "teak"), "wooden"),
    "granite": "granite", "marble": "marble", "sandstone": "sandstone", "slate": "slate", "concrete": "concrete",
    "terrazzo": "terrazzo", "cobbles": "cobbled", "denim": "denim", "linen": "linen", "burlap": "burlap",
    "tweed": "tweed", "plaid": "plaid", "stripes": "striped", "felt": "felt", "polka": "dotted",
    "checker": "checkered", "chessboard": "checkered", "bricks": "brick", "tiles": "tiled", "plaster": "plastered",
    "rust": "rusty", "moss": "mossy", "sand": "sandy", "clouds": "clouded", "camouflage": "camouflaged",
    "paint": "spattered", "cork": "cork",
    **dict.fromkeys(("steel", "brass", "copper"), "metal"),
}  # fmt: skip


def pattern(name: str) -> str:
    """The word for things that the shipped texture is laid on: "checkered" for `checker_red`."""
    return PATTERNS[name.split("_")[0]]


@lru_cache(8)
def image(name: str) -> UInt8[np.ndarray, "256 256 3"]:
    """A shipped texture, always the same for its name; a color word, or `#rrggbb`, is plain paint.

    Raises RpaugError listing the known ones.
    """
    if name in color_space.NAMES or color_space.from_hex(name) is not None:
        return np.full((256, 256, 3), np.rint(255 * np.array(color_space.rgb(name))), np.uint8)
    if name not in NAMES:
        raise RpaugError(f"no texture is called {name!r}; {there_are(name, NAMES)}")
    seed = int.from_bytes(hashlib.blake2b(name.encode(), digest_size=8).digest(), "little")
    return p.finish(NAMES[name](np.random.default_rng(seed)))
