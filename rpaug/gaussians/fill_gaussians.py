"""New Gaussians behind what an edit took away: lifted from what surfels show there, then fitted near the hole alone.

Gaussians beside a removed thing were fitted to its outline as well as to their own surface, and show a rim of it once
it is gone. So those near the hole give way to new ones, one for each pixel of what surfels show there: what others saw,
and the paint for what nobody saw, which is made once for all views. A few steps fit these to all fixed cameras. Only
they move; all others stay bit for bit.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, Int32

from rpaug.core import geometry
from rpaug.core.errors import Unsupported
from rpaug.core.pixels import grown
from rpaug.core.types import Camera, Gaussians, Scene
from rpaug.gaussians import frame_residuals
from rpaug.gaussians.gaussian_view import sharp
from rpaug.gaussians.gaussians import LiftedImage, chosen, joined
from rpaug.gaussians.seeds import SAME_DEPTH, finest
from rpaug.render import holes, window
from rpaug.render.splat import Adam, Gradients, Loss, Rasteriser, Rates, Splats, View
from rpaug.scene.recorded import surfels
from rpaug.scene.recorded.carry import carried
from rpaug.scene.recorded.unseen import Background

STEPS = 60
RIM = 3  # pixels around what was hidden, where Gaussians show the outline of what hid it
LOSS = Loss(depth=0.5)
RATES = Rates(means=0.0, quats=0.0)  # they lie where surfels do


@dataclass(frozen=True)
class Patched:
    """A scene with Gaussians behind what was taken away, the last ones of all; `painted` of those, the last, are of
    paint."""

    scene: Scene
    painted: int = 0

    def invented(self, t: int, index: Int32[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
        """Which pixels show paint; `index` are rows of what `gaussian_view.seen` draws at t."""
        gaussians = self.scene.gaussians
        if not self.painted or gaussians is None:
            return np.zeros(index.shape, bool)
        gone = [instance_id for edit in carried(self.scene, t) for instance_id in edit.instance_ids]
        rest = np.flatnonzero(~np.isin(gaussians.ids, gone))
        inside = (index >= 0) & (index < len(rest))
        own = rest[np.clip(index, 0, len(rest) - 1)]
        return inside & (own >= len(gaussians) - self.painted)


@dataclass(frozen=True)
class _Near:
    """What one fixed camera should show near the hole, static things alone."""

    camera: Camera
    picture: LiftedImage
    painted: Bool[np.ndarray, "h w"]


def patched(
    scene: Scene, kept: Callable[[], surfels.Surfels] | None = None, steps: int = STEPS
) -> Patched:
    """The scene with new Gaussians near what its edits uncover of static things; itself where there is no such place.

    They are nowhere to be had where a source has no depth, since surfels cannot be told there.
    """
    if scene.gaussians is None or scene.recorded_bodies is None:
        return Patched(scene)
    try:
        found = surfels.build(scene, kept() if kept else None)
    except Unsupported:
        return Patched(scene)
    edited = surfels.standing_edited(found, scene)
    if not edited:
        return Patched(scene)
    near = [_near(one) for one in surfels.backgrounds(found, scene).values() if one.behind.any()]
    seen = _lifted(near, painted=False)
    paint = _lifted(near, painted=True)
    new = joined([*seen, *paint]) if seen or paint else None
    if new is None or not len(new):
        return Patched(scene)
    old = scene.gaussians
    static = np.isin(old.ids, list(found.static - edited))
    stays = ~(static & _close(old, near))
    others = Splats.of(frame_residuals.at(chosen(old, static & stays), 0))
    goals = [replace(one, picture=_with_new(one, new)) for one in near]
    fitted = _fitted(replace(new, sh=_padded(new.sh, old.sh.shape[1])), others, goals, steps)
    whole = joined([chosen(old, stays), fitted])
    return Patched(replace(scene, gaussians=whole), sum(len(part) for part in paint))


def _near(one: Background) -> _Near:
    filled = holes.fill(one.drawn)
    use = grown(one.behind, RIM) & (filled.depth > 0)
    pose = one.camera.cam_to_world[0]
    picture = LiftedImage(filled.image, filled.depth, filled.ids, one.camera.K, pose, use)
    return _Near(one.camera, picture, one.hole)


def _lifted(near: list[_Near], painted: bool) -> list[Gaussians]:
    """The Gaussians of what was painted, or of all else, each place once."""
    every = [replace(one.picture, use=one.picture.use & (one.painted == painted)) for one in near]
    return [part for part in finest(every) if len(part)]


def _close(gaussians: Gaussians, near: list[_Near]) -> Bool[np.ndarray, "n"]:
    """Those that some camera sees near the hole, on the surface there or before it."""
    close = np.zeros(len(gaussians), bool)
    for one in near:
        row, column, z = _pixels(gaussians, one)
        surface = one.picture.depth[row, column]
        before = z < surface * (1 + SAME_DEPTH) + 0.01
        close |= (row >= 0) & one.picture.use[row, column] & before
    return close


def _with_new(one: _Near, new: Gaussians) -> LiftedImage:
    """The picture, used also where the camera sees what other cameras' pixels were lifted to."""
    depth = one.picture.depth
    row, column, z = _pixels(new, one)
    row, column, z = (part[row >= 0] for part in (row, column, z))
    seen = np.zeros(depth.shape, bool)
    shown = np.abs(depth[row, column] - z) < 0.01 + SAME_DEPTH * z
    seen[row[shown], column[shown]] = True
    return replace(one.picture, use=one.picture.use | (grown(seen, 1) & (depth > 0)))


