"""How sharp and how grainy a photograph is, so that what is drawn into it is as sharp and as grainy.

Grain is not drawn anew: what a pixel differs by from what it shows all the time is its noise at that time, with all
that JPEG or a video's codec made of it, and goes onto whatever is drawn there. Blur is told by the sharpest edges.
"""

from dataclasses import dataclass
from statistics import NormalDist

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8

from rpaug.core.memo import of_episode
from rpaug.core.types import Episode
from rpaug.scene.instances import backdrop
from rpaug.scene.instances.backdrop import Backdrop

Image = UInt8[np.ndarray, "h w 3"]
CONTRAST = 40.0  # grey levels between both sides of what counts as an edge
AROUND = 7  # pixels a side in which both sides of an edge are looked for
SHARPEST = 0.8  # quantile of how steep edges are
FEWEST = 50  # pixels of edges that tell anything
MOST = 3.0  # pixels: a wider blur is told by no neighbourhood of that size


@dataclass(frozen=True)
class Grain:
    """Of one still camera: what it shows all the time, and the deviation of its blur in pixels."""

    resting: Backdrop
    blur: float

    def noise(self, recorded: Image) -> Float32[np.ndarray, "h w 3"]:
        """What a frame's pixels differ by from what they show all the time; 0 where something moves."""
        off = recorded.astype(np.float32) - self.resting.image
        return np.where(self.resting.changed(recorded)[..., None], np.float32(0), off)

    def onto(
        self, recorded: Image, before: Image, drawn: Image, painted: Bool[np.ndarray, "h w"]
    ) -> Image:
        """What was drawn over a picture, as sharp and grainy as the recorded frame; what was `painted` has no grain
        either. Other pixels stay bit for bit."""
        over = (drawn != before).any(-1)
        if not (over | painted).any():
            return drawn
        front, share = _softened(drawn, over, self.blur)
        noisy = np.maximum(share, painted)[..., None]
        out = (1 - share[..., None]) * before + front + noisy * self.noise(recorded)
        made = np.clip(np.rint(out), 0, 255).astype(np.uint8)
        return np.where(noisy > 0.5 / 255, made, before)


@dataclass(frozen=True)
class FrameBlur:
    """Of a camera that moves: each frame is as blurred as its own sharpest edges. Nothing tells its noise, or how far
    motion drew out the others."""

    def onto(
        self, recorded: Image, before: Image, drawn: Image, painted: Bool[np.ndarray, "h w"]
    ) -> Image:
        """What was drawn over a picture, as sharp as the recorded frame. Other pixels stay bit for bit."""
        over = (drawn != before).any(-1)
        if not over.any():
            return drawn
        front, share = _softened(drawn, over, blur(recorded))
        made = np.rint((1 - share[..., None]) * before + front).astype(np.uint8)
        return np.where(share[..., None] > 0.5 / 255, made, before)


def _softened(
    drawn: Image, over: Bool[np.ndarray, "h w"], blur: float
) -> tuple[Float32[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"]]:
    """What is drawn over a picture and the share of each pixel that it covers, both blurred."""
    share = over.astype(np.float32)
    front = share[..., None] * drawn
    if blur <= 0:
        return front, share
    return cv2.GaussianBlur(front, (0, 0), blur), cv2.GaussianBlur(share, (0, 0), blur)


@of_episode
def of(episode: Episode, name: str) -> Grain | None:
    """The grain of a camera that stands still and took photographs; None where masks or depth were recorded."""
    view = episode.views[name]
    if not view.inferred or view.proxy is None or view.proxy.blank:
        return None
    resting = backdrop.find(view, episode.length)
    return Grain(resting, blur(resting.image)) if resting.still and not resting.dead else None


def blur(image: Image) -> float:
    """The deviation of a picture's blur by its sharpest edges, pixels; 0 where it has too few."""
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
    around = np.ones((AROUND, AROUND), np.uint8)
    contrast = cv2.dilate(gray, around) - cv2.erode(gray, around)
    kernel = np.array([[-1, 0, 1]], np.float32)
    steep = np.maximum(*(np.abs(cv2.filter2D(gray, -1, k)) for k in (kernel, kernel.T)))
    highest = steep >= cv2.dilate(steep, np.ones((3, 3), np.uint8))
    edge = (contrast > CONTRAST) & highest
    if edge.sum() < FEWEST:
        return 0.0
    # A step of height 1, blurred, rises by 2 Phi(1 / deviation) - 1 over two pixels.
    rise = float(np.quantile(steep[edge] / contrast[edge], SHARPEST))
    if rise >= 0.999:
        return 0.0
    return min(1 / max(NormalDist().inv_cdf((1 + rise) / 2), 1 / MOST), MOST)
