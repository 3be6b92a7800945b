"""What a camera that stands still sees behind all that moves: the median over time, and where frames differ from it."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8

from rpaug.core import sampling
from rpaug.core.types import CameraView
from rpaug.scene.instances.color_clusters import weighted

FRAMES = 25  # that the median is taken over
DIFFERS = 6.0  # times the noise: what differs by more was covered or uncovered
LEAST = 9.0  # of the weighted Lab distance: compression alone differs by as much
RESTLESS = 0.4  # share of the image that changes in the typical frame of a camera that moves
DEAD = 2.0  # grey levels: an image that varies by less shows nothing


@dataclass(frozen=True)
class Backdrop:
    """`image` is the median over time; `noise` what a resting pixel differs from it by, in weighted Lab.

    `still` is unset for a camera that moves: there the median shows nothing. `dead` is set for images without content.
    """

    image: UInt8[np.ndarray, "h w 3"]
    noise: float
    still: bool
    dead: bool

    def changed(self, image: UInt8[np.ndarray, "h w 3"]) -> Bool[np.ndarray, "h w"]:
        """Where an image shows something else than the backdrop; lone pixels are noise."""
        off = distance(image, self.image)
        # Averaged over neighbours: noise is not shared by them, and things are larger than a pixel.
        near = cv2.blur(off, (3, 3), borderType=cv2.BORDER_REPLICATE)
        limit = max(DIFFERS * self.noise, LEAST)
        mask = ((off > limit) & (near > limit / 2)).astype(np.uint8)
        return cv2.medianBlur(mask, 3) > 0


def distance(
    one: UInt8[np.ndarray, "h w 3"], other: UInt8[np.ndarray, "h w 3"]
) -> Float32[np.ndarray, "h w"]:
    """How far apart the colors of two images are, pixel by pixel, in weighted Lab."""
    return np.linalg.norm(weighted(one) - weighted(other), axis=-1).astype(np.float32)


def find(view: CameraView, length: int) -> Backdrop:
    """The backdrop of one camera. A camera whose poses say that it moves is not still, whatever its images show."""
    images = np.stack([view.rgb(t) for t in sampling.frames(length, FRAMES)])
    middle = np.median(images, 0).astype(np.uint8)
    off = np.stack([distance(one, middle) for one in images])
    noise = float(1.4826 * np.median(off))
    made = Backdrop(middle, noise, view.camera.fixed, bool(images.std() < DEAD))
    share = np.median([made.changed(one).mean() for one in images])
    # Where most of it always differs, the median over pixels is no noise but motion.
    still = view.camera.fixed and share < RESTLESS and noise < LEAST
    return Backdrop(middle, min(noise, LEAST / 2), still, made.dead)
