"""Depth as published networks give it, made from the truth: bent, smooth at edges, of a scale that drifts.

A quality is named by its mean absolute relative error after the one factor that suits an image best. Most of that error
is the same in all frames of a camera that stands still, as a network sees the same image; the rest is new in each.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from rpaug.core.types import CameraView, Episode

RELATIVE_ERROR: Mapping[str, float] = {"perfect": 0.0, "high": 0.03, "middle": 0.05, "low": 0.10}
LASTING = 0.8  # of the error's variance, the same in all frames
BUMPS = 0.12  # of the image's width: deviation of the Gaussian that the error is smooth by
EDGES = 0.008  # of the image's width: the same for what blurs an edge
DRIFT = 0.5  # of the error: the deviation of a frame's scale
OFF = 0.1  # deviation of the scale of all frames


@dataclass(frozen=True)
class _Known:
    """Colors and true depths of one camera, and the errors that last and that each frame has."""

    shown: UInt8[np.ndarray, "t h w 3"]
    depth: Float32[np.ndarray, "t h w"]
    lasting: Float[np.ndarray, "h w"]
    scales: Float[np.ndarray, "t"]


class ScriptedDepth:
    """A model of depth for the images of one episode; `truth` is the same episode with depth.

    An image that is none of its frames, as a median over time, has the depth of whatever frame looks like it, pixel by
    pixel.
    """

    relative = False

    def __init__(self, episode: Episode, truth: Episode, quality: str, seed: int) -> None:
        self._error, self._seed = RELATIVE_ERROR[quality], seed
        self._known = [
            self._camera(view, truth.views[name], episode.length, number)
            for number, (name, view) in enumerate(episode.views.items())
        ]

    def _camera(self, view: CameraView, true: CameraView, length: int, number: int) -> _Known:
        assert true.depth is not None
        rng = np.random.default_rng([self._seed, 25, number])
        depth = np.stack([true.depth(t) for t in range(length)])
        scales = np.cumsum(rng.normal(size=length)) / np.sqrt(length)
        scales = np.exp(OFF * (self._error > 0) * rng.normal() + DRIFT * self._error * scales)
        lasting = field(depth.shape[1:], rng)
        return _Known(
            np.stack([view.rgb(t) for t in range(length)]),
            depth.astype(np.float32),
            lasting,
            scales,
        )

    def __call__(
        self, image: UInt8[np.ndarray, "h w 3"], known: Float32[np.ndarray, "h w"] | None = None
    ) -> Float32[np.ndarray, "h w"]:
        off = [
            np.abs(one.shown.astype(np.int16) - image).sum(-1)
            if one.shown[0].shape == image.shape
            else None
            for one in self._known
        ]
        totals = [np.inf if o is None else float(np.median(o, axis=(1, 2)).min()) for o in off]
        best = int(np.argmin(totals))
        here, unlike = self._known[best], off[best]
        assert unlike is not None
        t = int(unlike.mean((1, 2)).argmin())
        if unlike[t].any():
            nearest = cv2.blur(unlike.transpose(1, 2, 0).astype(np.float32), (3, 3)).argmin(-1)
            true = np.take_along_axis(here.depth, nearest[None], 0)[0]
        else:
            true = here.depth[t]
        return self._spoilt(true, here, best, t)

    def _spoilt(
        self, true: Float32[np.ndarray, "h w"], here: _Known, number: int, t: int
    ) -> Float32[np.ndarray, "h w"]:
        if not self._error:
            return true
        inverse = 1 / np.maximum(true, 1e-3)
        inverse = cv2.GaussianBlur(inverse, (0, 0), max(0.5, EDGES * true.shape[1]))
        fresh = field(true.shape, np.random.default_rng([self._seed, 26, number, t]))
        bent = np.sqrt(LASTING) * here.lasting + np.sqrt(1 - LASTING) * fresh
        # The mean of what is normally distributed is 0.8 of its deviation.
        factor = here.scales[t] * np.exp(self._error / 0.8 * bent)
        return (factor / inverse).astype(np.float32)


def field(shape: tuple[int, ...], rng: np.random.Generator) -> Float[np.ndarray, "h w"]:
    """Smooth bumps of mean 0 and deviation 1 over an image."""
    smooth = cv2.GaussianBlur(
        rng.normal(size=shape), (0, 0), BUMPS * shape[1], borderType=cv2.BORDER_REFLECT
    )
    return (smooth - smooth.mean()) / max(float(smooth.std()), 1e-9)
