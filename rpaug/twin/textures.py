"""Textures drawn from a seed: wood, plaster, tiles, the pictures on the blocks, and what may cover any part.

Each has detail at several scales down to single texels (so that matching and reprojection have
something to hold on to, and no gradient is smooth enough to band in 8 bits) and repeats without a
seam.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np
from jaxtyping import Float, UInt8

SIDE = 512  # texels


def noise(
    rng: np.random.Generator, wavelength: tuple[float, float], side: int = SIDE
) -> Float[np.ndarray, "side side"]:
    """Periodic Gaussian noise of unit variance, correlated over `wavelength` texels down and across."""
    down, across = np.fft.fftfreq(side)[:, None], np.fft.fftfreq(side)[None, :]
    keep = np.exp(-0.5 * ((down * wavelength[0]) ** 2 + (across * wavelength[1]) ** 2) * np.pi**2)
    smooth = np.fft.ifft2(np.fft.fft2(rng.standard_normal((side, side))) * keep).real
    return smooth / smooth.std()


def grain(
    rng: np.random.Generator, color: tuple[float, float, float], stretch: float, contrast: float
) -> UInt8[np.ndarray, "n n 3"]:
    """`color` with fibres `stretch` times longer than wide (1: plaster, 12: wood), in five octaves."""
    shade = sum(
        0.75**octave * noise(rng, (wavelength, wavelength * stretch))
        for octave, wavelength in enumerate((64, 32, 16, 8, 4))
    )
    shade = 1 + contrast * (shade / np.std(shade) + 0.3 * noise(rng, (1, stretch)))
    return _image(np.asarray(color) * shade[..., None])


def tiles(
    rng: np.random.Generator, color: tuple[float, float, float], count: int
) -> UInt8[np.ndarray, "n n 3"]:
    """`count` x `count` tiles, each of its own shade, with grout between and plaster-like grain."""
    cell = np.arange(SIDE) * count // SIDE
    shade = (1 + 0.06 * rng.standard_normal((count, count)))[cell[:, None], cell]
    edge = (np.arange(SIDE) * count % SIDE) < 3 * count
    shade = np.where(edge[:, None] | edge, 0.72, shade)
    return _image(grain(rng, color, 1, 0.025) / 255.0 * shade[..., None])


def halves(
    first: tuple[float, float, float], second: tuple[float, float, float]
) -> UInt8[np.ndarray, "n n 3"]:
    """Two plain colors, side by side."""
    left = np.arange(SIDE)[None, :, None] < SIDE // 2
    return _image(np.where(left, first, second) * np.ones((SIDE, 1, 1)))


def marble(
    rng: np.random.Generator,
    first: tuple[float, float, float],
    second: tuple[float, float, float],
) -> UInt8[np.ndarray, "n n 3"]:
    """Veins of one color through another."""
    vein = np.sin(2.5 * noise(rng, (120, 120)) + 0.8 * noise(rng, (40, 40)))
    mix = 0.5 + 0.45 * vein + 0.04 * noise(rng, (4, 4))
    return _image(np.asarray(first) + np.clip(mix, 0, 1)[..., None] * np.subtract(second, first))


def checks(
    first: tuple[float, float, float], second: tuple[float, float, float], count: int
) -> UInt8[np.ndarray, "n n 3"]:
    """`count` x `count` squares of two colors in turn; an even count repeats without a seam."""
    cell = np.arange(SIDE) * count // SIDE
    odd = (cell[:, None] + cell) % 2 == 1
    return _image(np.where(odd[..., None], first, second))


def spots(
    rng: np.random.Generator,
    first: tuple[float, float, float],
    second: tuple[float, float, float],
) -> UInt8[np.ndarray, "n n 3"]:
    """Blotches of one color on another, with soft rims."""
    mix = 0.5 + 0.5 * np.tanh(3 * (noise(rng, (70, 70)) - 0.6))
    return _image(np.asarray(second) + mix[..., None] * np.subtract(first, second))


@lru_cache(32)  # one picture covers several parts
def picture(kind: str, seed: int) -> UInt8[np.ndarray, "n n 3"]:
    """One of the `KINDS` in colors and details that the seed draws."""
    rng = np.random.default_rng(seed)
    return _PICTURES[kind](rng, _color(rng), _color(rng))


def _color(rng: np.random.Generator) -> tuple[float, float, float]:
    red, green, blue = rng.uniform(0.2, 0.95, 3)
    return float(red), float(green), float(blue)


_PICTURES: Mapping[str, Callable[..., UInt8[np.ndarray, "n n 3"]]] = {
    "wood": lambda rng, first, second: grain(rng, first, 10, 0.12),
    "plaster": lambda rng, first, second: grain(rng, first, 1, 0.08),
    "tiles": lambda rng, first, second: tiles(rng, first, 4),
    "marble": marble,
    "checks": lambda rng, first, second: checks(first, second, 4),
    "spots": spots,
}
KINDS = tuple(_PICTURES)


def _image(color: Float[np.ndarray, "n n 3"]) -> UInt8[np.ndarray, "n n 3"]:
    return np.clip(np.round(color * 255), 0, 255).astype(np.uint8)
