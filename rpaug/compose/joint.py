"""The last fine-tune of RoboPearls: all edited Gaussians together, over all views, after all edits.

Paint is laid into the Gaussians themselves; then those of the edited instances are stepped until they show what the
edits look like in the recorded cameras (`goals`). All others keep every bit. What was gained is measured in views at
times that were not shown to the descent, and where that is nothing the scene stays as it was.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float32, Int

from rpaug.compose import baking
from rpaug.compose.goals import Goal, goals
from rpaug.core.metrics import decibels
from rpaug.core.sampling import frames
from rpaug.core.types import Gaussians, Scene
from rpaug.gaussians import flowing, frame_residuals, gaussian_view
from rpaug.gaussians.descent import PARAMETERS, cosine
from rpaug.gaussians.gaussians import Placement
from rpaug.render.splat import Adam, Gradients, Rates, Splats, engine
from rpaug.scene.recorded.carry import carried

LOOKS = Rates(means=0, quats=0, scales=1e-2, opacities=0.02, sh=5e-3, sh_rest=5e-4)


@dataclass(frozen=True, kw_only=True)
class RefineSettings:
    """How the edited Gaussians are stepped: one view a step, of at most `times` times; `held` more are kept back.

    Where bodies were moved, copied or resized, `LOOKS` takes the place of `rates`: a Gaussian may be drawn at several
    places then, and keeps its own.
    """

    steps: int = 200
    times: int = 10
    held: int = 3
    depth_weight: float = 3.0
    last_rate: float = 0.05
    backend: str = "auto"  # one of `render.splat.engines`, for the descent
    rates: Rates = field(default_factory=lambda: replace(LOOKS, means=0.01, quats=2e-3))


def refined(
    scene: Scene, settings: RefineSettings | None = None, seed: int = 0
) -> tuple[Scene, dict[str, Any]]:
    """The scene after the fine-tune, and what that came to as plain values.

    Those say how many Gaussians were stepped, the PSNR in decibels over what was edited and its outline at times kept
    back, before and after, and whether the outcome was `kept`.
    """
    settings = settings or RefineSettings()
    rows = edited(scene)
    facts: dict[str, Any] = {"gaussians": len(rows), "steps": settings.steps, "kept": False}
    if not len(rows) or not settings.steps:
        return scene, facts
    if any(view.depth is None or view.ids is None for view in scene.episode.views.values()):
        return scene, facts | {"skipped": "the recording lacks depth or masks"}
    shown, unseen = _times(scene.episode.length, settings)
    instance_ids = baking.painted(scene).union(*(one.shows.values() for one in carried(scene, 0)))
    judges = goals(scene, unseen, instance_ids)
    start = baking.baked(scene)
    descent = _JointDescent(start, rows, settings)
    descent.run(goals(scene, shown, instance_ids), np.random.default_rng(seed))
    tuned = descent.scene()
    before, after = quality(scene, judges), quality(tuned, judges)
    facts |= {"before_db": round(before, 2), "after_db": round(after, 2), "kept": after > before}
    return (tuned if after > before else scene), facts


def edited(scene: Scene) -> Int[np.ndarray, "m"]:
    """The Gaussians of all that was painted, moved, resized or copied."""
    assert scene.gaussians is not None
    moved = [one.shows.keys() for t in range(scene.episode.length) for one in carried(scene, t)]
    instance_ids = baking.painted(scene).union(*moved)
    return np.flatnonzero(np.isin(scene.gaussians.ids, list(instance_ids)))


def quality(scene: Scene, views: Sequence[Goal]) -> float:
    """PSNR in decibels over the judged pixels of these views."""
    painted = tuple(edit for edit in scene.appearance if edit.instance_ids is not None)
    cameras = {goal.name: goal.camera for goal in views}
    plain = replace(scene, cameras=cameras, appearance=painted)
    errors = [np.zeros(0)]
    for goal in views:
        image = gaussian_view.render_view(plain, goal.name, goal.t)[0].astype(np.float32) / 255
        errors.append((image[goal.judged] - goal.rgb[goal.judged]).astype(np.float64).ravel() ** 2)
    error = np.concatenate(errors)
    return decibels(float(error.mean())) if len(error) else 0.0


def _times(length: int, settings: RefineSettings) -> tuple[list[int], list[int]]:
    """Times to be shown, and times between them to be kept back; one alone serves as both."""
    every = frames(length, settings.times + settings.held)
    step = max(len(every) // max(settings.held, 1), 2)
    unseen = every[1::step][: settings.held]
    return [t for t in every if t not in unseen], unseen or every


class _JointDescent:
    """Steps the Gaussians `rows` of a scene downhill, one view at a time."""

    def __init__(self, scene: Scene, rows: Int[np.ndarray, "m"], settings: RefineSettings) -> None:
        assert scene.gaussians is not None
        self._scene, self._rows, self._settings = scene, rows, settings
        self._usual = scene.gaussians
        splats = Splats.of(scene.gaussians)
        rates = settings.rates if scene.recorded_bodies is None else LOOKS
        self._adam = Adam(splats, rates)
        self._engine = engine(settings.backend, gaussian_view.sharp(splats))
        self._place = Placement.of(scene.gaussians.ids, scene.tracked, scene.irradiance)
        self._others = np.ones(len(splats), bool)
        self._others[rows] = False

    def run(self, views: Sequence[Goal], rng: np.random.Generator) -> None:
        """All steps, every view as often as any other."""
        order: list[int] = []
        for step in range(self._settings.steps):
            order = order or rng.permutation(len(views)).tolist()
            done = step / self._settings.steps
            self._step(views[order.pop()], cosine(done, self._settings.last_rate))

    def scene(self) -> Scene:
        """The scene with what the rows have come to; all other Gaussians bit for bit as before."""
        return replace(self._scene, gaussians=self._with_rows())

    def _with_rows(self) -> Gaussians:
        own = {}
        for name in PARAMETERS:
            own[name] = getattr(self._usual, name).copy()
            own[name][self._rows] = getattr(self._adam.splats, name)[self._rows]
        return replace(self._usual, **own)

    def _step(self, goal: Goal, factor: float) -> None:
        then = frame_residuals.at(self._with_rows(), goal.t)
        placed = self._place.place(Splats.of(then), goal.t)
        drawn, origin, scales = self._edited(then, placed, goal.t)
        camera = replace(self._scene, cameras={goal.name: goal.camera})
        eye = gaussian_view.standing(camera, goal.name)
        self._engine.prepare(drawn, gaussian_view.view_of(eye, goal.t))
        _, _, slopes = self._engine.backward_squared_error(
            goal.rgb, goal.weight, goal.depth, self._settings.depth_weight
        )
        gathered = slopes if origin is None else _gathered(slopes, placed, origin, scales)
        own, _ = self._place.pull_back(gathered, Splats.of(then), placed, goal.t)
        for name in PARAMETERS:
            getattr(own, name)[self._others] = 0
        self._adam.step(own, factor)

    def _edited(
        self, then: Gaussians, placed: Splats, t: int
    ) -> tuple[Splats, Int[np.ndarray, "k"] | None, Float32[np.ndarray, "k"]]:
        """What is drawn, which row each of the first drawn comes from (None: every one from its own), and by what
        factor it was resized."""
        scene, edits = self._scene, carried(self._scene, t)
        if not edits and scene.flowing is None:
            return placed, None, np.zeros(0, np.float32)
        assert placed.quats is not None  # only Gaussians with axes are fitted
        there = replace(then, means=placed.means, quats=placed.quats, sh=placed.sh)
        moved = flowing.edited(there, scene, t, np.zeros(3))
        gone = [instance_id for edit in edits for instance_id in edit.instance_ids]
        parts = [np.flatnonzero(~np.isin(then.ids, gone))]
        parts += [np.flatnonzero(np.isin(then.ids, list(e.shows))) for e in edits if e.shows]
        sizes = [1.0, *(edit.scale for edit in edits if edit.shows)]
        factors = [np.full(len(p), s, np.float32) for p, s in zip(parts, sizes, strict=True)]
        drawn = Splats.of(moved)
        if scene.flowing is not None:
            middle = scene.flowing.origin
            bent = flowing.edited(flowing.standing(scene.flowing, t), scene, t, middle)
            drawn, _ = flowing.beside(drawn, moved.ids, bent, middle)
        return drawn, np.concatenate(parts), np.concatenate(factors)


def _gathered(
    slopes: Gradients,
    placed: Splats,
    origin: Int[np.ndarray, "k"],
    scales: Float32[np.ndarray, "k"],
) -> Gradients:
    """Gradients of looks by what is drawn, summed by the row it comes from; of places and turns none."""
    own = {name: np.zeros_like(getattr(placed, name), np.float32) for name in PARAMETERS}
    count = len(origin)
    assert slopes.scales is not None
    np.add.at(own["sh"], origin, slopes.sh[:count])
    np.add.at(own["opacities"], origin, slopes.opacities[:count])
    np.add.at(own["scales"], origin, slopes.scales[:count] * scales[:, None])
    return replace(slopes, **own)
