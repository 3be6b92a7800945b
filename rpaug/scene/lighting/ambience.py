"""The light a new thing has to be shown in: how bright faces are by where they turn, and of which color."""

import cv2
import numpy as np
from jaxtyping import Float64, Int

from rpaug.core import color_space, sampling, white
from rpaug.core.errors import SourceLacks
from rpaug.core.memo import once
from rpaug.core.types import Ambience, Episode
from rpaug.scene.lighting import irradiance, light
from rpaug.scene.recorded import surface

FRAMES = 8
PASSES = 8  # of the alternation between albedos and light, both robust
RIDGE = 3e-4  # of the light's terms but the even one, where few faces tell them
FEW, NEARLY_ALL = 16, (0.1, 0.9)  # pixels of a thing's hue that tell its albedo, and quantiles
AGREE = 1.05  # of one of them, at most, is the other
HUE, HUES = 0.06, 64  # chromaticity within which a thing has one albedo, and more than there are
DARK, CLIPPED = 0.03, 0.97  # brightest channel of pixels that tell something of light
ENDS = (0.01, 0.995)  # quantiles of lightness that count as a recording's darkest and brightest
CAST = 0.12  # difference between channels below which light counts as white: walls are as yellow as that
UP = np.array([[0.0, 0.0, 1.0]], np.float32)
STEP = 7  # pixels, of which one is looked at for its color


@once
def estimate(episode: Episode) -> Ambience:
    """The irradiance that explains best how each thing's brightness depends on where its faces turn, 1 on level ones.

    Every hue of a thing has one albedo, fitted along; pixels that the fit leaves far off count less, and so do things
    that face one way alone. No image tells how bright light is, but none reflects more than falls on it: light is as
    much above 1 as the whitest thing needs. Raises SourceLacks without depth.
    """
    if all(view.depth is None and view.proxy for view in episode.views.values()):
        return _unseen(episode)
    facing, level, high, things = _seen(episode)
    _, owner = np.unique(things, return_inverse=True)
    terms = irradiance.basis(facing.astype(np.float32)).astype(np.float64)
    found = irradiance.even()
    fair = _telling(facing, owner)
    weight = fair
    for _ in range(PASSES):
        shade = np.maximum(terms @ found, irradiance.LEAST)
        albedo = np.bincount(owner, weight * level * shade) / np.maximum(
            np.bincount(owner, weight * shade * shade), 1e-9
        )
        scaled = terms * albedo[owner][:, None]
        rows = scaled * weight[:, None]
        size = RIDGE * weight.sum() * level.mean() ** 2
        penalty = size * np.diag([0.0] + [1.0] * (irradiance.TERMS - 1))
        found = np.linalg.solve(
            rows.T @ scaled + penalty + 1e-9 * np.eye(irradiance.TERMS), rows.T @ level
        )
        off = np.abs(scaled @ found - level)
        weight = fair / np.maximum(off, max(float(np.median(off)), 1e-3))
        found = found / max(float((irradiance.basis(UP) @ found)[0]), irradiance.LEAST)
    lightness = _lightness(episode)
    least = 1.0 if lightness is None else _exposure(episode)
    found = found * max(_whitest(high / np.maximum(terms @ found, irradiance.LEAST), owner), least)
    return Ambience(tuple(round(float(term), 5) for term in found), _tint(episode), lightness)


def _whitest(albedo: Float64[np.ndarray, "n"], owner: Int[np.ndarray, "n"]) -> float:
    """The highest albedo on which nearly all of enough pixels of a thing's hue agree; 0 if none do.

    Where they do not agree, the light is not understood well enough there to tell an albedo by it.
    """
    found = 0.0
    for one in np.flatnonzero(np.bincount(owner) >= FEW):
        low, high = np.quantile(albedo[owner == one], NEARLY_ALL)
        if high < AGREE * low:
            found = max(found, float(low))
    return found


def _unseen(episode: Episode) -> Ambience:
    """Where no depth tells faces: light that falls from all sides alike, as bright as the recording's whites."""
    level = _exposure(episode)
    terms = tuple(round(level * float(term), 5) for term in irradiance.even())
    return Ambience(terms, _tint(episode), _lightness(episode))


