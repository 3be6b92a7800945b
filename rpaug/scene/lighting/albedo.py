"""What color a thing has under its shading: read off its pixels, or fitted to a given one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from rpaug.core import color_space, memo, sampling
from rpaug.core.errors import TargetError, Unsupported
from rpaug.core.jit import kernel
from rpaug.core.types import Episode, Surface

LEAST_PIXELS = 8
MOST_PIXELS = 1 << 19  # evenly spread: more of them tell the same
BLACK = 0.01  # an albedo below this shows no shading above the images' rounding
DARK, BRIGHT = (
    0.04,
    0.98,
)  # of the brightest channel: darker pixels are noise, brighter ones are clipped
HIGHLIGHT = 0.05  # least whitish part of a plain surface's pixel that is taken for a highlight
LIT = 0.98  # quantile of shading that counts as fully lit: a new color must not be clipped where the old was not
PLAIN = 0.03  # color distance within which a pixel is explained by one albedo and its shading
PLAIN_SHARE = 0.8
GRAYISH = 0.06  # the same of a hue too near gray to tell a white part: nearer than a darker hue and much white
HUELESS = 0.05  # squared sine of the angle between white and a hue below which nothing tells its white part
WHITER = 1e-3  # what white parts weigh where hues explain a pixel alike
PARTS, PART_SHARE = (
    8,
    0.97,
)  # hues at most by which parts are told, and the pixels that they must explain
SEEN = 4000  # pixels from which parts are told
HUES = 4  # at most, that together explain a thing of several colors
TRIED = 64  # pixels, each as the hue of all others
MATTE = 0.5  # of its hue's typical light: a highlight lies where the matte part is well lit too
OVERLIT = 0.25  # share of clipped pixels from which a surface's true brightness is hidden


# Brightest channel of a metal, display sRGB: median of the ten metals that the Autodesk Standard Surface guide lists.
METAL = 0.88
GUESSES: Mapping[str, str] = {  # by what an edit stores of a surface
    "overlit": "painted surfaces are recorded as bright as can be",
    "of_metal": "painted surfaces are of metal, whose pixels do not show how bright its color is",
    "in_shadow": "painted surfaces lie where shadows pass whose lamps are not known",
}

Rgb = tuple[float, float, float]


@dataclass(frozen=True)
class Albedo:
    """A display color, and whether it alone explains the surface (`plain`) or is the mean of a pattern.

    Where a few `hues` together explain a surface that is not plain, they are its parts' colors under typical light.
    So much of an `overlit` surface is recorded as bright as can be that its color may be brighter in truth.
    """

    rgb: tuple[float, float, float]
    plain: bool
    overlit: bool = False
    hues: tuple[tuple[float, float, float], ...] = ()


def pixels(episode: Episode, instance_id: int, count: int = 6) -> Float64[np.ndarray, "n 3"]:
    """Recorded colors of an instance, 0..1 and beyond where radiance is known, away from its outline where it is large
    enough for that."""
    inner: list[np.ndarray] = []
    outer: list[np.ndarray] = []
    for looked in (count, episode.length):  # a camera that moves may show it in others alone
        for name, t, rgb, ids in sampling.images(episode, looked):
            if ids is None or not (mask := ids == instance_id).any():
                continue
            radiance = episode.views[name].radiance
            color = rgb / 255.0 if radiance is None else radiance(t).astype(np.float64)
            outer.append(color[mask])
            inner.append(color[_eroded(mask)])
        if outer:
            break
    inside = np.concatenate(inner) if inner else np.empty((0, 3))
    return inside if len(inside) >= LEAST_PIXELS else np.concatenate([*outer, inside])


def estimate(color: Float64[np.ndarray, "n 3"], white: float = 1.0) -> Albedo:
    """The albedo of a surface from its pixels, cut off at `white`: the direction of their mean, as bright as its
    well-lit part.

    Shading scales a matte color and leaves its direction, so the direction is the mean's; how bright an albedo is
    cannot be told from shading, and its best-lit pixels are taken to show it.
    """
    color = color[:: max(1, -(-len(color) // MOST_PIXELS))]
    high = color.max(1)
    good = color[(high > DARK) & (high < BRIGHT * white)]
    if len(good) < LEAST_PIXELS:
        good = color
    mean = good.mean(0)
    for _ in range(3):  # leave highlights out if what remains is one color
        inliers = good[_explained(good, mean)]
        if len(inliers) < PLAIN_SHARE * len(good):
            break
        mean = inliers.mean(0)
    if mean.max() < 1e-3:
        return Albedo((0.0, 0.0, 0.0), True)
    shading = (
        color[high > DARK] @ mean / (mean @ mean)
    )  # clipped pixels too: they are the brightest
    lit = mean * np.quantile(shading, LIT)
    if white > 1:  # no channel was cut off: the direction holds
        lit = lit / max(float(lit.max()), 1.0)
    red, green, blue = np.minimum(lit, 1.0).tolist()
    plain = bool(_explained(good, mean).mean() >= PLAIN_SHARE)
    return Albedo(
        (red, green, blue),
        plain=plain,
        overlit=bool((high >= BRIGHT * white).mean() >= OVERLIT),
        hues=() if plain else _hues(good),
    )


def _hues(
    color: Float64[np.ndarray, "n 3"], most: int = HUES, share: float = PLAIN_SHARE
) -> tuple[tuple[float, float, float], ...]:
    """The few colors that explain this share of pixels by their shading and highlights, the most frequent first; none
    if no few do."""
    left = color
    found: list[np.ndarray] = []
    while len(left) > (1 - share) * len(color):
        if len(found) == most:
            return ()
        tried = left[:: max(1, len(left) // TRIED)]
        own = left[max((_explained(left, hue) for hue in tried), key=np.count_nonzero)]
        found.append(np.median(own, 0))
        _, explained = _lit(left.astype(np.float32), found[-1].astype(np.float32))
        left = left[~explained]
    return tuple((float(red), float(green), float(blue)) for red, green, blue in found)


def describe(
    episode: Episode, instance_id: int, known: tuple[float, float, float] | None = None
) -> dict[str, Any]:
    """What an edit stores of an instance's surface: instance id, albedo (`known` if it is), whether it is plain, and
    whether it is `overlit`, unless its albedo is known.

    Raises Unsupported for a black one, and for one that no recorded pixel shows.
    """
    found = _estimated(episode, instance_id)
    rgb = found.rgb if known is None else known
    if max(rgb) < BLACK:
        raise Unsupported(
            f"instance {instance_id} is black: no shading can be read off it to paint with"
        )
    surface = {"handle": instance_id, "albedo": list(rgb), "plain": found.plain}
    if found.hues:
        surface["hues"] = [list(hue) for hue in found.hues]
    return surface | ({"overlit": True} if found.overlit and known is None else {})


def part(episode: Episode, instance_id: int, word: str) -> dict[str, Any]:
    """As `describe`, of what is of one color word on a thing of several: `part` numbers its `hues` that are.

    Raises Unsupported for a thing of one color, or of so many that its parts cannot be told, and TargetError if none
    of its colors goes by the word.
    """
    seen, hues, found = _parts(episode, instance_id)
    owner = owners(seen.astype(np.float32), hues)
    names = [color_space.nearest(np.array(one)) for one in found]
    own = [number for number, one in enumerate(names) if color_space.means(word, one)] or [
        number for number, one in enumerate(found) if color_space.hued(word, np.array(one))
    ]
    if not own:
        shown = ", ".join(dict.fromkeys(names))
        raise TargetError(f"instance {instance_id} has nothing {word}; it shows {shown}")
    if len(own) == len(hues):
        raise Unsupported(f"instance {instance_id} is {word} all over: leave out `only`")
    whole = estimate(seen[np.isin(owner, own)])
    return {
        "handle": instance_id,
        "albedo": list(whole.rgb),
        "plain": len(own) == 1,
        "hues": [list(hue) for hue in hues],
        "part": own,
    }


def words(episode: Episode, instance_id: int) -> tuple[str, ...]:
    """The color words of a thing's parts, none where they are too many to tell."""
    try:
        _, _, found = _parts(episode, instance_id)
    except Unsupported:
        return ()
    return tuple(dict.fromkeys(color_space.nearest(np.array(one)) for one in found))


