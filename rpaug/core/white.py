"""What white looks like in a clip, and what its colors would look like in white light: people name colors by that."""

import cv2
import numpy as np
from jaxtyping import Bool, Float64

from rpaug.core import color_space, memo, sampling
from rpaug.core.types import Episode

COUNT = 3  # frames of each camera that are looked at
DARK, CLIPPED = 0.2, 0.97  # of a channel's range: what is darker or brighter tells no hue
COLORED = 0.45  # saturation: more is no white in a lamp's light
BLUE = 1.18  # blue by red: more is no white in the sky's, as cameras balance it
GREEN = 0.08  # of the brightest channel: farther off the middle of red and blue is green in neither
MIXED = 1 / 160  # of an image's side: so near to a colored thing hues are mixed
BRIGHT = 0.95  # quantile of brightness among what may be white: what is brighter is
GRAY = 0.12  # saturation up to which a surface may be gray where light is hardly colored
SOME = 0.25  # of the brightest is gray, if light is
WHITE = 0.99  # quantile of pixels' brightness that shows white in this light
DIMMEST = 0.48  # display: a clip without anything white is not taken to be darker lit
WHITEST = 0.9  # albedo of the whitest things that rooms hold

Triple = tuple[float, float, float]


@memo.last
def hue(episode: Episode) -> Float64[np.ndarray, "3"]:
    """The hue of white in the clip's light, in display sRGB of mean 1; white where nothing tells it.

    No surface is brighter than white in the same light (the white-patch assumption, Land 1977). If some of the
    brightest that a lamp or the sky may show white is near to gray, it is the median of all that is: robots and walls
    mostly are. Else light is colored, and it is that of the brightest.
    """
    seen = []
    for _, _, rgb, _ in sampling.images(episode, COUNT):
        color = cv2.GaussianBlur(rgb, (0, 0), 1) / 255.0  # noise has hues
        high = color.max(-1)
        told = (_lamplike(color) & (high > DARK) & (high < CLIPPED)).astype(np.uint8)
        apart = 2 * max(1, round(MIXED * min(told.shape))) + 1
        seen.append(color[cv2.erode(told, np.ones((apart, apart), np.uint8)) > 0][::3])
    color = np.concatenate(seen)
    if not len(color):
        return np.ones(3)
    brightness = color.mean(1)
    bright = brightness >= np.quantile(brightness, BRIGHT)
    gray = np.ptp(color, 1) < GRAY * color.max(1)
    white = color[gray if gray[bright].mean() > SOME else bright]
    middle = np.median(white / white.mean(1, keepdims=True), 0)
    return np.asarray(middle / middle.mean())


def _lamplike(color: Float64[np.ndarray, "h w 3"]) -> Bool[np.ndarray, "h w"]:
    """Which colors white may have in the light of a lamp or the sky, which are near to black bodies' (2700 K on)."""
    red, green, blue = np.moveaxis(color, -1, 0)
    high, low = color.max(-1), color.min(-1)
    off = np.abs(green - (red + blue) / 2)
    return (high - low < COLORED * high) & (blue < BLUE * red) & (off < GREEN * high)


@memo.of_episode
def shown(episode: Episode) -> Float64[np.ndarray, "3"]:
    """Display color of white in the clip's light: its brightest channel as bright as the clip's pixels are."""
    bright = [
        np.quantile(rgb.max(-1), WHITE) / 255 for _, _, rgb, _ in sampling.images(episode, COUNT)
    ]
    tint = hue(episode)
    return np.asarray(max(*bright, DIMMEST) * tint / tint.max())


def full(episode: Episode) -> Float64[np.ndarray, "3"]:
    """Display color that something would show in the clip's light that returns all of it; 1 at most."""
    return np.asarray(np.minimum(shown(episode) / WHITEST, 1.0))


def in_white_light(episode: Episode, color: Triple) -> Triple:
    """What shows so in the clip, as it would in light in which white is the display's (von Kries)."""
    lit = color_space.to_linear(np.array(color)) / color_space.to_linear(shown(episode))
    red, green, blue = np.clip(color_space.from_linear(lit), 0, 1).tolist()
    return red, green, blue
