"""The light a new thing has to be shown in: how bright faces are by where they turn, and of which colour."""

import numpy as np

from rpaug.scene import colours, irradiance, light, sampling
from rpaug.scene.remembered import once
from rpaug.types import Ambience, Episode

FRAMES = 8
PASSES = 8  # of the alternation between albedos and light, both robust
RIDGE = 0.003  # of the light's terms but the even one, where few faces tell them
ENDS = (
    0.01,
    0.995,
)  # quantiles of lightness and chroma that count as a recording's darkest and strongest
CAST = 0.12  # difference between channels below which light counts as white: walls are as yellow as that
UP = np.array([[0.0, 0.0, 1.0]], np.float32)
STEP = 7  # pixels, of which one is looked at for its colour


@once
def estimate(episode: Episode) -> Ambience:
    """The irradiance that explains best how each thing's brightness depends on where its faces turn, 1 on level ones.

    Every thing has one albedo, fitted along; pixels that the fit leaves far off count less. Raises Unsupported without
    depth.
    """
    facing, level, things = light.seen(episode, FRAMES)
    _, owner = np.unique(things, return_inverse=True)
    terms = irradiance.basis(facing.astype(np.float32)).astype(np.float64)
    found = irradiance.even()
    fair = 1 / np.sqrt(np.bincount(owner))[owner]  # a table's one face must not outweigh all others
    weight = fair
    for _ in range(PASSES):
        shade = np.maximum(terms @ found, irradiance.LEAST)
        albedo = np.bincount(owner, weight * level * shade) / np.maximum(
            np.bincount(owner, weight * shade * shade), 1e-9
        )
        scaled = terms * albedo[owner][:, None]
        rows = scaled * weight[:, None]
        penalty = (
            RIDGE * len(level) * np.diag([0.0] + [1.0] * (irradiance.TERMS - 1)) * level.mean() ** 2
        )
        found = np.linalg.solve(
            rows.T @ scaled + penalty + 1e-9 * np.eye(irradiance.TERMS), rows.T @ level
        )
        off = np.abs(scaled @ found - level)
        weight = fair / np.maximum(off, max(float(np.median(off)), 1e-3))
        found = found / max(float((irradiance.basis(UP) @ found)[0]), irradiance.LEAST)
    tint = light.estimate(episode) / light.LAMP
    red, green, blue = tint / tint.max() if np.ptp(tint) > CAST else np.ones(3)
    return Ambience(
        tuple(round(float(term), 5) for term in found),
        (round(float(red), 4), round(float(green), 4), round(float(blue), 4)),
        _gamut(episode),
    )


def _gamut(episode: Episode) -> tuple[float, float, float]:
    lab = np.concatenate(
        [
            colours.to_lab(rgb.reshape(-1, 3)[::STEP] / 255.0)
            for _, _, rgb, _ in sampling.images(episode, FRAMES)
        ]
    )
    low, high = np.quantile(lab[:, 0], ENDS)
    chroma = np.quantile(np.hypot(lab[:, 1], lab[:, 2]), ENDS[1])
    return round(float(low), 2), round(float(high), 2), round(float(chroma), 2)
