"""A grid of colors around one thing, read alike by its Gaussians and by the pixels that show it, with gradients."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float32, Int, Int32
from torch import Tensor
from torch.nn import functional

from rpaug.core.types import Gaussians
from rpaug.gaussians.painting import corners, places
from rpaug.gaussians.windows import TargetWindow

BLOTCH = 4.0  # cells between the colors that a pattern begins with


@dataclass(frozen=True)
class Gather:
    """Eight corners around each of n points, and what the point takes of each."""

    corners: Int[Tensor, "n 8"]
    shares: Float[Tensor, "n 8"]

    def __call__(self, values: Float[Tensor, "m c"]) -> Float[Tensor, "n c"]:
        """The values at the points, between those of the corners; its gradient, too, does not depend on threads."""
        return functional.embedding_bag(
            self.corners, values, per_sample_weights=self.shares, mode="sum"
        )


@dataclass(frozen=True)
class Cells:
    """Corners of a grid around the target: what is optimised, so that neighbours are of one color.

    Free colors for each Gaussian would let every view have its own, since each sees others in front. `gaussians` and
    `pixels` (of each view's target) read the same corners: the two carriers of one surface.
    """

    ids: Int32[np.ndarray, "m"]
    points: Float32[np.ndarray, "m 3"]
    width: float
    gaussians: Gather
    pixels: tuple[Gather, ...]

    @classmethod
    def of(
        cls, gaussians: Gaussians, rows: Int[np.ndarray, "g"], looked: Sequence[TargetWindow]
    ) -> "Cells":
        """As wide as a pixel is on the target, in the view in the middle."""
        width = float(np.median([window.footprint for window in looked]))
        given = [(gaussians.ids[rows], gaussians.means[rows])]
        given += [(window.ids, window.points) for window in looked]
        instance_ids = np.unique(np.concatenate([ids for ids, _ in given]))
        found = [corners(instance_ids, ids, points, width) for ids, points in given]
        unique = np.unique(np.concatenate([keys.ravel() for keys, _ in found]))
        ids, points = places(instance_ids, unique, width)
        gathers = [
            Gather(
                torch.from_numpy(np.searchsorted(unique, keys.T)),
                torch.from_numpy(shares.T.astype(np.float32)),
            )
            for keys, shares in found
        ]
        return cls(ids, points, width, gathers[0], tuple(gathers[1:]))

    def blotches(
        self, rng: np.random.Generator, colors: Float32[np.ndarray, "p 3"]
    ) -> Float32[np.ndarray, "m 3"]:
        """Colors drawn at random a few cells apart and blended in between: what a pattern grows from."""
        instance_ids = np.unique(self.ids)
        keys, shares = corners(instance_ids, self.ids, self.points, BLOTCH * self.width)
        unique, where = np.unique(keys, return_inverse=True)
        drawn = colors[rng.integers(len(colors), size=len(unique))]
        blended = (drawn[where.reshape(keys.shape)] * shares[..., None]).sum(0)
        return blended.astype(np.float32)