@memo.of_episode
def _parts(
    episode: Episode, instance_id: int
) -> tuple[Float64[np.ndarray, "n 3"], Sequence[Rgb], Sequence[Rgb]]:
    """Pixels of a thing, the hues that part it, and the color of each part. Raises Unsupported."""
    seen = pixels(episode, instance_id)
    if not len(seen):
        raise Unsupported(f"instance {instance_id} cannot be painted: no recorded image shows it")
    seen = seen[:: max(1, len(seen) // SEEN)]
    high = seen.max(1)
    hues = _hues(seen[(high > DARK) & (high < BRIGHT)], PARTS, PART_SHARE)
    if not hues:
        raise Unsupported(f"instance {instance_id} has too many colors to tell its parts by them")
    owner = owners(seen.astype(np.float32), hues)
    own = [seen[owner == number] for number in range(len(hues))]
    # A hue that another one explains as well owns nothing.
    kept = [number for number, one in enumerate(own) if len(one)]
    return seen, [hues[number] for number in kept], [estimate(own[number]).rgb for number in kept]


def owners(
    color: Float32[np.ndarray, "n 3"], hues: Sequence[tuple[float, float, float]]
) -> Int64[np.ndarray, "n"]:
    """Which of the hues each pixel has: the one whose shading comes nearest, or that shows a highlight there."""
    costs = []
    for hue in np.array(hues, np.float32):
        shade = color @ hue / max(float(hue @ hue), 1e-9)
        off = np.linalg.norm(color - shade[:, None] * hue, axis=1)
        part, explained = _lit(color, hue)
        # Of explanations as near the one with less white.
        costs.append(np.where(explained, np.minimum(off, PLAIN) + WHITER * part[:, 0], off))
    return np.argmin(costs, 0)


def guessed(surfaces: Sequence[Mapping[str, Any]]) -> dict[str, tuple[int, int]]:
    """How many of an edit's surfaces do not tell how bright their albedo is, in the words of `Operator.falls_short`."""
    reasons = [one for one in GUESSES if one == "overlit" or any(s.get(one) for s in surfaces)]
    return {
        f"{GUESSES[one]}: how bright they come out is a guess": (
            sum(s.get(one, False) for s in surfaces),
            len(surfaces),
        )
        for one in reasons
    }


def plain(episode: Episode, instance_id: int) -> bool:
    """Whether one color, under any light, explains what is seen of an instance."""
    return _estimated(episode, instance_id).plain


@memo.of_episode
def _estimated(episode: Episode, instance_id: int) -> Albedo:
    seen = pixels(episode, instance_id)
    if not len(seen):
        raise Unsupported(
            f"instance {instance_id} cannot be painted: no recorded image shows it "
            "(what an edit put in has its color there)"
        )
    return estimate(seen, np.inf if cut_off_known(episode) else 1.0)


def cut_off_known(episode: Episode) -> bool:
    """Whether every camera tells what lies beyond white."""
    return all(view.radiance is not None for view in episode.views.values())


def shine(
    color: Float32[np.ndarray, "n 3"],
    surface: Surface,
    old: Float32[np.ndarray, "3"],
    plain: bool,
    hues: Sequence[Rgb] = (),
) -> Float32[np.ndarray, "n 3"] | Float32[np.ndarray, "n 1"]:
    """The part of each color that is a highlight: what the surface is known to mirror, else what its hues tell."""
    by_hue = highlight(color, old) if plain else highlights(color, hues)
    known = surface.mirrored
    if known is None:
        return by_hue
    return np.where(np.isnan(known), by_hue, np.minimum(known, color))


def highlight(
    color: Float32[np.ndarray, "n 3"], old: Float32[np.ndarray, "3"]
) -> Float32[np.ndarray, "n 1"]:
    """The white part s of each pixel = d * old + s * (1, 1, 1), d and s >= 0; 0 where it may be noise.

    An albedo that is itself nearly grey gives no way to tell: then 0.
    """
    white = np.ones(3, np.float32)
    a, b, c = float(old @ old), float(old @ white), 3.0
    determinant = a * c - b * b
    if determinant <= HUELESS * a * c:
        return np.zeros((len(color), 1), np.float32)
    return _white_part(color, old, np.float32(a / determinant), np.float32(b / determinant))


@kernel
def _white_part(
    color: Float32[np.ndarray, "n 3"], old: Float32[np.ndarray, "3"], a: float, b: float
) -> Float32[np.ndarray, "n 1"]:
    """a times what a color has of white, less b times what it has of `old`, and no more than its darkest channel."""
    out = np.zeros((len(color), 1), np.float32)
    for n in range(len(color)):
        red, green, blue = color[n]
        part = a * (red + green + blue) - b * (red * old[0] + green * old[1] + blue * old[2])
        part = min(part, red, green, blue)
        if part > HIGHLIGHT:
            out[n, 0] = part
    return out


def highlights(
    color: Float32[np.ndarray, "n 3"], hues: Sequence[tuple[float, float, float]]
) -> Float32[np.ndarray, "n 1"]:
    """The same on a surface of several hues: the least white part by which one of them explains a pixel, 0 if none."""
    least = np.full((len(color), 1), np.inf, np.float32)
    for hue in np.array(hues, np.float32):
        part, explained = _lit(color, hue)
        least[explained] = np.minimum(least[explained], part[explained])
    return np.where(np.isfinite(least), least, 0).astype(np.float32)


def _lit(
    color: Float32[np.ndarray, "n 3"], hue: Float32[np.ndarray, "3"]
) -> tuple[Float32[np.ndarray, "n 1"], Bool[np.ndarray, "n"]]:
    """The white part of each pixel, were it of this hue, and whether hue and white part explain it."""
    gray = 1 - float(hue.sum()) ** 2 / max(3 * float(hue @ hue), 1e-9) <= HUELESS
    near = GRAYISH if gray else PLAIN
    part = highlight(color, hue)
    matte = color - part
    shade = matte @ hue / max(float(hue @ hue), 1e-9)
    off = np.linalg.norm(matte - shade[:, None] * hue, axis=1)
    return part, (off < near) & ((part[:, 0] == 0) | (shade > MATTE))


def _explained(
    color: Float64[np.ndarray, "n 3"], albedo: Float64[np.ndarray, "3"]
) -> Bool[np.ndarray, "n"]:
    shading = color @ albedo / max(float(albedo @ albedo), 1e-9)
    return np.linalg.norm(color - shading[:, None] * albedo, axis=1) < PLAIN


def _eroded(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """The mask without its outermost two pixels."""
    for _ in range(2):
        padded = np.pad(mask, 1)
        mask = mask & padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    return mask
