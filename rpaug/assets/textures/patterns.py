"""The patterns that shipped textures are made of: each draws one square that repeats without a seam."""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, Float64, Int64

from rpaug.core.jit import kernel

SIDE = 512  # texels drawn, then averaged down: edges come out smooth

Color = tuple[float, float, float]
Field = Float[np.ndarray, "side side"]
Picture = Float[np.ndarray, "side side 3"]


def noise(rng: np.random.Generator, wavelength: float, stretch: float = 1.0) -> Field:
    """Periodic Gaussian noise of unit variance, correlated over `wavelength` texels, `stretch` times that across."""
    down, across = np.fft.fftfreq(SIDE)[:, None], np.fft.rfftfreq(SIDE)[None, :]
    keep = np.exp(
        -0.5 * np.pi**2 * ((down * wavelength) ** 2 + (across * wavelength * stretch) ** 2)
    )
    smooth = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((SIDE, SIDE))) * keep, (SIDE, SIDE))
    return (smooth - smooth.mean()) / smooth.std()


def octaves(rng: np.random.Generator, wavelength: float, stretch: float = 1.0) -> Field:
    """Noise of five scales, each half as long and weaker than the one before, of unit variance."""
    total = sum(0.65**k * noise(rng, wavelength / 2**k, stretch) for k in range(5))
    return np.asarray(total / np.std(total))


def wood(
    rng: np.random.Generator, light: Color, dark: Color, rings: int = 5, planks: int = 1
) -> Picture:
    """Growth rings cut along the trunk, with pores; `planks` boards side by side, each its own piece."""
    down = np.arange(SIDE)[:, None] / SIDE
    wobble = 0.9 * noise(rng, 160, 3) + 0.1 * noise(rng, 30, 6)
    ring = 0.5 + 0.5 * np.sin(2 * np.pi * (rings * down + 0.8 * wobble))
    board = (down * planks).astype(int)[:, 0]
    shift = rng.integers(0, SIDE, planks)
    rows = np.stack([np.roll(ring[y], shift[board[y]]) for y in range(SIDE)])
    shade = 0.75 * rows**1.5 + 0.10 * noise(rng, 3, 24) + 0.06 * noise(rng, 10, 12)
    shade += (0.12 * rng.standard_normal(planks))[board][:, None] * (planks > 1)
    out = mix(light, dark, shade)
    if planks > 1:
        edge = np.abs((down * planks + 0.5) % 1 - 0.5) < 0.012 * planks
        out = np.where(edge[..., None], np.multiply(dark, 0.45), out)
    return out


def marble(rng: np.random.Generator, ground: Color, vein: Color, turns: float = 1.6) -> Picture:
    """Thin veins of one color through another."""
    field = octaves(rng, 200)
    lines = np.exp(-np.abs(np.sin(turns * field + 0.6 * octaves(rng, 90))) * 7)
    return mix(ground, vein, 0.8 * lines + 0.08 * octaves(rng, 24))


def speckle(rng: np.random.Generator, ground: Color, grains: Sequence[Color]) -> Picture:
    """Granite: grains of several colors in a ground."""
    out = mix(ground, (0.0, 0.0, 0.0), 0.05 * octaves(rng, 40))
    for grain in grains:
        share = np.clip((noise(rng, 7) - 0.9) * 4, 0, 1)
        out = out + share[..., None] * (np.asarray(grain) - out)
    return out


def layers(rng: np.random.Generator, first: Color, second: Color, count: int = 4) -> Picture:
    """Bands of sediment: sandstone, slate."""
    down = np.arange(SIDE)[:, None] / SIDE
    band = np.sin(2 * np.pi * count * down + 1.2 * noise(rng, 180, 2))
    return mix(first, second, 0.5 + 0.3 * band + 0.14 * octaves(rng, 40, 3))


def cells(
    rng: np.random.Generator, stones: Sequence[Color], gap: Color, count: int, width: float
) -> Picture:
    """Cobbles or terrazzo: about `count` cells around random points, `width` texels of gap between (Worley 1996)."""
    spots = rng.random((count, 2)) * SIDE
    y, x = np.arange(SIDE)[:, None] + 6 * noise(rng, 40), np.arange(SIDE)[None] + 6 * noise(rng, 40)
    owner, gaps = _nearest(y, x, spots)
    color = np.asarray(stones)[rng.integers(0, len(stones), count)]
    shade = 1 + 0.08 * rng.standard_normal(count)
    body = (color * shade[:, None])[owner] * (1 + 0.06 * octaves(rng, 20))[..., None]
    inside = np.clip((gaps - width) / 4, 0, 1)[..., None]
    return np.asarray(gap) * (1 - inside) + body * inside


