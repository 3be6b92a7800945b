"""Gaussians at single times: residuals added where one rigid shape and color cannot show a recorded view."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float64, Int

from rpaug.core.types import FrameResidual, Gaussians
from rpaug.render.splat import Splats

LEAST_OPACITY = 1e-4
PARTS = ("means", "quats", "scales", "opacities", "sh")


def at(gaussians: Gaussians, t: int) -> Gaussians:
    """The Gaussians as they are at t alone, without moments of their own."""
    moment = gaussians.frame_residuals.get(t)
    if moment is None:
        return replace(gaussians, frame_residuals={}) if gaussians.frame_residuals else gaussians
    rows = moment.rows
    own = {name: getattr(gaussians, name).copy() for name in PARTS}
    own["means"][rows] += moment.means * own["scales"][rows].max(-1, keepdims=True)
    own["quats"][rows] += moment.quats
    own["scales"][rows] *= np.exp(moment.scales.astype(np.float32))
    opacities = own["opacities"][rows] + moment.opacities
    own["opacities"][rows] = np.clip(opacities, LEAST_OPACITY, 1 - LEAST_OPACITY)
    own["sh"][rows] += moment.sh
    return replace(gaussians, frame_residuals={}, **own)


def difference(
    usual: Gaussians, there: Gaussians | Splats, rows: Int[np.ndarray, "m"]
) -> FrameResidual:
    """The moment that makes rows of `usual` what the rows of `there`, as many as `rows`, are."""
    assert there.scales is not None
    widths = usual.scales[rows].max(-1, keepdims=True)
    half = {
        "means": (there.means - usual.means[rows]) / widths,
        "quats": there.quats - usual.quats[rows],
        "scales": np.log(there.scales) - np.log(usual.scales[rows]),
        "opacities": there.opacities - usual.opacities[rows],
        "sh": there.sh - usual.sh[rows],
    }
    return FrameResidual(
        rows.astype(np.int32),
        *(np.clip(half[name], -6e4, 6e4).astype(np.float16) for name in PARTS),
    )


def kept(
    frame_residuals: Mapping[int, FrameResidual], keep: Int[np.ndarray, "m"], count: int
) -> dict[int, FrameResidual]:
    """The moments of the Gaussians `keep` names, of `count`, in that order."""
    if not frame_residuals:
        return {}
    if len(np.unique(keep)) < len(keep):
        raise ValueError("a Gaussian with moments can be kept only once")
    place = np.full(count, -1, np.int32)
    place[keep] = np.arange(len(keep), dtype=np.int32)
    out = {}
    for t, moment in frame_residuals.items():
        there = place[moment.rows]
        order = np.flatnonzero(there >= 0)
        order = order[np.argsort(there[order])]
        chosen = {name: getattr(moment, name)[order] for name in PARTS}
        out[t] = FrameResidual(there[order], **chosen)
    return out


def joined(sets: Sequence[Gaussians]) -> dict[int, FrameResidual]:
    """The moments of several sets of Gaussians, put one after the other."""
    starts = np.cumsum([0, *(len(one) for one in sets)])
    out = {}
    for t in sorted(set().union(*(one.frame_residuals for one in sets))):
        parts = [
            (one.frame_residuals[t], start)
            for one, start in zip(sets, starts, strict=False)
            if t in one.frame_residuals
        ]
        rows = np.concatenate([moment.rows + np.int32(start) for moment, start in parts])
        arrays = {
            name: np.concatenate([getattr(moment, name) for moment, _ in parts]) for name in PARTS
        }
        out[t] = FrameResidual(rows, **arrays)
    return out


def moved(
    frame_residuals: Mapping[int, FrameResidual],
    rotation: Float64[np.ndarray, "3 3"],
    product: Float64[np.ndarray, "4 4"],
) -> dict[int, FrameResidual]:
    """Moments of turned Gaussians, whose quaternions were rows that `product` multiplied from the right."""
    return {
        t: replace(
            moment,
            means=(moment.means @ rotation.T).astype(np.float16),
            quats=(moment.quats @ product).astype(np.float16),
        )
        for t, moment in frame_residuals.items()
    }


def packed(frame_residuals: Mapping[int, FrameResidual]) -> dict[str, np.ndarray]:
    """All moments as a few long arrays, for a store: `times`, how many `rows` each has, and the rest in that order."""
    if not frame_residuals:
        return {}
    several = list(frame_residuals.values())
    arrays = {
        "times": np.array(list(frame_residuals), np.int32),
        "counts": np.array([len(moment.rows) for moment in several], np.int32),
    }
    for name in ("rows", *PARTS):
        arrays[name] = np.concatenate([getattr(moment, name) for moment in several])
    return arrays


def unpacked(arrays: Mapping[str, np.ndarray]) -> dict[int, FrameResidual]:
    """What `packed` packed."""
    if not arrays:
        return {}
    cuts = np.cumsum(arrays["counts"])[:-1]
    columns = [np.split(arrays[name], cuts) for name in ("rows", *PARTS)]
    return {
        int(t): FrameResidual(*parts) for t, *parts in zip(arrays["times"], *columns, strict=True)
    }
