"""From an episode and a recipe to a scene in which its edits can be made, and the plan of who shows what."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rpaug.core import memo, progress, splits
from rpaug.core.errors import Missing, RpaugError, SourceLacks, TargetError, Unsupported
from rpaug.core.interfaces import Adapter, Operator
from rpaug.core.types import Camera, Effect, Embeddings, Episode, Scene
from rpaug.gaussians import fit_static_rgb
from rpaug.pipeline import plan as planning
from rpaug.pipeline import report, residuals
from rpaug.pipeline.recipe import Option, Recipe, Step
from rpaug.providers import words
from rpaug.providers.models_settings import Models
from rpaug.scene.build import build, find, sources
from rpaug.scene.instances import by_models, rgb_episode
from rpaug.scene.instances.found import FoundInstances
from rpaug.scene.lighting import rig
from rpaug.scene.recorded import sensed
from rpaug.scene.targets import nouns, roles, settled, targets
from rpaug.scene.tracking import arms, calibration, robot_model
from rpaug.scene.video import reconstruct
from rpaug.scene.video.settings import VideoSettings
from rpaug.scene.video.video_scene import VideoScene


def operators(recipe: Recipe) -> list[Operator]:
    """Every operator the recipe may use."""
    return [option.operator for step in recipe.steps for option in step.options]


def ground(scene: Scene, recipe: Recipe) -> tuple[str, ...]:
    """The edits of the recipe that the scene has nothing for, each with its reason: copies leave them out.

    Raises TargetError where every edit of the recipe is missing, since its copies would be the recording, SourceLacks
    if that is for what the source cannot give; Missing where the recipe says `on_missing: fail`.
    """
    missing, lacks = [], False
    options = [option for step in recipe.steps for option in step.options]
    for number, step in enumerate(recipe.steps):
        for option in step.options:
            try:
                see_possible(scene, recipe.steps[:number], option)
            except (TargetError, Unsupported) as error:
                lacks |= isinstance(error, SourceLacks)
                how = _how(scene, str(error)) if isinstance(error, SourceLacks) else ""
                missing.append(f"{option.name}: {error}{how}")
    if missing and recipe.on_missing == "fail":
        raise Missing(f"{scene.episode.key}: {'; '.join(missing)}")
    if missing and len(missing) == len(options):
        kind = SourceLacks if lacks else TargetError
        raise kind("; ".join(dict.fromkeys(missing)))
    return tuple(missing)


def see_possible(scene: Scene, before: Sequence[Step], option: Option) -> None:
    """See that an edit can be drawn in a recorded scene, or there after the edits `before` it, which may make room for
    it. Raises TargetError, Unsupported with what is amiss in the recorded one."""
    try:
        _drawn(scene, option)
    except (TargetError, Unsupported):
        if not any(one.operator.effect & Effect.BODIES for step in before for one in step.options):
            raise
        after = scene
        for step in before:
            with suppress(TargetError, Unsupported):
                edit = _drawn(after, step.options[0])
                after = step.options[0].operator.apply(after, edit)
        try:
            _drawn(after, option)
        except (TargetError, Unsupported):
            pass
        else:
            return
        raise


def _drawn(scene: Scene, option: Option) -> Any:
    """The edit's first draw. Raises TargetError, Unsupported."""
    planning.check(option.operator, scene)
    edit = json.loads(json.dumps(option.operator.sample(scene, np.random.default_rng(0))))
    if planning.flat(scene) or scene.back:
        edited = option.operator.apply(scene, edit)
        planning.check_shown(option.operator, scene, edited)
        planning.check_steady(scene, edited)
    return edit


def _how(scene: Scene, reason: str) -> str:
    """How to give an episode the depth that it lacks, if that is what the reason is about."""
    if "depth" not in reason or all(view.depth for view in scene.episode.views.values()):
        return ""
    return (
        "; recorded depth is named in cameras.yaml (docs/rgb_only.md), a model that estimates it by --models"
        " depth=NAME or the recipe's key models: {depth: NAME}"
    )