def _exposure(episode: Episode) -> float:
    """How bright photographs show what is white: cameras are exposed for the whole of a picture."""
    whites = [
        np.quantile(rgb.reshape(-1, 3)[::STEP].min(1), ENDS[1]) / 255.0
        for name, _, rgb, _ in sampling.images(episode, FRAMES)
        if (proxy := episode.views[name].proxy) and not proxy.blank
    ]
    return min(max(float(np.median(whites)) / white.WHITEST, 0.3), 1.0) if whites else 1.0


def _tint(episode: Episode) -> tuple[float, float, float]:
    tint = light.estimate(episode) / light.LAMP
    red, green, blue = tint / tint.max() if np.ptp(tint) > CAST else np.ones(3)
    return round(float(red), 4), round(float(green), 4), round(float(blue), 4)


def _seen(
    episode: Episode,
) -> tuple[
    Float64[np.ndarray, "n 3"],
    Float64[np.ndarray, "n"],
    Float64[np.ndarray, "n"],
    Int[np.ndarray, "n"],
]:
    """World normals, mean and brightest channel, and a number for the hue of a thing, of pixels inside outlines."""
    normals, levels, highest, hues = [], [], [], []
    for name, t, rgb, ids in sampling.images(episode, FRAMES):
        view = episode.views[name]
        if view.depth is None:
            continue
        names = np.zeros(rgb.shape[:2], np.int32) if ids is None else ids
        around = np.ones((3, 3), np.uint8)
        high, low = (each(names.astype(np.float32), around) for each in (cv2.dilate, cv2.erode))
        brightest = np.maximum(np.maximum(rgb[..., 0], rgb[..., 1]), rgb[..., 2]) / 255.0
        use = (view.depth(t) > 0) & (high == low) & ~np.isin(names, light.unlit(episode))
        use &= (brightest > DARK) & (brightest < CLIPPED)
        rows = np.flatnonzero(use)
        rows = rows[:: max(1, len(rows) // light.PIXELS)]
        shown = rgb.reshape(-1, 3)[rows] / 255.0
        chroma = np.rint(shown[:, :2] / shown.sum(1, keepdims=True) / HUE).astype(int)
        normals.append(surface.of_view(view, t, (), ids)(rows).facing.astype(float))
        levels.append(shown.mean(1))
        highest.append(shown.max(1))
        hues.append((names.ravel()[rows] * HUES + chroma[:, 0]) * HUES + chroma[:, 1])
    if not normals or not sum(map(len, levels)):
        raise SourceLacks("light is told by surfaces, and this source has no depth to know them by")
    return (
        np.concatenate(normals),
        np.concatenate(levels),
        np.concatenate(highest),
        np.concatenate(hues),
    )


def _telling(
    facing: Float64[np.ndarray, "n 3"], owner: Int[np.ndarray, "n"]
) -> Float64[np.ndarray, "n"]:
    """Weights: a table must not outweigh all else, and what faces one way says nothing of the light elsewhere."""
    count = np.bincount(owner)
    middle = np.stack([np.bincount(owner, facing[:, k]) / count for k in range(3)], 1)
    varied = 1 - np.linalg.norm(middle, axis=1)
    return (np.maximum(varied, 1e-6) / np.sqrt(count))[owner]


def _lightness(episode: Episode) -> tuple[float, float] | None:
    """What photographs hold: haze and exposure leave no deeper black and no brighter white. Renderers show every color.

    How strong colors are tells nothing: among gray things an orange is still orange.
    """
    if not all(view.inferred for view in episode.views.values()):
        return None
    seen = np.concatenate(
        [
            color_space.to_lab(rgb.reshape(-1, 3)[::STEP] / 255.0)[:, 0]
            for _, _, rgb, _ in sampling.images(episode, FRAMES)
        ]
    )
    low, high = np.quantile(seen, ENDS)
    return round(float(low), 2), round(float(high), 2)
