"""From an episode and a recipe to a scene in which its edits can be made, and the plan of who shows what."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rpaug import plan as planning
from rpaug import report, residuals, splits
from rpaug.errors import RpaugError
from rpaug.interfaces import Adapter, Operator
from rpaug.recipe import Recipe
from rpaug.scene import arms, calibration
from rpaug.scene.build import build
from rpaug.types import Camera, Effect, Episode, Scene


def operators(recipe: Recipe) -> list[Operator]:
    """Every operator the recipe may use."""
    return [option.operator for step in recipe.steps for option in step.options]


def ground(scene: Scene, recipe: Recipe) -> None:
    """See that the scene has what every edit of the recipe asks for. Raises TargetError."""
    for operator in operators(recipe):
        operator.sample(scene, np.random.default_rng(0))


def made_ready(
    episode: Episode,
    recipe: Recipe,
    tier: int,
    scenes: Path | None = None,
    watch: report.Stopwatch | None = None,
    founder: Callable[[], Episode] | None = None,
) -> tuple[Scene, planning.Plan]:
    """Plan and build: errors are measured if the recipe states an accuracy, Gaussians fitted if the plan has any.

    `founder` reads the episode whose static Gaussians are borrowed.
    """
    watch = watch or report.Stopwatch()
    with watch("build"):
        scene, plan = surveyed(episode, recipe, tier)
    if not plan.gaussians:
        return _with_parts(scene, plan), plan
    with watch("fit"):
        lender = _lender(founder, recipe)
        scene, facts = _with_gaussians(scene, plan, scenes, lender)
        risen = dict.fromkeys(one.camera for one in plan.regions if one.lower is not None)
        measured = residuals.of_gaussians(scene, risen)
    return _with_parts(scene, plan), planning.fitted(plan, facts, measured)


def surveyed(episode: Episode, recipe: Recipe, tier: int) -> tuple[Scene, planning.Plan]:
    """The recorded scene without Gaussians, and the plan with errors measured where the recipe asks for an accuracy."""
    for operator in operators(recipe):
        operator.ready()
    plan = planning.make(operators(recipe), episode, tier)
    scene = _built(episode, recipe, plan)
    if plan.bodies:
        # Whatever looks at depth is misled by cameras that are not where they say they are.
        off = tuple(map(str, calibration.check(episode)))
        plan = replace(plan, warnings=(*off, *arms.misfits(recipe.arms, episode.robot)))
    if recipe.accuracy is None:
        return scene, plan
    moved = {name: camera for name, camera in _moved(scene, recipe) if plan.carriers[name] == 1}
    measured = residuals.measure(scene, moved) if moved else []
    return scene, planning.weigh(plan, residuals.regions(scene), measured, recipe.accuracy)


def _built(episode: Episode, recipe: Recipe, plan: planning.Plan) -> Scene:
    known = arms.for_robot(recipe.arms, episode.robot) if plan.bodies else ()
    return build(episode, with_bodies=plan.bodies, arms=known)


def planned(episode: Episode, recipe: Recipe, tier: int) -> planning.Plan:
    """The plan, with no more work than it takes: images are looked at only where the recipe asks for an accuracy."""
    if recipe.accuracy is None:
        return planning.make(operators(recipe), episode, tier)
    return surveyed(episode, recipe, tier)[1]


def _moved(scene: Scene, recipe: Recipe) -> Iterator[tuple[str, Camera]]:
    """Where one draw of the recipe's camera edits puts cameras."""
    edited = scene
    for operator in operators(recipe):
        if operator.effect & Effect.CAMERA:
            edit = operator.sample(scene, np.random.default_rng(0))
            edited = operator.apply(edited, json.loads(json.dumps(edit)))
    for name, camera in edited.cameras.items():
        if camera is not scene.cameras[name]:
            yield name, camera


def prepare(episode: Episode, plan: planning.Plan, scenes: Path | None = None) -> Scene:
    """The recorded scene with what the plan asks for, Gaussians among it: from the store `scenes`, or fitted."""
    scene = build(episode, with_bodies=plan.bodies)
    scene = _with_gaussians(scene, plan, scenes)[0] if plan.gaussians else scene
    return _with_parts(scene, plan)


def _lender(founder: Callable[[], Episode] | None, recipe: Recipe) -> Scene | None:
    if founder is None:
        return None
    episode = founder()
    return build(episode, with_bodies=True, arms=arms.for_robot(recipe.arms, episode.robot))


def _with_gaussians(
    scene: Scene, plan: planning.Plan, scenes: Path | None, lender: Scene | None = None
) -> tuple[Scene, Mapping[str, Any]]:
    from rpaug.scene import cached  # only here: it brings torch and the rasteriser

    fitted = cached.fitted_in_time if plan.tier >= 4 else cached.fitted
    return fitted(scene, scenes, founder=lender)


def founders(adapter: Adapter, root: Path, keys: Sequence[str]) -> dict[str, str]:
    """For each of these episodes that may borrow static Gaussians the one that lends them.

    That is the first episode of its place in its split of the whole dataset, in natural order: whatever was selected
    or fitted before, and in whatever order, it is the same. The first itself, and what cannot be read, is left out.
    """
    from rpaug.scene import sharing  # only here: it brings torch and the rasteriser

    first: dict[tuple[str | None, str], str] = {}
    found, wanted = {}, set(keys)
    for key in adapter.episodes(root):
        try:
            where = sharing.place(adapter.read(root, key))
        except RpaugError:
            continue  # told when its turn comes
        if where is None:
            continue
        # Pixels of one split never come into another.
        lender = first.setdefault((splits.kind(key), where), key)
        if lender != key and key in wanted:
            found[key] = lender
    return found


def _with_parts(scene: Scene, plan: planning.Plan) -> Scene:
    """The scene in which targets finer than the masks have handles of their own."""
    if not plan.parts:
        return scene
    from rpaug.scene.semantic import parts  # only here: it brings torch and the rasteriser

    return parts.told(scene, plan.parts)
