"""The few colors that an episode's images are made of, and which of them each pixel shows.

Lightness counts less than hue and chroma, so that a thing and its own shade are one tint. All cameras share the tints:
a thing has the same one wherever it is seen.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int, UInt8

LIGHTNESS = 0.45  # weight of lightness beside the two chroma axes (CIELAB)
MOST = 14  # tints looked for
APART = 11.0  # of the weighted Lab distance: nearer tints are one
LOUD = 25.0  # of the weighted Lab distance from every tint from which a color has none yet
RARE = 0.0008  # share of the pixels that such colors must have
RARER = 3  # further tints, at most, that they get
SAMPLES = 20_000  # pixels that tints are found from
TOGETHER = 60.0  # squared distance that a pixel gives up to be of its neighbours' tint
CHROMATIC = 15.0  # chroma below which a tint has no shades: greys differ in lightness alone
ASIDE = np.deg2rad(13.0)  # by which a shade lies off the line to black, seen from there
SHADES = 1.4  # times darker that a shade is, at most
ROUNDS = 3  # in which neighbours vote
WIDE = 480  # pixels: larger images are labelled at about this size

ColorClusters = Float32[np.ndarray, "k 3"]


def weighted(image: UInt8[np.ndarray, "*n 3"]) -> Float32[np.ndarray, "*n 3"]:
    """Colors in the space in which tints are told apart: CIELAB with less lightness."""
    flat = np.asarray(image, np.uint8).reshape(1, -1, 3).astype(np.float32) / np.float32(255)
    lab = cv2.cvtColor(flat, cv2.COLOR_RGB2Lab).reshape(image.shape)
    return lab * np.array([LIGHTNESS, 1, 1], np.float32)


def find(images: Sequence[UInt8[np.ndarray, "h w 3"]]) -> ColorClusters:
    """Middles of the tints of some images: k-means (Lloyd 1982), then the nearest pairs merged until all are apart.

    Means settle where pixels are many; what is far from all of them, a small thing of a loud color, gets its own.
    """
    pixels = np.concatenate([weighted(cv2.medianBlur(one, 3)).reshape(-1, 3) for one in images])
    pixels = np.ascontiguousarray(pixels[:: max(1, len(pixels) // SAMPLES)])
    found = _merged(*_means(pixels, MOST))
    off = np.min([np.linalg.norm(pixels - cluster, axis=1) for cluster in found], axis=0)
    rare = pixels[off > LOUD]
    if len(rare) < RARE * len(pixels):
        return found
    middles, counts = _means(rare, RARER)
    return np.concatenate([found, _merged(middles, counts)])


def _means(
    pixels: Float32[np.ndarray, "n 3"], most: int
) -> tuple[Float32[np.ndarray, "k 3"], Float32[np.ndarray, "k"]]:
    """Middles of at most so many clusters, and their pixels' numbers."""
    cv2.setRNGSeed(0)  # the first middles are drawn from OpenCV's global generator
    most = min(most, len(np.unique(pixels, axis=0)))
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.1)
    _, owner, found = cv2.kmeans(pixels, most, np.empty(0), stop, 3, cv2.KMEANS_PP_CENTERS)
    return found, np.bincount(owner[:, 0], minlength=most).astype(np.float32)


def _merged(found: Float32[np.ndarray, "k 3"], weights: Float32[np.ndarray, "k"]) -> ColorClusters:
    """The same with the nearest merged until all are apart."""
    middles, counts = list(found), list(weights)
    while len(middles) > 1:
        table = np.array(middles)
        apart = np.linalg.norm(table[:, None] - table[None], axis=-1)
        np.fill_diagonal(apart, np.inf)
        i, j = np.unravel_index(apart.argmin(), apart.shape)
        if apart[i, j] > APART:
            break
        total = counts[i] + counts[j]
        middles[i] = (middles[i] * counts[i] + middles[j] * counts[j]) / max(total, 1.0)
        counts[i] = total
        del middles[j], counts[j]
    return np.array(middles, np.float32)


def shaded(
    one: Float32[np.ndarray, "*n 3"], other: Float32[np.ndarray, "*n 3"], darker: float = SHADES
) -> Bool[np.ndarray, "*n"]:
    """Are two colors one in more and in less light? A matte surface in shade moves on a line towards black.

    Neither is more than `darker` times farther from black. Greys have no shades: they differ in lightness alone.
    """
    far, known = np.linalg.norm(one, axis=-1), np.linalg.norm(other, axis=-1)
    along = (one * other).sum(-1) >= np.cos(ASIDE) * far * known
    near = np.maximum(far, known) < darker * np.maximum(np.minimum(far, known), 1e-6)
    chroma = [np.linalg.norm(color[..., 1:], axis=-1) for color in (one, other)]
    return np.asarray(along & near & (np.minimum(*chroma) > CHROMATIC))


def labelled(image: UInt8[np.ndarray, "h w 3"], clusters: ColorClusters) -> Int[np.ndarray, "h w"]:
    """Which tint each pixel shows: the nearest, unless its neighbours have another that is about as near (Potts)."""
    height, width = image.shape[:2]
    small = image
    if width > WIDE:
        size = (WIDE, max(1, round(height * WIDE / width)))
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    shown = weighted(small)
    off = np.stack([((shown - cluster) ** 2).sum(-1) for cluster in clusters], -1)
    label = off.argmin(-1)
    for _ in range(ROUNDS):
        votes = (label[..., None] == np.arange(len(clusters))).astype(np.float32)
        # One channel at a time: OpenCV's filters take no more than a few.
        votes = np.stack(
            [
                cv2.blur(votes[..., k], (3, 3), borderType=cv2.BORDER_REPLICATE)
                for k in range(len(clusters))
            ],
            -1,
        )
        label = (off - TOGETHER * votes).argmin(-1)
    if small is not image:
        large = cv2.resize(label.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
        return large.astype(np.int64)
    return label
