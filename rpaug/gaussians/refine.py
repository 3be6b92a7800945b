"""Poses that give way during a fit: bodies and moving cameras settle where the images agree best.

A correction is a twist (turn, shift) in world axes about the middle of what moves. Only frames that are
fitted have one of their own; in between it is interpolated. None goes further than what is known to be off: colors of
one frame ask for more than is true, and what they are given there is wrong in between.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int

from rpaug.core import geometry
from rpaug.gaussians import carrying
from rpaug.render.splat import Gradients, Splats

BODY_STEP = 3e-4  # metres a correction may move in one step, about
CAMERA_STEP = 1.2e-3  # the same for a camera, whose frames are seen by itself only
DECAY = 0.02  # share of a correction forgotten in one step: what no image asks for stays small
FADE, SPREAD = 0.8, 0.95  # Adam's memory: each frame is seen seldom


@dataclass(frozen=True)
class Twists:
    """Corrections of one rigid thing: one row for each fitted frame."""

    times: Int[np.ndarray, "k"]
    values: Float64[np.ndarray, "k 6"]
    first: Float64[np.ndarray, "k 6"]
    second: Float64[np.ndarray, "k 6"]
    counts: Int[np.ndarray, "k"]
    radius: float  # metres: how far its points are from its middle
    pace: float  # metres a step
    most: float  # metres that a correction may come to

    @staticmethod
    def of(
        times: Sequence[int], radius: float, pace: float = BODY_STEP, most: float = np.inf
    ) -> "Twists":
        """No correction yet."""
        k = len(times)
        return Twists(
            np.array(times),
            np.zeros((k, 6)),
            np.zeros((k, 6)),
            np.zeros((k, 6)),
            np.zeros(k, int),
            radius,
            pace,
            most,
        )

    def step(self, t: int, gradient: Float64[np.ndarray, "6"], factor: float) -> None:
        """One step of Adam on the correction of frame t; changes this object."""
        k = int(np.searchsorted(self.times, t))
        if not gradient.any() or not np.isfinite(gradient).all():
            return
        # Turns are measured by how far they move the outermost points.
        slope = gradient / np.repeat([self.radius, 1.0], 3)
        self.counts[k] += 1
        self.first[k] = FADE * self.first[k] + (1 - FADE) * slope
        self.second[k] = SPREAD * self.second[k] + (1 - SPREAD) * slope**2
        mean = self.first[k] / (1 - FADE ** self.counts[k])
        size = np.sqrt(self.second[k] / (1 - SPREAD ** self.counts[k])) + 1e-15
        self.values[k] *= 1 - DECAY * factor
        self.values[k] -= self.pace * factor * mean / size / np.repeat([self.radius, 1.0], 3)
        for part, reach in ((np.s_[:3], self.radius), (np.s_[3:], 1.0)):
            far = reach * float(np.linalg.norm(self.values[k, part]))
            self.values[k, part] *= min(1.0, self.most / max(far, 1e-15))

    def at(self, t: int) -> Float64[np.ndarray, "6"]:
        """The correction of any frame."""
        return np.array([np.interp(t, self.times, self.values[:, i]) for i in range(6)])


def about(
    twist: Float64[np.ndarray, "6"], middle: Float64[np.ndarray, "3"]
) -> Float64[np.ndarray, "4 4"]:
    """The motion that turns about `middle` and then shifts."""
    motion = geometry.rigid(twist[:3], np.zeros(3))
    motion[:3, 3] = middle - motion[:3, :3] @ middle + twist[3:]
    return motion


def twist_of(
    placed: Splats,
    gradients: Gradients,
    rows: Int[np.ndarray, "m"] | slice,
    middle: Float64[np.ndarray, "3"],
) -> Float64[np.ndarray, "6"]:
    """Derivative of the loss by a twist of some placed splats about `middle`, world axes."""
    assert placed.quats is not None
    assert gradients.quats is not None
    if isinstance(rows, slice):
        rows = np.arange(len(placed))[rows]
    out = np.empty(6)
    carrying.twist(rows, middle, placed.means, placed.quats, gradients.means, gradients.quats, out)
    return out


def corrected(
    motion: Float64[np.ndarray, "t 4 4"], middle: Float64[np.ndarray, "t 3"], twists: Twists
) -> Float64[np.ndarray, "t 4 4"]:
    """A whole track with its corrections."""
    return np.stack([about(twists.at(t), middle[t]) @ motion[t] for t in range(len(motion))])