def prepare_scene(
    episode: Episode,
    recipe: Recipe,
    tier: int,
    scenes: Path | None = None,
    watch: report.Stopwatch | None = None,
    donor: Callable[[], Episode] | None = None,
    *,
    device: str = "cpu",
) -> tuple[Scene, planning.Plan]:
    """Plan and build: errors are measured if the recipe states an accuracy, Gaussians fitted if the plan has any.

    `donor` reads the episode whose static Gaussians are borrowed, `device` (cpu, cuda) fits. A part that is not there
    is a warning of the plan.
    """
    watch = watch or report.Stopwatch()
    with watch("build"):
        scene, plan = build_and_plan(episode, recipe, tier)
    plan = replace(plan, device=device)
    if not plan.gaussians:
        return _with_parts(scene, plan)
    with watch("fit"):
        progress.told(episode.key, "fitting Gaussians")
        donor_scene = _donor_scene(donor, recipe)
        scene, facts = _with_gaussians(scene, plan, scenes, donor_scene)
        risen = dict.fromkeys(one.camera for one in plan.regions if one.lower is not None)
        measured = residuals.of_gaussians(scene, risen)
    return _with_parts(scene, planning.fitted(plan, facts, measured))


def _embeddings(choice: str) -> Embeddings:
    """The recipe's choice: `refuse`, `drop`, or the name or folder of a sentence model."""
    if choice == "refuse":
        return Episode.embeddings
    if choice == "drop":
        return Embeddings(drop=True)
    return Embeddings(partial(words.embedded, folder=None if choice == words.SHIPPED else choice))


def build_and_plan(episode: Episode, recipe: Recipe, tier: int) -> tuple[Scene, planning.Plan]:
    """The recorded scene without Gaussians, and the plan with errors measured where the recipe asks for an accuracy."""
    for operator in operators(recipe):
        operator.ready()
    _ = recipe.wording  # raises before any work where no model is named
    episode = replace(episode, embeddings=_embeddings(recipe.embeddings))
    plan = replace(planning.make(operators(recipe), episode, tier), refine=recipe.refine)
    plan = replace(plan, warnings=(*plan.warnings, *episode.unread))
    scene, plan = _built(episode, recipe, plan)
    plan = replace(
        plan,
        assumed=(
            *plan.assumed,
            *rgb_episode.assumptions(scene.episode),
            *sensed.told(scene.episode),
            *_by_color(scene, recipe),
        ),
    )
    if plan.bodies and scene.back is None:
        # Whatever looks at depth is misled by cameras that are not where they say they are.
        off = tuple(map(str, calibration.check(episode)))
        found = (*plan.warnings, *off, *arms.misfits(recipe.arms, episode.robot))
        scene, said = _with_robot(scene, recipe)
        plan = replace(plan, warnings=(*found, *said))
    if recipe.accuracy is None:
        return scene, plan
    moved = {
        name: camera for name, camera in _moved(scene, recipe) if plan.representations[name] == 1
    }
    measured = residuals.measure(scene, moved) if moved else []
    return scene, planning.weigh(plan, residuals.regions(scene), measured, recipe.accuracy)


def _by_color(scene: Scene, recipe: Recipe) -> list[str]:
    """A sentence for each target of the recipe that nothing but its color tells."""
    found = (
        targets.assumed(scene, one)
        for operator in operators(recipe)
        for one in planning.targets(operator)
    )
    return [sentence for sentence in dict.fromkeys(found) if sentence]


def _with_robot(scene: Scene, recipe: Recipe) -> tuple[Scene, tuple[str, ...]]:
    """The scene with the robot's shape from the first of the recipe's files that has one and fits; and what misfits."""
    said: list[str] = []
    moved = any(operator.effect & Effect.CAMERA for operator in operators(recipe))
    for path in recipe.arms if moved else ():
        parts, why = robot_model.found(path, scene.episode)
        if parts:
            return replace(scene, robot_parts=parts), tuple(said)
        said += [why] if why else []
    return scene, tuple(said)


