"""Distances between images, depth maps and masks, in float64, as published."""

from collections.abc import Iterable

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float64, Int, Int32, UInt8

from rpaug import geometry
from rpaug.scene import colours
from rpaug.types import Camera

LEAST_ERROR = 1e-4  # squared grey levels: equal images score 88 dB, not infinity
_WINDOW, _SIGMA = 11, 1.5  # pixels: Wang et al. 2004
_C1, _C2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2


def psnr(squared_error: float) -> float:
    """Decibels of a mean squared error in grey levels of 255."""
    return float(10 * np.log10(255**2 / max(squared_error, LEAST_ERROR)))


def ssim(
    first: UInt8[np.ndarray, "h w 3"], second: UInt8[np.ndarray, "h w 3"]
) -> Float64[np.ndarray, "h w"]:
    """Structural similarity around each pixel, the mean of the channels (Wang et al. 2004; 11 x 11 Gaussian)."""
    a, b = first.astype(np.float64), second.astype(np.float64)
    mean_a, mean_b = _blurred(a), _blurred(b)
    variance_a = _blurred(a * a) - mean_a**2
    variance_b = _blurred(b * b) - mean_b**2
    shared = _blurred(a * b) - mean_a * mean_b
    near = (2 * mean_a * mean_b + _C1) * (2 * shared + _C2)
    return (near / ((mean_a**2 + mean_b**2 + _C1) * (variance_a + variance_b + _C2))).mean(-1)


def difference(
    first: UInt8[np.ndarray, "n 3"], second: UInt8[np.ndarray, "n 3"]
) -> Float64[np.ndarray, "n"]:
    """CIEDE2000 between display colours of 0..255."""
    return ciede2000(colours.to_lab(first / 255.0), colours.to_lab(second / 255.0))


def ciede2000(
    first: Float[np.ndarray, "*n 3"], second: Float[np.ndarray, "*n 3"]
) -> Float64[np.ndarray, "*n"]:
    """Colour difference of CIELAB colours, all weights 1 (CIE 142-2001, as Sharma, Wu and Dalal 2005 state it)."""
    (l1, a1, b1), (l2, a2, b2) = (np.moveaxis(np.asarray(c, float), -1, 0) for c in (first, second))
    chroma = (np.hypot(a1, b1) + np.hypot(a2, b2)) / 2
    stretch = 1.5 - 0.5 * np.sqrt(chroma**7 / (chroma**7 + 25.0**7))
    a1, a2 = a1 * stretch, a2 * stretch
    c1, c2 = np.hypot(a1, b1), np.hypot(a2, b2)
    h1, h2 = (np.degrees(np.arctan2(b, a)) % 360 for a, b in ((a1, b1), (a2, b2)))
    grey = c1 * c2 == 0
    turn = np.where(grey, 0, (h2 - h1 + 180) % 360 - 180)
    turn = np.where((turn == -180) & (h2 > h1), 180, turn)
    dl, dc = l2 - l1, c2 - c1
    dh = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(turn / 2))
    middle_l, middle_c = (l1 + l2) / 2, (c1 + c2) / 2
    far = np.abs(h1 - h2) > 180
    middle_h = (h1 + h2) / 2 + np.where(far, np.where(h1 + h2 < 360, 180, -180), 0)
    middle_h = np.where(grey, h1 + h2, middle_h)
    t = 1 + sum(
        weight * np.cos(np.radians(times * middle_h + off))
        for weight, times, off in ((-0.17, 1, -30), (0.24, 2, 0), (0.32, 3, 6), (-0.20, 4, -63))
    )
    sl = 1 + 0.015 * (middle_l - 50) ** 2 / np.sqrt(20 + (middle_l - 50) ** 2)
    sc, sh = 1 + 0.045 * middle_c, 1 + 0.015 * middle_c * t
    blue = 60 * np.exp(-(((middle_h - 275) / 25) ** 2))
    cross = -2 * np.sqrt(middle_c**7 / (middle_c**7 + 25.0**7)) * np.sin(np.radians(blue))
    light, saturation, hue = dl / sl, dc / sc, dh / sh
    return np.sqrt(light**2 + saturation**2 + hue**2 + cross * saturation * hue)


def mean_iou(pairs: Iterable[tuple[Int32[np.ndarray, "h w"], Int32[np.ndarray, "h w"]]]) -> float:
    """Intersection over union of each handle's pixels over all pairs of masks, averaged over the handles."""
    shared: dict[int, int] = {}
    either: dict[int, int] = {}
    for first, second in pairs:
        for handle in np.union1d(first, second).tolist():
            a, b = first == handle, second == handle
            shared[handle] = shared.get(handle, 0) + int((a & b).sum())
            either[handle] = either.get(handle, 0) + int((a | b).sum())
    return float(np.mean([shared[handle] / either[handle] for handle in either]))


def reprojection(
    depths: tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]],
    ids: tuple[Int[np.ndarray, "h w"], Int[np.ndarray, "h w"]],
    cameras: tuple[Camera, Camera],
    t: int,
    hidden: float = 0.02,
) -> Float64[np.ndarray, "n"]:
    """Metres between the first camera's points and the surface the second saw there, on handles both name.

    Points that lie `hidden` metres or more behind that surface are taken for unseen by the second. The inverse of depth
    is interpolated, which is exact on planes, and only between four pixels of one handle.
    """
    points = geometry.world_points(depths[0], cameras[0], t)
    at, z = geometry.project(points, cameras[1], t)
    corner = np.floor(np.nan_to_num(at, nan=-1.0, posinf=-1.0, neginf=-1.0)).astype(np.int64)
    limit = np.array([cameras[1].width, cameras[1].height]) - 1
    inside = ((corner >= 0) & (corner < limit)).all(-1) & (z > 0) & (depths[0] > 0)
    (column, row), (x, y) = corner[inside].T, (at - corner)[inside].T
    inverse, same = np.zeros(len(x)), np.ones(len(x), bool)
    for down in (0, 1):
        for right in (0, 1):
            place = row + down, column + right
            weight = (y if down else 1 - y) * (x if right else 1 - x)
            inverse += weight / np.maximum(depths[1][place], 1e-6)
            same &= (ids[1][place] == ids[0][inside]) & (depths[1][place] > 0)
    apart = np.abs(1 / inverse - z[inside])
    return apart[same & (apart < hidden)]


def grown(mask: Bool[np.ndarray, "h w"], pixels: int) -> Bool[np.ndarray, "h w"]:
    """The mask with an outline wider by that many pixels, corners included."""
    if pixels == 0:
        return mask
    square = np.ones((2 * pixels + 1, 2 * pixels + 1), np.uint8)
    return cv2.dilate(mask.astype(np.uint8), square).astype(bool)


def _blurred(image: Float64[np.ndarray, "h w 3"]) -> Float64[np.ndarray, "h w 3"]:
    return np.asarray(cv2.GaussianBlur(image, (_WINDOW, _WINDOW), _SIGMA), np.float64)
