"""New Gaussians for what nobody ever saw behind removed or moved things: lifted from what was painted there, then fitted.

The paint is that of the surfels (`rpaug.scene.recorded.unseen`): made once, in the view that shows most of the hole, and
lifted to its depth. Each painted pixel becomes a Gaussian, and a few steps fit those to what surfels show of the
hole in every fixed camera. Only they move; all others stay bit for bit.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32, Int32

from rpaug import geometry
from rpaug.errors import Unsupported
from rpaug.render import window
from rpaug.render.splat import Adam, Gradients, Loss, Rasteriser, Rates, Splats, View
from rpaug.render.zbuffer import Source
from rpaug.scene.four import flowing
from rpaug.scene.recorded import surfels
from rpaug.scene.recorded.carry import carried
from rpaug.scene.recorded.plates import among
from rpaug.scene.sampling import frames
from rpaug.scene.splats.gaussian_view import sharp, standing
from rpaug.scene.splats.gaussians import Picture, joined, lifted, standing_at
from rpaug.types import Gaussians, Scene

STEPS = 60
LOOKED = 8  # times among which each camera's clearest view of the hole is found
LOSS = Loss(depth=0.5)
RATES = Rates(means=0.02)  # the paint's depth is a plane's: they hardly leave it


@dataclass(frozen=True)
class _Goal:
    """What one camera should show of the hole, and the Gaussians that stay, in the world at that time."""

    view: View
    colour: Float32[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]
    weight: Float32[np.ndarray, "h w"]
    others: Splats


def completed(scene: Scene, kept: Callable[[], surfels.Surfels] | None, steps: int = STEPS) -> Scene:
    """The scene with Gaussians behind what an edit took away, after all others; itself where none are wanted.

    They are nowhere to be had where a source has no depth: surfels then cannot be told.
    """
    if scene.gaussians is None or scene.recorded_bodies is None:
        return scene
    try:
        found = surfels.build(scene, kept() if kept else None)
    except Unsupported:
        return scene
    new = joined([_lifted(patch) for patch in found.patches]) if found.patches else None
    if new is None or not len(new):
        return scene
    new = replace(new, sh=_padded(new.sh, scene.gaussians.sh.shape[1]))
    return replace(scene, gaussians=joined([scene.gaussians, _fitted(new, _goals(scene, found), steps)]))


def invented(
    before: Int32[np.ndarray, "n"], known: int, scene: Scene, t: int, index: Int32[np.ndarray, "h w"]
) -> np.ndarray:
    """Which pixels show Gaussians past the first `known` of the scene's, `before` being the handles of all of them and
    `index` the rows of those that the edited scene shows at t."""
    gone = frozenset(handle for edit in carried(scene, t) for handle in edit.handles)
    rest = np.flatnonzero(~np.isin(before, list(gone)))
    if not len(rest):
        return np.zeros(index.shape, bool)
    inside = (index >= 0) & (index < len(rest))
    return inside & (rest[np.clip(index, 0, len(rest) - 1)] >= known)


def _lifted(patch: Source) -> Gaussians:
    assert patch.use is not None
    return lifted(Picture(patch.rgb, patch.depth, patch.ids, patch.K, patch.cam_to_world, patch.use))


def _padded(sh: Float32[np.ndarray, "n 1 3"], terms: int) -> Float32[np.ndarray, "n k 3"]:
    return np.pad(sh, ((0, 0), (0, terms - sh.shape[1]), (0, 0)))


def _goals(scene: Scene, found: surfels.Surfels) -> list[_Goal]:
    """Each fixed camera's clearest view of the hole, as surfels show it."""
    assert scene.gaussians is not None
    goals = []
    for name in found.plates:
        view = scene.episode.views[name]
        assert view.ids is not None
        times = frames(scene.episode.length, LOOKED)
        gone = {t: frozenset(h for e in carried(scene, t) for h in e.handles) for t in times}
        t = max(times, key=lambda t: int(among(view.ids(t), gone[t]).sum()))
        recorded = replace(scene, cameras={**scene.cameras, name: view.camera})
        shown = surfels.view(found, recorded, name, t)
        piece = window.around(shown.hole, view.camera.K, view.camera.cam_to_world[t])
        if piece is None:
            continue
        at = np.s_[piece.rows, piece.columns]
        pose = standing(recorded, name).cam_to_world[t]
        there = standing_at(scene.gaussians, scene.tracked, t, scene.irradiance)
        goals.append(
            _Goal(
                View(piece.own, geometry.inverse(pose), *piece.size),
                np.ascontiguousarray(shown.image[at].astype(np.float32) / 255),
                np.ascontiguousarray(shown.depth[at]),
                shown.hole[at].astype(np.float32),
                Splats.of(flowing.edited(there, scene, t, np.zeros(3))),
            )
        )
    return goals


def _fitted(new: Gaussians, goals: list[_Goal], steps: int) -> Gaussians:
    """The new Gaussians once they and the others together show the goals."""
    if not goals or not steps:
        return new
    adam = Adam(Splats.of(new), RATES)
    engines = [Rasteriser(sharp(goal.others)) for goal in goals]
    for step in range(steps):
        goal, engine = goals[step % len(goals)], engines[step % len(goals)]
        engine.forward(_beside(goal.others, adam.splats), goal.view, surface=False)
        _, slopes = engine.backward_loss(LOSS, goal.colour, goal.weight, goal.depth)
        adam.step(_last(slopes, len(new)), 1 - 0.9 * step / steps)
    made = adam.splats
    assert made.quats is not None
    assert made.scales is not None
    return replace(
        new, means=made.means, quats=made.quats, scales=made.scales, opacities=made.opacities, sh=made.sh
    )


def _beside(others: Splats, new: Splats) -> Splats:
    names = ("means", "opacities", "sh", "quats", "scales")
    return Splats(**{n: np.concatenate([getattr(others, n), getattr(new, n)]) for n in names})


def _last(slopes: Gradients, count: int) -> Gradients:
    """The gradients of the last `count` rows."""
    rows = {n: None if a is None else np.ascontiguousarray(a[-count:]) for n, a in vars(slopes).items()}
    return replace(slopes, **rows)
