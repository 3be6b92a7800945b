"""Distances between images, depth maps and masks, in float64, as published."""

from collections.abc import Iterable

import cv2
import numpy as np
from jaxtyping import Float64, Int32, UInt8

from rpaug.core import color_space

LEAST_ERROR = 1e-4  # squared grey levels: equal images score 88 dB, not infinity
FITTED_ERROR = 1e-6  # squared grey levels: fits are told apart up to 108 dB
LEAST_SHARE = 1e-12  # of full scale, squared: equal images score 120 dB
_WINDOW, _SIGMA = 11, 1.5  # pixels: Wang et al. 2004
_C1, _C2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2


def psnr(squared_error: float, least: float = LEAST_ERROR) -> float:
    """Decibels of a mean squared error in grey levels of 255; `least` stands for any smaller one."""
    return float(10 * np.log10(255**2 / max(squared_error, least)))


def decibels(squared_error: float, least: float = LEAST_SHARE) -> float:
    """Decibels of a mean squared error of colors in 0..1; `least` stands for any smaller one."""
    return -10 * float(np.log10(max(squared_error, least)))


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
    """CIEDE2000 between display colors of 0..255."""
    return color_space.ciede2000(
        color_space.to_lab(first / 255.0), color_space.to_lab(second / 255.0)
    )


def mean_iou(pairs: Iterable[tuple[Int32[np.ndarray, "h w"], Int32[np.ndarray, "h w"]]]) -> float:
    """Intersection over union of each instance id's pixels over all pairs of masks, averaged over the instance ids."""
    shared: dict[int, int] = {}
    either: dict[int, int] = {}
    for first, second in pairs:
        for instance_id in np.union1d(first, second).tolist():
            a, b = first == instance_id, second == instance_id
            shared[instance_id] = shared.get(instance_id, 0) + int((a & b).sum())
            either[instance_id] = either.get(instance_id, 0) + int((a | b).sum())
    return float(np.mean([shared[instance_id] / either[instance_id] for instance_id in either]))


def _blurred(image: Float64[np.ndarray, "h w 3"]) -> Float64[np.ndarray, "h w 3"]:
    return np.asarray(cv2.GaussianBlur(image, (_WINDOW, _WINDOW), _SIGMA), np.float64)
