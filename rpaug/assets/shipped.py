"""The household things that ship: drawn from a few lines each, never stored."""

import hashlib
from collections.abc import Callable, Mapping
from functools import partial

import cv2
import numpy as np
from jaxtyping import UInt8

from rpaug.assets import shapes as s
from rpaug.assets.textures import shipped as textures

SIDE = 128  # texels of a picture
Color = tuple[float, float, float]
Picture = UInt8[np.ndarray, "n n 3"]
Pieces = list[s.Piece]

WHITE, CREAM, BLACK = (0.92, 0.91, 0.88), (0.93, 0.88, 0.74), (0.09, 0.09, 0.10)
RED, BLUE, GREEN, YELLOW = (
    (0.78, 0.10, 0.09),
    (0.13, 0.27, 0.66),
    (0.16, 0.48, 0.20),
    (0.93, 0.78, 0.14),
)
ORANGE, BROWN, GREY, TEAL = (
    (0.93, 0.50, 0.10),
    (0.42, 0.25, 0.14),
    (0.58, 0.59, 0.61),
    (0.10, 0.47, 0.47),
)
PINK, PURPLE, STEEL = (0.90, 0.55, 0.62), (0.42, 0.20, 0.52), (0.68, 0.69, 0.71)


def plain(color: Color, grain: float = 0.025) -> Picture:
    """One color with a little grain, the same for the same color."""
    rng = _generator(f"plain {color}")
    field = cv2.GaussianBlur(rng.standard_normal((SIDE, SIDE)), (0, 0), 2)
    return _bytes(np.array(color) * (1 + grain * field / field.std())[..., None])


def banded(ground: Color, band: Color, low: float, high: float, lines: int = 0) -> Picture:
    """A band between two heights, as a label lies, with dark lines of print on it."""
    rows = 1 - (np.arange(SIDE) + 0.5) / SIDE
    inside = (rows > low) & (rows < high)
    image = plain(ground).astype(float) / 255
    image[inside] = plain(band).astype(float)[inside] / 255
    if lines:
        rng = _generator(f"print {ground} {band} {lines}")
        for row in np.linspace(low, high, lines + 2)[1:-1]:
            y = int((1 - row) * SIDE)
            for x in range(6, SIDE - 10, 10):
                if rng.random() < 0.75:
                    image[y : y + 2, x : x + int(rng.integers(4, 9))] *= 0.35
    return _bytes(image)