def _pixels(
    gaussians: Gaussians, one: _Near
) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "n"], Float64[np.ndarray, "n"]]:
    """Row and column in which the camera shows each, -1 where it does not, and its depth."""
    local = geometry.local_points(gaussians.means.astype(np.float64), one.camera, 0)
    row, column, inside = geometry.in_image(local, one.camera.K, one.picture.depth.shape)
    return np.where(inside, row, -1), np.where(inside, column, -1), local[:, 2]


def _padded(sh: Float32[np.ndarray, "n 1 3"], terms: int) -> Float32[np.ndarray, "n k 3"]:
    return np.pad(sh, ((0, 0), (0, terms - sh.shape[1]), (0, 0)))


def _fitted(new: Gaussians, others: Splats, near: list[_Near], steps: int) -> Gaussians:
    """The new Gaussians once they and the others together show what they should."""
    adam, engine = Adam(Splats.of(new), RATES), Rasteriser(sharp(others))
    goals = [goal for goal in map(_goal, near) if goal is not None]
    for step in range(steps):
        view, color, depth, weight = goals[step % len(goals)]
        engine.forward(_beside(others, adam.splats), view, surface=False)
        _, slopes = engine.backward_loss(LOSS, color, weight, depth)
        adam.step(_last(slopes, len(new)), 1 - 0.9 * step / steps)
    made = {name: getattr(adam.splats, name) for name in NAMES}
    return replace(new, **made)


NAMES = ("means", "opacities", "sh", "quats", "scales")


def _goal(one: _Near) -> tuple[View, np.ndarray, np.ndarray, np.ndarray] | None:
    """View, color, depth and weights of a window on the hole."""
    shown, pose = one.picture, one.camera.cam_to_world[0]
    piece = window.around(shown.use, shown.K, pose)
    if piece is None:
        return None
    at = np.s_[piece.rows, piece.columns]
    view = View(piece.own, geometry.inverse(pose), *piece.size)
    color = shown.rgb[at].astype(np.float32) / 255
    return view, color, np.ascontiguousarray(shown.depth[at]), shown.use[at].astype(np.float32)


def _beside(others: Splats, new: Splats) -> Splats:
    parts = {n: np.concatenate([getattr(others, n), getattr(new, n)]) for n in NAMES}
    return Splats(**parts)


def _last(slopes: Gradients, count: int) -> Gradients:
    """The gradients of the last `count` rows."""
    rows: dict[str, Any] = {
        name: None if array is None else np.ascontiguousarray(array[-count:])
        for name, array in vars(slopes).items()
    }
    return replace(slopes, **rows)