@kernel
def _nearest(
    y: Float64[np.ndarray, "h w"], x: Float64[np.ndarray, "h w"], spots: Float64[np.ndarray, "n 2"]
) -> tuple[Int64[np.ndarray, "h w"], Float64[np.ndarray, "h w"]]:
    """Which spot is nearest to each place of a picture that repeats, and how much farther the next one is."""
    owner, gaps = np.zeros(y.shape, np.int64), np.zeros(y.shape)
    for r in range(y.shape[0]):
        for c in range(y.shape[1]):
            first, second = np.inf, np.inf  # squared
            for n in range(len(spots)):
                dy, dx = abs(y[r, c] - spots[n, 0]), abs(x[r, c] - spots[n, 1])
                dy, dx = min(dy, abs(SIDE - dy)), min(dx, abs(SIDE - dx))
                away = dy * dy + dx * dx
                if away < first:
                    owner[r, c], first, second = n, away, first
                elif away < second:
                    second = away
            gaps[r, c] = np.sqrt(second) - np.sqrt(first)
    return owner, gaps


def grain(
    rng: np.random.Generator,
    ground: Color,
    other: Color,
    wavelength: float,
    contrast: float = 0.25,
) -> Picture:
    """Cloudy noise between two colors: plaster, concrete, rust, moss."""
    return mix(ground, other, 0.4 + contrast * octaves(rng, wavelength))


def brushed(rng: np.random.Generator, ground: Color) -> Picture:
    """Metal with fine scratches along it. How it shines is left to the light that the recording shows."""
    scratch = 0.05 * noise(rng, 2, 60) + 0.03 * noise(rng, 6, 60) + 0.02 * noise(rng, 120)
    return np.asarray(ground) * (1 + scratch)[..., None]


def patches(rng: np.random.Generator, colors: Sequence[Color], wavelength: float) -> Picture:
    """Patches of plain colors with soft edges: camouflage, paint."""
    out = np.ones((SIDE, SIDE, 3)) * np.asarray(colors[0])
    for color in colors[1:]:
        share = np.clip((noise(rng, wavelength) - 0.45) * 14, 0, 1)
        out = out + share[..., None] * (np.asarray(color) - out)
    return out * (1 + 0.03 * noise(rng, 3))[..., None]


def weave(
    rng: np.random.Generator,
    warp: Sequence[Color],
    weft: Sequence[Color],
    threads: int,
    twill: int = 1,
) -> Picture:
    """Cloth of `threads` threads each way, colored in turn; `twill` threads are passed over at a time."""
    position = np.arange(SIDE) * threads / SIDE
    number = position.astype(int)
    over = ((number[:, None] + number[None]) // twill) % 2 == 0
    round_ = 0.72 + 0.28 * np.sin(np.pi * (position % 1))
    tall = np.asarray(warp)[number * len(warp) // threads][None] * round_[None, :, None]
    wide = np.asarray(weft)[number * len(weft) // threads][:, None] * round_[:, None, None]
    fuzz = (1 + 0.07 * noise(rng, 3) + 0.05 * noise(rng, 60))[..., None]
    return np.where(over[..., None], tall, wide) * fuzz


def checker(rng: np.random.Generator, first: Color, second: Color, count: int = 4) -> Picture:
    """`count` x `count` squares of two colors."""
    cell = np.arange(SIDE) * count // SIDE
    second_ = (cell[:, None] + cell) % 2 == 1
    return np.where(second_[..., None], second, first) * (1 + 0.02 * octaves(rng, 20))[..., None]


def bricks(
    rng: np.random.Generator,
    brick: Color,
    mortar: Color,
    rows: int,
    columns: int,
    bond: float = 0.5,
) -> Picture:
    """Bricks or tiles, `bond` of a brick set off in every other row."""
    y = np.arange(SIDE)[:, None] * rows / SIDE
    row = y.astype(int)
    x = np.arange(SIDE)[None] * columns / SIDE + bond * (row % 2)
    column = x.astype(int) % columns
    shade = (1 + 0.10 * rng.standard_normal((rows, columns)))[
        np.broadcast_to(row, column.shape), column
    ]
    margin = 5.0 / SIDE
    inside = (np.minimum(y % 1, 1 - y % 1) / rows > margin) & (
        np.minimum(x % 1, 1 - x % 1) / columns > margin
    )
    body = np.asarray(brick) * (shade * (1 + 0.06 * octaves(rng, 16)))[..., None]
    joint = np.asarray(mortar) * (1 + 0.06 * octaves(rng, 8))[..., None]
    return np.where(inside[..., None], body, joint)


def dots(rng: np.random.Generator, ground: Color, dot: Color, count: int = 4) -> Picture:
    """`count` x `count` discs, every other row set off by half."""
    y = np.arange(SIDE)[:, None] * count / SIDE
    x = np.arange(SIDE)[None] * count / SIDE + 0.5 * (y.astype(int) % 2)
    inside = np.hypot(y % 1 - 0.5, x % 1 - 0.5) < 0.28
    return np.where(inside[..., None], dot, ground) * (1 + 0.02 * octaves(rng, 20))[..., None]


def mix(first: Color, second: Color, share: Field) -> Picture:
    """From one color to another as `share` goes from 0 to 1."""
    return np.asarray(first) + np.clip(share, 0, 1)[..., None] * np.subtract(second, first)


def finish(picture: Picture) -> np.ndarray:
    """The picture at half the side, uint8 RGB."""
    small = cv2.resize(picture, (SIDE // 2, SIDE // 2), interpolation=cv2.INTER_AREA)
    return np.rint(np.clip(small, 0, 1) * 255).astype(np.uint8)