def _built(episode: Episode, recipe: Recipe, plan: planning.Plan) -> tuple[Scene, planning.Plan]:
    """The recorded scene; where instances are asked for, that of a video by structure from motion if that succeeds."""
    plan = _with_shadows(episode, plan)
    if not plan.bodies:
        return build(episode, with_bodies=False), plan
    found = found_instances(episode, recipe.arms, recipe.models, recipe.video, phrases(recipe))
    video = found.back.describe() if isinstance(found.back, VideoScene) else plan.video
    scene, wrong = settled.settle(found.scene(), recipe.roles)
    warned = (*plan.warnings, *found.notes, *wrong)
    return scene, replace(plan, video=video, assumed=found.told, warnings=warned)


def _with_shadows(episode: Episode, plan: planning.Plan) -> planning.Plan:
    """The plan that tracks what casts moving shadows, where lamps are asked for and shadows move."""
    if plan.bodies or not plan.lamps:
        return plan
    return replace(plan, bodies=rig.shadows_wander(episode))


def found_instances(
    episode: Episode,
    files: Sequence[Path],
    models: Models = Models(),  # noqa: B008 - it is frozen
    video: VideoSettings | None = None,
    phrases: Sequence[str] = (),
) -> FoundInstances:
    """The episode's instances, a video of a moving camera tried first; `files` are those of arms.

    Models are asked for `phrases`, and for what the instruction names where nobody recorded masks. What hangs on no
    file is found once for all edits that are tried.
    """
    masked = all(view.ids for view in episode.views.values())
    words = (*phrases, *(() if masked else nouns.things(episode.descriptions)))
    if files or models != Models():
        found = _found(episode, files, models, video, tuple(dict.fromkeys(words)))
    else:
        found = _found_once(episode, (video or VideoSettings()).model_dump_json())
    more = nouns.by_instruction(episode.descriptions, found.names, found.roles)
    return replace(
        found,
        beliefs={**found.beliefs, **more},
        roles={**found.roles, **roles.held(more)},
        told=(*found.told, *_better(episode, models)),
    )


@memo.once
def _found_once(episode: Episode, video: str) -> FoundInstances:
    """The same without models and files; `video` are its settings in JSON."""
    return _found(episode, (), Models(), VideoSettings.model_validate_json(video), ())


def _found(
    episode: Episode,
    files: Sequence[Path],
    models: Models,
    video: VideoSettings | None,
    words: tuple[str, ...],
) -> FoundInstances:
    progress = told_of(episode.key)
    tries = models.depth is None and not models.finds
    finder = reconstruct.ByVideo(video, progress, models.poses) if tries else None
    known = by_models.AskedModels(models, words, lambda share: progress(share, "asking models"))
    return find(episode, sources(partial(arms.for_robot, files, episode.robot), known, finder))


def phrases(recipe: Recipe) -> list[str]:
    """The words of a recipe's targets that a model can be asked for."""
    every = (target for operator in operators(recipe) for target in planning.targets(operator))
    return [words for target in every for words in targets.phrases(target)]


def _better(episode: Episode, models: Models) -> tuple[str, ...]:
    """What a model would add where instances are told by color alone."""
    if models.finds or not rgb_episode.lacking(episode):
        return ()
    return (
        "without a model instances are patches of color: --models text=NAME (a detector) and instances=NAME (a "
        "segmenter) tell things by words",
    )


def told_of(key: str) -> reconstruct.Progress:
    """Tells how far a video is, in percent: minutes pass."""
    return lambda share, what: progress.told(key, what, round(100 * share), 100)


