"""Outlines that models gave, moved to where the image's colors change.

A segmenter's outline is off by a pixel or two. The colors well inside and well outside of it are carried into the band
along it; a pixel of the band belongs to whose color it has, as far as the two differ by more than either varies by
itself, and to whom the outline gives it where they do not.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8

BAND = 0.008  # of the image's width: so far may an outline be off; two pixels at least
REACHES = (
    0.5,
    1.0,
    2.0,
)  # of the band: deviations by which colors are carried on, the nearest that tell anything
TELLS = 0.02  # weight of known pixels around one that tells a color
NOISE = 0.04  # color by which pixels of one surface differ
DOUBT = 0.25  # of a pixel: how far its share may well be from what the outline suggests
FEWEST = 12  # pixels well inside: of a smaller thing no colors are learned
LESS, MORE = 0.7, 1.4  # times its pixels that a thing may come to, or it is left as it was

Image = UInt8[np.ndarray, "h w 3"]
Mask = Bool[np.ndarray, "h w"]
Colors = Float32[np.ndarray, "h w 3"]
Weights = Float32[np.ndarray, "h w"]


def onto_edges(image: Image, mask: Mask) -> Mask:
    """The mask, ended where the image's colors change near its outline."""
    if mask.sum() < FEWEST:
        return mask
    band = max(2, round(BAND * mask.shape[1]))
    at = _window(mask, 4 * band)
    color, given = image[at].astype(np.float32) / 255, mask[at]
    core, beyond = _eroded(given, band), _eroded(~given, band)
    if core.sum() < FEWEST or beyond.sum() < FEWEST:
        return mask
    found = core | (~beyond & (_share(color, given, core, beyond, band) > 0.5))
    if not LESS * mask.sum() < found.sum() < MORE * mask.sum():
        return mask
    out = np.zeros_like(mask)
    out[at] = found
    return out


def _share(color: Colors, mask: Mask, core: Mask, beyond: Mask, band: int) -> Weights:
    """How much of each pixel is the thing's, by its color between those carried on from both sides."""
    front, varied = _carried(color, core, band)
    back, varies = _carried(color, beyond, band)
    apart = front - back
    prior = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), band / 2)
    doubt = (NOISE**2 + varied + varies) / DOUBT**2
    along = ((color - back) * apart).sum(-1)
    return (along + doubt * prior) / ((apart**2).sum(-1) + doubt)


def _carried(color: Colors, known: Mask, band: int) -> tuple[Colors, Weights]:
    """The known colors, carried on to where none are known, and their variance there."""
    weight = known.astype(np.float32)
    moments = np.concatenate([color, color**2], -1) * weight[..., None]
    out = np.zeros_like(moments)
    told = np.zeros(known.shape, bool)
    for reach in REACHES:
        total = cv2.GaussianBlur(weight, (0, 0), reach * band)
        blurred = [
            cv2.GaussianBlur(one, (0, 0), reach * band)
            for one in (moments[..., :3], moments[..., 3:])
        ]
        mean = np.concatenate(blurred, -1) / np.maximum(total, 1e-6)[..., None]
        out = np.where(told[..., None], out, mean)
        told |= total > TELLS
    middle, squares = out[..., :3], out[..., 3:]
    return middle, np.maximum(squares - middle**2, 0).mean(-1)


def _eroded(mask: Mask, by: int) -> Mask:
    """The mask without what lies so near to its outline; the image's edge is no outline."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * by + 1,) * 2)
    return cv2.erode(mask.astype(np.uint8), disc) > 0


def _window(mask: Mask, margin: int) -> tuple[slice, slice]:
    rows, columns = np.nonzero(mask)
    (top, bottom), (left, right) = ((int(one.min()), int(one.max())) for one in (rows, columns))
    return (
        slice(max(0, top - margin), bottom + margin + 1),
        slice(max(0, left - margin), right + margin + 1),
    )
