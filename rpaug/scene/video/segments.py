"""Segments of an image: parts of even colour, whatever the exposure, cut where colours change."""

import cv2
import numpy as np
from jaxtyping import Int32, UInt8

SCALE, LEAST = (
    150.0,
    2.3e-4,
)  # larger segments for larger values; share of the image of the smallest
BLUR = 0.6  # pixels
TINT, LIGHT = 1.6, 0.6  # of chroma and lightness: shade divides a thing less than another colour


def segments(rgb: UInt8[np.ndarray, "h w 3"]) -> Int32[np.ndarray, "h w"]:
    """Segments by minimum spanning forests (Felzenszwalb and Huttenlocher 2004) in CIELAB, numbered from 0."""
    lab = cv2.cvtColor(cv2.bilateralFilter(rgb, 5, 25, 5), cv2.COLOR_RGB2LAB).astype(np.float32)
    weighed = np.stack(
        [LIGHT * lab[..., 0], *(128 + TINT * (lab[..., k] - 128) for k in (1, 2))], -1
    )
    least = max(2, round(LEAST * rgb.shape[0] * rgb.shape[1]))
    made = cv2.ximgproc.segmentation.createGraphSegmentation(BLUR, SCALE, least)
    found = made.processImage(np.clip(np.rint(weighed), 0, 255).astype(np.uint8))
    return np.asarray(found, np.int32)