def planned(episode: Episode, recipe: Recipe, tier: int) -> planning.Plan:
    """The plan, with no more work than it takes: images are looked at only where the recipe asks for an accuracy, and
    where nothing but images tells what there is; then what cannot be done is refused as it would be later, and what
    copies would leave out is a warning."""
    made = planning.make(operators(recipe), episode, tier)
    alone = made.bodies and rgb_episode.lacking(episode)
    if recipe.accuracy is None and not alone:
        return made
    scene, made = build_and_plan(episode, recipe, tier)
    if alone:
        made = replace(made, warnings=(*made.warnings, *ground(scene, recipe)))
    return made


def _moved(scene: Scene, recipe: Recipe) -> Iterator[tuple[str, Camera]]:
    """Where one draw of the recipe's camera edits puts cameras."""
    edited = scene
    for operator in operators(recipe):
        if operator.effect & Effect.CAMERA:
            with suppress(TargetError):  # the episode has no such camera: copies leave the edit out
                edit = operator.sample(scene, np.random.default_rng(0))
                edited = operator.apply(edited, json.loads(json.dumps(edit)))
    for name, camera in edited.cameras.items():
        if camera is not scene.cameras[name]:
            yield name, camera


def prepare(episode: Episode, plan: planning.Plan, scenes: Path | None = None) -> Scene:
    """The recorded scene with what the plan asks for, Gaussians among it: from the store `scenes`, or fitted."""
    scene = build(episode, with_bodies=_with_shadows(episode, plan).bodies)
    scene = _with_gaussians(scene, plan, scenes)[0] if plan.gaussians else scene
    return _with_parts(scene, plan)[0]


def _donor_scene(donor: Callable[[], Episode] | None, recipe: Recipe) -> Scene | None:
    if donor is None:
        return None
    episode = donor()
    return build(episode, with_bodies=True, arms=arms.for_robot(recipe.arms, episode.robot))


def _with_gaussians(
    scene: Scene, plan: planning.Plan, scenes: Path | None, donor_scene: Scene | None = None
) -> tuple[Scene, Mapping[str, Any]]:
    if isinstance(scene.back, VideoScene):
        from rpaug.gaussians import fit_video  # only here: it brings torch and the rasteriser

        own = fit_video.SplatSettings(width=scene.back.fit_width)
        return fit_video.kept(scene, scene.back, scenes, fit_video.on(own, plan.device))
    from rpaug.gaussians import cached, descent, fit4  # only here: they bring the rasteriser

    def share(done: float) -> None:
        progress.told(scene.episode.key, "fitting Gaussians, percent", round(100 * done), 100)

    usual = descent.on(descent.FitSettings(), plan.device)
    if plan.tier >= 4:
        four = fit4.FourSettings(backend=usual.backend)
        fitted = partial(cached.fitted_in_time, settings=cached.Both(usual, four))
    else:
        fitted = partial(cached.fitted, settings=usual, progress=share)
    return fit_static_rgb.fitted(scene, lambda one: fitted(one, scenes, donor=donor_scene))


def donors(adapter: Adapter, root: Path, keys: Sequence[str]) -> dict[str, str]:
    """For each of these episodes that may borrow static Gaussians the one that lends them.

    That is the first episode of its place in its split of the whole dataset, in natural order: whatever was selected
    or fitted before, and in whatever order, it is the same. The first itself, and what cannot be read, is left out.
    """
    from rpaug.gaussians import sharing  # only here: it brings torch and the rasteriser

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
        first_key = first.setdefault((splits.kind(key), where), key)
        if first_key != key and key in wanted:
            found[key] = first_key
    return found


def _with_parts(scene: Scene, plan: planning.Plan) -> tuple[Scene, planning.Plan]:
    """The scene in which targets finer than the masks have instance ids; the plan warns of missing ones."""
    if not plan.parts:
        return scene, plan
    from rpaug.gaussians import parts  # only here: it brings torch and the rasteriser

    lacking: list[str] = []
    for part in plan.parts:
        try:
            scene = parts.given(scene, [part])
        except TargetError as error:
            lacking.append(str(error))
    return scene, replace(plan, warnings=(*plan.warnings, *lacking))
