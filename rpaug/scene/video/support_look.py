"""What the places of a support look like over a video: what covers one in a frame, and what is the support there.

A place is a square of the support's plane; its color is the median over the frames that show the support there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from rpaug.core import geometry
from rpaug.scene.instances import color_clusters
from rpaug.scene.video.frame import PosedFrame

FEWEST = 3  # frames that show a place, if its color is known
ALIKE = 9.0  # weighted Lab: so near to the support's color in a frame
FAR = 1 << 20  # places from the middle of the world


@dataclass(frozen=True, eq=False)
class SupportLook:
    """Squares of `side` of the plane z = `level`: `codes` in rising order, and the color of each in weighted Lab."""

    side: float
    level: float
    codes: Int64[np.ndarray, "n"]
    colors: Float32[np.ndarray, "n 3"]

    def scaled(self, factor: float) -> "SupportLook":
        """The same in a world that is `factor` times as large."""
        return replace(self, side=factor * self.side, level=factor * self.level)

    def places(self, look: PosedFrame) -> Int64[np.ndarray, "h w"]:
        """Which place each pixel's ray meets; -1 where it meets none."""
        return _codes(look, self.level, self.side)

    def off(
        self, look: PosedFrame, among: Bool[np.ndarray, "h w"], around: int = 0
    ) -> Float64[np.ndarray, "h w"]:
        """How far each pixel is from the color of its place; NaN where that is not known.

        The frame's exposure and white are told by the pixels `among` which it shows the support. The nearest color of
        so many places `around` counts: a place on an outline is part this, part that.
        """
        out = np.full(look.depth.shape, np.nan)
        if not len(self.codes):
            return out
        codes = self.places(look)
        at, known = self._found(codes)
        if not (known & among).any():
            return out
        shown = color_clusters.weighted(look.rgb)
        shown = shown - np.median((shown - self.colors[at])[known & among], 0)
        steps = range(-around, around + 1)
        for step in (2 * FAR * row + column for row in steps for column in steps):
            beside, there = self._found(codes + step)
            there &= known
            off = np.linalg.norm(shown[there] - self.colors[beside[there]], axis=-1)
            out[there] = np.fmin(out[there], off)
        return out

    def _found(
        self, codes: Int64[np.ndarray, "h w"]
    ) -> tuple[Int64[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
        """Where in `codes` these are, and which of them are there."""
        at = np.minimum(np.searchsorted(self.codes, codes), len(self.codes) - 1)
        return at, self.codes[at] == codes


def shown(
    looks: Sequence[PosedFrame],
    masks: Sequence[Bool[np.ndarray, "h w"]],
    level: float,
    side: float,
) -> SupportLook:
    """The places that `masks` mark in the looks, where these have the support's color: an arm that is taken for it has
    another."""
    codes, colors = [np.zeros(0, np.int64)], [np.zeros((0, 3), np.float32)]
    for look, mask in zip(looks, masks, strict=True):
        mine, lab = _codes(look, level, side), color_clusters.weighted(look.rgb)
        mask = mask & (mine >= 0)
        if mask.any():
            mask = mask & (np.linalg.norm(lab - np.median(lab[mask], 0), axis=-1) < ALIKE)
        own, of = np.unique(mine[mask], return_inverse=True)
        total = np.zeros((len(own), 3))
        np.add.at(total, of, lab[mask])
        codes.append(own)
        colors.append((total / np.bincount(of, minlength=len(own))[:, None]).astype(np.float32))
    every, shown = np.concatenate(codes), np.concatenate(colors)
    order = np.argsort(every, kind="stable")
    known, first, count = np.unique(every[order], return_index=True, return_counts=True)
    enough = np.flatnonzero(count >= FEWEST)
    middle = [np.median(shown[order[first[k] : first[k] + count[k]]], 0) for k in enough]
    return SupportLook(side, level, known[enough], np.array(middle, np.float32).reshape(-1, 3))


def _codes(look: PosedFrame, level: float, side: float) -> Int64[np.ndarray, "h w"]:
    """Which place each pixel's ray meets; -1 where it meets none."""
    rays = geometry.unproject(np.ones(look.depth.shape), look.K) @ look.cam_to_world[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        far = (level - look.cam_to_world[2, 3]) / rays[..., 2]
        at = np.floor((look.cam_to_world[:2, 3] + far[..., None] * rays[..., :2]) / side)
    met = np.isfinite(far) & (far > 0) & (np.abs(at) < FAR).all(-1)
    place = np.where(met[..., None], at, 0).astype(np.int64) + FAR
    return np.where(met, place[..., 0] * 2 * FAR + place[..., 1], -1)
