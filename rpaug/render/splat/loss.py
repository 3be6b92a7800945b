"""How far an image is from its target: squared, absolute and structural error, and that of depth."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from rpaug.render.splat import _images, _ssim
from rpaug.render.splat._threads import together


@dataclass(frozen=True)
class Loss:
    """What a fit lowers: l2 * mean squared error + l1 * mean absolute error + ssim * (1 - mean SSIM)
    + depth * mean squared relative depth error.

    Colors are in 0..1. SSIM is Wang et al.'s (2004; 11 x 11 Gaussian, zeros beyond the image); 3DGS's loss is
    (l2=0, l1=0.8, ssim=0.2). Depth is compared where it is given and at least half of the pixel is covered.
    """

    l2: float = 1.0
    l1: float = 0.0
    ssim: float = 0.0
    depth: float = 0.0

    def __post_init__(self) -> None:
        weights = vars(self)
        if min(weights.values()) < 0 or not any(weights.values()):
            raise ValueError(f"loss weights are {weights}; expected none below 0, one above")


@dataclass(frozen=True)
class Errors:
    """Means over an image's pixels; `ssim` is 1 - mean SSIM, 0 where the loss does not ask for it."""

    l2: float
    l1: float
    ssim: float
    depth: float

    def total(self, loss: Loss) -> float:
        """The number whose gradient a backward pass carries."""
        return sum(getattr(loss, name) * error for name, error in vars(self).items())


def pull(
    loss: Loss,
    out: Float32[np.ndarray, "h w c"],
    left_over: Float32[np.ndarray, "h w"],
    background: Float32[np.ndarray, "3"],
    target: Float32[np.ndarray, "h w 3"],
    weight: Float32[np.ndarray, "h w"],
    depth: Float32[np.ndarray, "h w"],
    d_out: Float32[np.ndarray, "h w c"],
    d_left_over: Float32[np.ndarray, "h w"],
    threads: int,
) -> Errors:
    """Errors of a composited image; the loss's gradient by the channels goes to the last two arrays.

    `weight` and `depth` may have no rows: weight 1 everywhere, no depth.
    """
    structure, shortfall = np.zeros((0, 0, 0), np.float32), np.zeros(3)
    if loss.ssim > 0:
        structure = np.empty(target.shape, np.float32)
        workers = min(threads, 3)
        given = (
            workers,
            out,
            left_over,
            background,
            target,
            weight,
            loss.ssim,
            structure,
            shortfall,
        )
        together(_ssim.structural_error, [(k, *given) for k in range(workers)])
    l2, l1, by_depth = _images.pixel_errors(
        out, left_over, background, target, weight, depth, float(loss.l2), float(loss.l1),
        float(loss.depth), structure, d_out, d_left_over,
    )  # fmt: skip
    return Errors(l2, l1, float(shortfall.sum()), by_depth)
