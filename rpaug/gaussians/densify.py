"""More Gaussians where the residual pulls hardest on the image, fewer where nothing is seen of them."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from rpaug.core import geometry
from rpaug.render.splat import Splats

APART = 0.5  # of a standard deviation along the longest axis: how far each half goes
NARROWER = 0.7  # of that axis: two halves so far apart are about as long as the whole


@dataclass(frozen=True)
class Densify:
    """Every `every` iterations, until `until` of them are made: what is fainter than `faintest` goes, and the share
    `grow` of the rest that pulls hardest on the image is split in two.
    """

    every: int = 40
    grow: float = 0.05
    faintest: float = 0.02  # opacity
    until: float = 0.6  # of the iterations

    def due(self, step: int, iterations: int) -> bool:
        """Whether it is time."""
        return step > 0 and step % self.every == 0 and step <= self.until * iterations


def densified(
    splats: Splats, motion: Float[np.ndarray, "n"], settings: Densify
) -> tuple[Splats, Int[np.ndarray, "m"]]:
    """The splats after pruning and splitting, and the row each one comes from.

    `motion` is `Gradients.image_motion`, summed over the views and steps since last time: it has no unit of length, so
    what is split does not depend on the scene's. Halves lie along the longest axis; each lets through the
    root of the light that the whole did (Rota Bulo et al. 2024, arXiv 2404.06109, for copies in one place).
    """
    assert splats.quats is not None
    assert splats.scales is not None
    kept = np.flatnonzero(splats.opacities >= settings.faintest)
    count = int(settings.grow * len(kept))
    order = np.argsort(-motion[kept], kind="stable")
    split = np.sort(kept[order[:count]])
    split = split[motion[split] > 0]
    parents = np.concatenate([kept, split])
    made = taken(splats, parents)
    first = np.searchsorted(kept, split)
    halves = np.concatenate([first, np.arange(len(kept), len(parents))])
    side = np.repeat([1.0, -1.0], len(split))
    rows = parents[halves]
    longest = splats.scales[rows].argmax(1)
    xyzw = splats.quats[rows][:, [1, 2, 3, 0]].astype(np.float64)
    turns = geometry.pose_of(np.zeros((len(rows), 3)), xyzw)
    axis = turns[np.arange(len(rows)), :3, longest]
    length = splats.scales[rows, longest]
    assert made.scales is not None
    made.means[halves] += (side * APART * length)[:, None] * axis
    made.scales[halves, longest] *= np.float32(NARROWER)
    made.opacities[halves] = 1 - np.sqrt(1 - np.minimum(made.opacities[halves], 1))
    return made, parents


def taken(splats: Splats, rows: Int[np.ndarray, "m"]) -> Splats:
    """Copies of some of the splats."""
    return replace(splats, **{k: a[rows] for k, a in vars(splats).items() if a is not None})
