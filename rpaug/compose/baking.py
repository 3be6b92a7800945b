"""Appearance edits laid into the Gaussians themselves, so that each blends with its neighbours in its new color."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32, Int

from rpaug.core.types import Appearance, Gaussians, Scene, Surface
from rpaug.gaussians.carrying import SH0
from rpaug.scene.recorded import surface


@dataclass(frozen=True)
class Elsewhere:
    """An appearance edit on fewer of its instances than it was made for."""

    edit: Appearance
    instance_ids: frozenset[int] | None

    def __call__(
        self, color: Float32[np.ndarray, "n 3"], surface: Surface
    ) -> Float32[np.ndarray, "n 3"]:
        return self.edit(color, surface)


def painted(scene: Scene) -> frozenset[int]:
    """Instances whose paint can be laid into their Gaussians.

    Left out is what bends and what there are copies of, whose Gaussians stand for several things, and all paint that
    came after an edit of everything, such as light: the order of edits counts.
    """
    found = frozenset[int]().union(*(edit.instance_ids or () for edit in _first(scene.appearance)))
    copied = frozenset(old for body in scene.bodies for old in body.copy_of)
    bent = frozenset[int]() if scene.flowing is None else frozenset(scene.flowing.ids.tolist())
    return found - copied - bent


def baked(scene: Scene) -> Scene:
    """The scene with that paint in its Gaussians' own colors, and no longer among its appearance edits.

    A Gaussian takes the color of the edit at its middle; harmonics beyond the constant one and residuals of single
    times are scaled alike.
    """
    instance_ids, gaussians = painted(scene), scene.gaussians
    assert gaussians is not None
    old = np.clip(0.5 + SH0 * gaussians.sh[:, 0], 0, 1)
    new = old.copy()
    camera = next(iter(scene.cameras.values()))
    where = surface.of_gaussians(gaussians, camera, 0, scene.tracked)
    first = _first(scene.appearance)
    for edit in first:
        rows = _rows(gaussians, (edit.instance_ids or frozenset()) & instance_ids)
        if len(rows):
            new[rows] = edit(new[rows], where(rows))
    appearance = [_without(edit, instance_ids) for edit in first]
    later = scene.appearance[len(first) :]
    kept = tuple(edit for edit in appearance if edit is not None)
    return replace(scene, gaussians=_colored(gaussians, old, new), appearance=(*kept, *later))


def _first(appearance: Sequence[Appearance]) -> tuple[Appearance, ...]:
    """The edits before the first one of everything."""
    stop = next(
        (k for k, edit in enumerate(appearance) if edit.instance_ids is None), len(appearance)
    )
    return tuple(appearance[:stop])


def _rows(gaussians: Gaussians, instance_ids: frozenset[int]) -> Int[np.ndarray, "m"]:
    return np.flatnonzero(np.isin(gaussians.ids, list(instance_ids)))


def _without(edit: Appearance, instance_ids: frozenset[int]) -> Appearance | None:
    assert edit.instance_ids is not None
    left = edit.instance_ids - instance_ids
    return Elsewhere(edit, left) if left else None


def _colored(
    gaussians: Gaussians, old: Float32[np.ndarray, "n 3"], new: Float32[np.ndarray, "n 3"]
) -> Gaussians:
    rows = np.flatnonzero((new != old).any(1))
    sh, ratio = gaussians.sh.copy(), np.ones_like(old)
    ratio[rows] = new[rows] / np.maximum(old[rows], 1e-2)
    sh[rows, 0] = (new[rows] - 0.5) / SH0
    sh[rows, 1:] *= ratio[rows, None]
    frame_residuals = {
        t: replace(moment, sh=(moment.sh * ratio[moment.rows][:, None]).astype(np.float16))
        for t, moment in gaussians.frame_residuals.items()
    }
    return replace(gaussians, sh=sh, frame_residuals=frame_residuals)
