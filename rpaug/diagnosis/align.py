"""Where a camera stands against the recordings, told by the robot, which waits in the same pose in all first frames.

Table, walls and things may all look different; the robot is what stays. Its mean picture is searched for in the
image by normalised correlation, which no change of light's strength matters to.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, UInt8

from rpaug.diagnosis.reference import ReferenceCamera

SIDE = 128  # pixels: larger images are searched at this width
REACH = 0.22  # of the image's width: how far the robot is looked for
TURNS = (-0.07, -0.035, 0.0, 0.035, 0.07)  # radians
SCALES = (0.9, 0.95, 1.0, 1.05, 1.1)
LIKE = 0.55  # correlation below which the robot was not found
FEW = 60  # pixels of robot that are too few to tell by


@dataclass(frozen=True)
class Aligned:
    """The image as the recordings' camera would see it, roughly. `valid` are pixels it covers.

    `shift` is by how much the picture moved, right and down as shares of the width, `scale` and `turn` (radians) by how
    much it grew and turned.
    """

    image: Float32[np.ndarray, "h w 3"]
    valid: Bool[np.ndarray, "h w"]
    shift: tuple[float, float]
    scale: float
    turn: float
    matrix: Float64[np.ndarray, "2 3"]

    def warp(self, ids: np.ndarray) -> np.ndarray:
        """Ids of a mask, moved like the image."""
        h, w = self.valid.shape
        flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        return cv2.warpAffine(ids.astype(np.float32), self.matrix, (w, h), flags=flags).astype(int)


def align(image: UInt8[np.ndarray, "h w 3"], plate: ReferenceCamera) -> Aligned | None:
    """How the image lies against the recordings' camera; None where no robot is found."""
    h, w = plate.mean.shape[:2]
    if image.shape[:2] != (h, w):
        image = cv2.resize(image, (w, h), interpolation=cv2.INTER_AREA)
    robot = plate.robot
    if robot.sum() < FEW:
        return None
    factor = min(1.0, SIDE / w)
    size = (round(w * factor), round(h * factor))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    usual = cv2.resize(plate.mean, size, interpolation=cv2.INTER_AREA)
    mask = cv2.resize(robot.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.99
    best: tuple[float, np.ndarray, float, float] = (LIKE, np.eye(2, 3), 1.0, 0.0)
    found = False
    for turn in TURNS:
        for scale in SCALES:
            score, matrix = _searched(small, usual, mask, scale, turn)
            if score > best[0]:
                best, found = (score, matrix, scale, turn), True
    if not found:
        return None
    _, matrix, scale, turn = best
    matrix = matrix.copy()
    matrix[:, 2] /= factor
    middle = np.array([(w - 1) / 2, (h - 1) / 2])
    moved = (matrix[:, :2] @ middle + matrix[:, 2] - middle) / w
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    warped = cv2.warpAffine(
        image.astype(np.float32), matrix, (w, h), flags=flags, borderValue=(-1e4,) * 3
    )
    valid = warped.min(2) >= 0
    shift = (float(moved[0]), float(moved[1]))
    return Aligned(np.maximum(warped, 0), valid, shift, scale, turn, matrix)


def _searched(
    image: Float32[np.ndarray, "h w 3"],
    usual: Float32[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
    scale: float,
    turn: float,
) -> tuple[float, Float64[np.ndarray, "2 3"]]:
    """The best correlation for one size and turn, and the matrix that takes usual pixels to the image's."""
    h, w = mask.shape
    matrix = cv2.getRotationMatrix2D(((w - 1) / 2, (h - 1) / 2), np.rad2deg(turn), scale)
    shape = cv2.warpAffine(mask.astype(np.uint8), matrix, (w, h), flags=cv2.INTER_NEAREST)
    down, right = np.flatnonzero(shape.any(1)), np.flatnonzero(shape.any(0))
    if shape.sum() < FEW:
        return -1.0, matrix
    top, left, bottom, end = down[0], right[0], down[-1] + 1, right[-1] + 1
    turned = cv2.warpAffine(usual, matrix, (w, h), flags=cv2.INTER_LINEAR)
    reach = int(np.ceil(REACH * w))
    padded = cv2.copyMakeBorder(image, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    window = padded[top : bottom + 2 * reach, left : end + 2 * reach]
    scores = _correlated(window, turned[top:bottom, left:end], shape[top:bottom, left:end] > 0)
    y, x = np.unravel_index(int(scores.argmax()), scores.shape)
    out = matrix.copy()
    out[:, 2] += (int(x) - reach, int(y) - reach)
    return float(scores[y, x]), out


def _correlated(
    image: Float32[np.ndarray, "h w 3"],
    usual: Float32[np.ndarray, "a b 3"],
    mask: Bool[np.ndarray, "a b"],
) -> Float32[np.ndarray, "y x"]:
    """Zero-mean normalised correlation of the masked pixels at every place, the mean over channels."""
    weight = mask.astype(np.float32)
    count = weight.sum()
    total = np.zeros(
        (image.shape[0] - usual.shape[0] + 1, image.shape[1] - usual.shape[1] + 1), np.float32
    )
    for c in range(3):
        one = np.ascontiguousarray(image[..., c]) / 255
        zero = ((usual[..., c] - usual[..., c][mask].mean()) * weight / 255).astype(np.float32)
        cross = cv2.matchTemplate(one, zero, cv2.TM_CCORR)
        sums = cv2.matchTemplate(one, weight, cv2.TM_CCORR)
        squares = cv2.matchTemplate(one * one, weight, cv2.TM_CCORR)
        spread = np.sqrt(np.maximum(squares - sums * sums / count, 1e-6 * count))
        total += cross / (spread * np.sqrt((zero * zero).sum() + 1e-12))
    return total / 3