def striped(first: Color, second: Color, count: int, upright: bool = False) -> Picture:
    """Stripes around, or up and down."""
    place = (np.arange(SIDE) * count * 2 // SIDE) % 2
    image = np.where(place[:, None, None] == 0, np.array(first), np.array(second))
    whole = np.broadcast_to(image, (SIDE, SIDE, 3))
    return _bytes(whole.transpose(1, 0, 2) if upright else whole)


def spotted(ground: Color, spot: Color, count: int, size: float) -> Picture:
    """Round spots on a ground."""
    rng = _generator(f"spots {ground} {spot} {count}")
    image = plain(ground)
    for x, y in rng.integers(0, SIDE, (count, 2)):
        color = tuple(int(255 * c) for c in spot)
        cv2.circle(image, (int(x), int(y)), max(1, int(size * SIDE)), color, -1, cv2.LINE_AA)
    return image


def texture(name: str) -> Picture:
    """A shipped texture, at the size of the other pictures."""
    return cv2.resize(textures.image(name), (SIDE, SIDE), interpolation=cv2.INTER_AREA)


def _ball(radius: float, picture: Picture, squeeze: float = 1.0) -> s.Piece:
    turn = np.linspace(-np.pi / 2, np.pi / 2, 17)
    return s.turned(
        [
            (radius * max(float(np.cos(a)), 0.0), radius * squeeze * (1 + float(np.sin(a))))
            for a in turn
        ],
        picture,
    )


def _vessel(
    low: float,
    high: float,
    height: float,
    wall: float,
    outside: Picture,
    inside: Picture,
    belly: float = 0.0,
) -> Pieces:
    """An open vessel: radius at foot and rim, with a wall of that thickness."""
    steps = np.linspace(0, 1, 9)
    radius = low + (high - low) * steps + belly * np.sin(np.pi * steps)
    shell = [(0.0, 0.0), *zip(radius.tolist(), (height * steps).tolist(), strict=True)]
    hollow = [
        (float(r - wall), float(h))
        for r, h in zip(radius[::-1], height * steps[::-1], strict=True)
        if h > 2 * wall
    ]
    rim = [shell[-1], hollow[0]]
    return [
        s.turned(shell, outside),
        s.turned(rim, outside),
        s.turned([*hollow, (0.0, 2 * wall)], inside),
    ]


def _handle(
    radius: float, low: float, high: float, out: float, thick: float, picture: Picture
) -> s.Piece:
    turn = np.linspace(-np.pi / 2, np.pi / 2, 15)
    middle, reach = (low + high) / 2, (high - low) / 2
    path = np.stack(
        [
            radius - thick / 2 + out * np.cos(turn),
            np.zeros_like(turn),
            middle + reach * np.sin(turn),
        ],
        -1,
    )
    return s.bent(path, thick, picture)


def _mug(color: Color) -> Pieces:
    return [
        *_vessel(0.038, 0.040, 0.095, 0.003, plain(color), plain(WHITE)),
        _handle(0.039, 0.022, 0.075, 0.026, 0.005, plain(color)),
    ]


def _bottle(glass: Color, label: Color, cap: Color) -> Pieces:
    body = [
        (0.0, 0.0),
        (0.032, 0.0),
        (0.034, 0.004),
        (0.034, 0.125),
        (0.030, 0.145),
        (0.020, 0.165),
        (0.013, 0.180),
        (0.013, 0.205),
    ]
    lid = [(0.015, 0.203), (0.015, 0.222), (0.0, 0.222)]
    return [
        s.turned(body, banded(glass, label, 0.25, 0.55, 4)),
        s.turned([(0.013, 0.203), *lid], plain(cap)),
    ]


def _can(color: Color, band: Color) -> Pieces:
    side = [(0.028, 0.0), (0.033, 0.006), (0.033, 0.110), (0.028, 0.118)]
    return [
        s.turned([(0.0, 0.0), (0.028, 0.0)], plain(STEEL)),
        s.turned(side, banded(color, band, 0.35, 0.7, 3)),
        s.turned([(0.028, 0.118), (0.026, 0.115), (0.0, 0.115)], plain(STEEL)),
    ]


def _jar(inside: Color, lid: Color) -> Pieces:
    body = [(0.0, 0.0), (0.036, 0.0), (0.040, 0.005), (0.040, 0.080), (0.034, 0.090)]
    return [
        s.turned(body, banded(inside, WHITE, 0.35, 0.8, 5)),
        s.turned([(0.036, 0.090), (0.037, 0.091), (0.037, 0.106), (0.0, 0.106)], plain(lid)),
    ]


def _book(cover: Color, width: float, depth: float, thick: float) -> Pieces:
    board, t = plain(cover), 0.003
    return [
        s.box((width, depth, t), board),
        s.box((width, depth, t), banded(cover, CREAM, 0.55, 0.8, 3), foot=thick - t),
        s.box((width, t, thick - 2 * t), board, middle=(0.0, -depth / 2 + t / 2), foot=t),
        s.box((width - 0.008, depth - 0.008, thick - 2 * t), striped(CREAM, WHITE, 24), foot=t),
    ]


def _candle() -> Pieces:
    return [
        s.turned(
            [(0.0, 0.0), (0.03, 0.0), (0.03, 0.07), (0.027, 0.074), (0.0, 0.071)], plain(CREAM)
        ),
        s.turned([(0.0012, 0.070), (0.0012, 0.083), (0.0, 0.083)], plain(BLACK)),
    ]


def _die() -> Pieces:
    return [s.box((0.05, 0.05, 0.05), spotted(WHITE, BLACK, 5, 0.07))]


def _cone() -> Pieces:
    return [
        s.box((0.09, 0.09, 0.006), plain(ORANGE)),
        s.turned([(0.034, 0.006), (0.008, 0.115), (0.0, 0.115)], banded(ORANGE, WHITE, 0.4, 0.62)),
    ]


def _remote() -> Pieces:
    return [s.box((0.045, 0.160, 0.018), spotted(BLACK, GREY, 30, 0.035))]


def _stack(*sizes: tuple[tuple[float, float, float], Color]) -> Pieces:
    pieces, foot = [], 0.0
    for size, color in sizes:
        pieces.append(s.box(size, plain(color), foot=foot))
        foot += size[2]
    return pieces


def _hexagon(radius: float) -> list[tuple[float, float]]:
    return [
        (radius * float(np.cos(a)), radius * float(np.sin(a))) for a in np.arange(6) * np.pi / 3
    ]


THINGS: Mapping[str, tuple[str, Callable[[], Pieces]]] = {
    "mug_red": ("mug", partial(_mug, RED)),
    "mug_blue": ("mug", partial(_mug, BLUE)),
    "cup_white": ("cup", lambda: _vessel(0.026, 0.036, 0.080, 0.002, plain(WHITE), plain(WHITE))),
    "tumbler_teal": (
        "cup",
        lambda: _vessel(0.030, 0.036, 0.110, 0.002, striped(TEAL, WHITE, 6), plain(TEAL)),
    ),
    "bowl_yellow": (
        "bowl",
        lambda: _vessel(0.030, 0.070, 0.050, 0.003, plain(YELLOW), plain(CREAM), 0.010),
    ),
    "bowl_wood": (
        "bowl",
        lambda: _vessel(0.035, 0.080, 0.060, 0.005, texture("walnut"), texture("walnut"), 0.012),
    ),
    "plate_white": (
        "plate",
        lambda: _vessel(0.060, 0.095, 0.018, 0.003, plain(WHITE), plain(WHITE)),
    ),
    "bottle_green": ("bottle", partial(_bottle, GREEN, CREAM, RED)),
    "bottle_blue": ("bottle", partial(_bottle, BLUE, WHITE, WHITE)),
    "can_red": ("can", partial(_can, RED, WHITE)),
    "can_orange": ("can", partial(_can, ORANGE, YELLOW)),
    "jar_jam": ("jar", partial(_jar, (0.50, 0.06, 0.10), GREY)),
    "jar_honey": ("jar", partial(_jar, (0.85, 0.55, 0.10), YELLOW)),
    "vase_purple": (
        "vase",
        lambda: _vessel(0.030, 0.028, 0.160, 0.003, plain(PURPLE), plain(PURPLE), 0.022),
    ),
    "flowerpot": (
        "vase",
        lambda: _vessel(0.040, 0.058, 0.090, 0.004, plain((0.68, 0.36, 0.22)), plain(BROWN)),
    ),
    "candle": ("candle", _candle),
    "ball_red": ("ball", lambda: [_ball(0.035, striped(RED, WHITE, 2))]),
    "ball_tennis": ("ball", lambda: [_ball(0.033, banded((0.75, 0.86, 0.20), WHITE, 0.46, 0.54))]),
    "orange": ("fruit", lambda: [_ball(0.037, plain(ORANGE, 0.05), 0.95)]),
    "apple": ("fruit", lambda: [_ball(0.036, spotted(RED, (0.86, 0.50, 0.25), 40, 0.02), 0.92)]),
    "lemon": ("fruit", lambda: [_ball(0.030, plain(YELLOW, 0.05), 1.25)]),
    "book_blue": ("book", partial(_book, BLUE, 0.13, 0.19, 0.024)),
    "book_red": ("book", partial(_book, RED, 0.11, 0.17, 0.030)),
    "cereal_box": (
        "box",
        lambda: [s.box((0.065, 0.180, 0.240), banded(YELLOW, RED, 0.45, 0.85, 4))],
    ),
    "tissue_box": ("box", lambda: [s.box((0.115, 0.120, 0.085), spotted(TEAL, WHITE, 30, 0.05))]),
    "soap": ("bathroom", lambda: [s.box((0.085, 0.055, 0.028), plain(PINK))]),
    "sponge": (
        "kitchen",
        lambda: _stack(((0.11, 0.07, 0.025), YELLOW), ((0.11, 0.07, 0.008), GREEN)),
    ),
    "brick": ("block", lambda: [s.box((0.10, 0.05, 0.032), texture("bricks_red"))]),
    "block_oak": ("block", lambda: [s.box((0.06, 0.06, 0.06), texture("oak"))]),
    "die": ("toy", _die),
    "cone_orange": ("toy", _cone),
    "blocks": (
        "toy",
        lambda: _stack(
            ((0.06, 0.06, 0.03), RED), ((0.05, 0.05, 0.03), BLUE), ((0.04, 0.04, 0.03), YELLOW)
        ),
    ),
    "remote": ("office", _remote),
    "eraser": (
        "office",
        lambda: [s.box((0.055, 0.022, 0.013), striped(PINK, BLUE, 1, upright=True))],
    ),
    "puck": ("toy", lambda: [s.prism(_hexagon(0.04), 0.025, spotted(GREEN, YELLOW, 8, 0.06))]),
}
"""Category and pieces by name."""


def _generator(name: str) -> np.random.Generator:
    return np.random.default_rng(
        int.from_bytes(hashlib.blake2b(name.encode(), digest_size=8).digest(), "little")
    )


def _bytes(image: np.ndarray) -> Picture:
    return np.rint(np.clip(image, 0, 1) * 255).astype(np.uint8)
