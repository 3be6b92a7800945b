"""One episode through all stages: read, build, draw, apply, render, write. Each takes a value and returns one."""

import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from rpaug import instruct
from rpaug.compose import views
from rpaug.core import registry
from rpaug.core.files import REJECTED
from rpaug.core.interfaces import Adapter
from rpaug.core.types import Episode, Scene
from rpaug.physics import simulate
from rpaug.pipeline import gates as gating
from rpaug.pipeline import plan as planning
from rpaug.pipeline import report
from rpaug.pipeline.prepare import ground, prepare_scene
from rpaug.pipeline.recipe import Option, Recipe, option
from rpaug.pipeline.recipe import build as build_recipe
from rpaug.scene.recorded import surfels


@dataclass(frozen=True)
class Draw:
    """What one step of the recipe came to: an operator with its edit, or nothing."""

    step: int
    option: Option | None
    edit: dict[str, Any] | None

    def describe(self) -> dict[str, Any]:
        """Plain values, enough to apply the edit again."""
        if self.option is None:
            return {"step": self.step, "skipped": True}
        return {
            "step": self.step,
            "op": self.option.name,
            "fields": self.option.fields,
            "edit": self.edit,
        }


@dataclass(frozen=True)
class Made:
    """One augmented copy before it is written; `tally` fills as its frames are asked for.

    `untrue` says why its instruction cannot be kept true, and is empty where it is: such a copy is rejected.
    """

    episode: Episode
    scene: Scene
    draws: tuple[Draw, ...]
    plan: planning.Plan
    tally: report.Tally
    untrue: str = ""

    @property
    def recorded(self) -> Episode:
        """The episode as its source has it: `episode` is what the scene shows."""
        return self.scene.back(self.episode) if self.scene.back else self.episode


class Rejected(Exception):
    """A copy that exceeds a limit of its gates, told once all its frames are rendered and before it appears."""


def draw(
    scene: Scene, recipe: Recipe, copy: int, attempt: int = 0
) -> tuple[Scene, tuple[Draw, ...]]:
    """The scene after this copy's edits, and what was drawn. Raises TargetError."""
    draws = []
    for number, step in enumerate(recipe.steps):
        first, rng = (recipe.generator(scene.episode.key, copy, number, n) for n in (0, attempt))
        # What is drawn again is how an edit is done, not whether: else what often fails is done less than asked.
        chance, _ = first.random(), rng.random()
        chosen = step.draw(chance, rng)
        edit = None
        if chosen:
            edit = json.loads(json.dumps(chosen.operator.sample(scene, rng)))
            scene = chosen.operator.apply(scene, edit)
        draws.append(Draw(number, chosen, edit))
    return scene, tuple(draws)


def redraw(scene: Scene, described: Sequence[dict[str, Any]]) -> tuple[Scene, tuple[Draw, ...]]:
    """The scene after the edits of a report: a replay, with nothing random in it. Raises BadRecipe."""
    draws = []
    for entry in described:
        chosen = None if entry.get("skipped") else option(entry["op"], entry["fields"])
        edit = entry.get("edit")
        if chosen and edit is not None:
            scene = chosen.operator.apply(scene, edit)
        draws.append(Draw(entry["step"], chosen, edit))
    return scene, tuple(draws)


def render(
    scene: Scene,
    draws: tuple[Draw, ...],
    plan: planning.Plan,
    counted: bool = False,
    kept: Callable[[], surfels.Surfels] | None = None,
) -> Made:
    """The edited episode, every image still to be rendered when a writer or a trainer asks for it.

    `counted` counts changed pixels that no edit reaches, for the gates, as frames pass by. `kept` gives the recorded
    scene's surfels, which all copies of an episode share.
    """
    settled = planning.settle(plan, scene)
    untrue = ""
    edits = [
        (one.option.operator, one.edit) for one in draws if one.option and one.edit is not None
    ]
    try:
        words = instruct.followed(scene, edits)
        scene = replace(scene, descriptions=words)
    except instruct.Untrue as error:
        untrue = str(error)
    shown, settled = (scene, settled) if untrue else _refined(scene, settled)
    tally = report.Tally(list(scene.episode.views))

    def watch(frame: views.RenderedFrame) -> None:
        camera, t = frame.camera, frame.t
        tally.frame(camera, t, frame.before, frame.image, frame.seconds)
        if frame.hole is not None:
            tally.hole(camera, t, frame.hole)
        elif counted:
            ids = scene.episode.views[camera].ids
            tally.outside[camera, t] = gating.beyond(
                scene, frame.before, frame.image, ids(t) if ids else None
            )

    episode = views.edited(shown, settled.representations, watch, settled.blended, kept)
    return Made(episode, scene, draws, settled, tally, untrue)


def _refined(scene: Scene, plan: planning.Plan) -> tuple[Scene, planning.Plan]:
    """The scene with its edited Gaussians tuned together, if that is wanted and Gaussians show every camera."""
    if not plan.refine:
        return scene, plan
    if scene.gaussians is None or min(plan.representations.values()) < 3:
        why = "Gaussians do not show every camera: --tier 3 makes them"
        return scene, replace(plan, refined={"kept": False, "skipped": why})
    from rpaug.compose import joint  # only here: it brings torch and the rasteriser

    tuned, facts = joint.refined(scene, joint.RefineSettings(steps=plan.refine))
    return tuned, replace(plan, refined=facts)


ORIGINAL = 0
"""The copy number of an untouched episode; augmented copies count from 1."""


@dataclass(frozen=True)
class Job:
    """One source episode and where its copies go, in plain values that cross process borders."""

    adapter: str
    source: Path
    key: str
    target: Path
    copies: tuple[tuple[int, str], ...]  # copy number, key in the target
    recipe: dict[str, Any]
    tier: int
    scenes: Path | None = None  # a store of fitted scenes
    donor: str | None = None  # key of the episode whose static Gaussians are borrowed
    keep_invalid: bool = False  # copies whose recorded actions no longer hold


def augment(job: Job) -> Iterator[dict[str, Any]]:
    """Read one episode, write its copies one by one, yield their reports. Raises RpaugError.

    All edits are tried before the first copy is written: whether a target is there does not depend on the draw. A job
    without copies fits what is to lend Gaussians to others, if the plan has any.
    """
    adapter, recipe = registry.adapter(job.adapter), build_recipe(job.recipe)
    watch = report.Stopwatch()
    with watch("read"):
        episode = adapter.read(job.source, job.key)
    scene, plan = prepare_scene(episode, recipe, job.tier, job.scenes, watch, _donor(adapter, job))
    if not job.copies:
        return
    with watch("ground"):
        ground(scene, recipe)
    kept = cache(lambda: surfels.recorded(scene))
    shared = {stage: seconds / len(job.copies) for stage, seconds in watch.seconds.items()}
    for copy, key in job.copies:
        place = CopyPlace(copy, job.target, key)
        if copy == ORIGINAL:
            write(adapter, render(scene, (), plan, kept=kept), job, place, shared)
        else:
            place = _augmented(adapter, scene, recipe, plan, job, place, shared, kept)
        yield json.loads((place.root / key / report.NAME).read_bytes())


def _donor(adapter: Adapter, job: Job) -> Callable[[], Episode] | None:
    return partial(adapter.read, job.source, job.donor) if job.donor else None


def _augmented(
    adapter: Adapter,
    scene: Scene,
    recipe: Recipe,
    plan: planning.Plan,
    job: Job,
    place: "CopyPlace",
    shared: dict[str, float],
    kept: Callable[[], surfels.Surfels],
) -> "CopyPlace":
    """Write one copy and say where.

    While it fails its gates, its instruction cannot be kept true or its actions no longer hold, it is drawn again; a
    draw that failed before is not tried twice. The last draw to fail goes to the folder of the rejected.
    """
    watch, gates = report.Stopwatch(), recipe.gates
    failed: dict[int, Made] = {}
    for attempt in range(gates.tries if gates else 1):
        with watch("draw"):
            edited, draws = draw(scene, recipe, place.copy, attempt)
        if any(draws == one.draws for one in failed.values()):
            continue
        made = render(edited, draws, plan, gates is not None, kept)
        if made.untrue or not (edited.actions_valid or job.keep_invalid):
            failed[attempt] = made  # known before anything is rendered
            continue
        trial = Trial(gates, attempt, True, job.keep_invalid) if gates else None
        try:
            write(adapter, made, job, place, shared | watch.seconds, trial)
        except Rejected:
            failed[attempt] = made
        else:
            return place
    attempt, made = failed.popitem()
    place = replace(place, root=job.target / REJECTED)
    trial = Trial(gates, attempt, False, job.keep_invalid)
    write(adapter, made, job, place, shared | watch.seconds, trial)
    return place


@dataclass(frozen=True)
class CopyPlace:
    """Which copy is written, and where: as `key` in the dataset at `root`."""

    copy: int
    root: Path
    key: str


@dataclass(frozen=True)
class Trial:
    """How a copy is held to its gates, if it has any: `attempt` counts its draws from 0; not `strict`, it is written
    all the same. An instruction that is not true is a fault, and so are actions that no longer hold, unless they are to
    be kept (`keep_invalid`)."""

    gates: gating.Gates | None
    attempt: int
    strict: bool
    keep_invalid: bool = False

    def judge(self, made: Made) -> dict[str, Any]:
        """What the report says of it. Raises Rejected."""
        known = [made.untrue] if made.untrue else []
        known += [] if self.keep_invalid else simulate.invalid(made.scene.simulated)
        if self.gates is None:
            return gating.described(gating.Figures(), known, self.attempt)
        outside = sum(made.tally.outside.values())
        figures = gating.measure(
            made.scene, made.episode, made.plan.representations, outside, made.tally.holes
        )
        faults = [*self.gates.faults(figures), *known]
        if faults and self.strict:
            raise Rejected
        return gating.described(figures, faults, self.attempt)


def write(
    adapter: Adapter,
    made: Made,
    job: Job,
    place: CopyPlace,
    before: dict[str, float],
    trial: Trial | None = None,
) -> None:
    """Write one copy with its report; frames are rendered as the adapter asks for them. Raises Rejected.

    `before` are the seconds of the stages before this one.
    """
    start = time.perf_counter()

    def side() -> dict[str, bytes]:
        judged = trial.judge(made) if trial else None
        spent = {"render": made.tally.seconds, "write": time.perf_counter() - start}
        return report.side_files(
            source=job.key,
            copy=place.copy,
            synthetic=place.copy != ORIGINAL,
            recipe=job.recipe,
            draws=[draw.describe() for draw in made.draws],
            plan=made.plan.describe(),
            tally=made.tally,
            surfels=drawn(made),
            gaussians=len(made.scene.gaussians or ()),
            gates=judged,
            words=_words(made),
            physics=simulate.described(made.scene.simulated),
            seconds=before | spent,
        )

    adapter.write(made.recorded, place.root, place.key, side)


def _words(made: Made) -> dict[str, Any] | None:
    """The instructions before and after, where an edit made them other ones."""
    before, after = made.scene.episode.descriptions, made.episode.descriptions
    return None if before == after else {"recorded": list(before), "written": list(after)}


def drawn(made: Made) -> int:
    """Recorded pixels that stand for surfaces in this copy."""
    return sum(
        view.camera.width * view.camera.height * made.episode.length
        for name, view in made.episode.views.items()
        if made.plan.representations[name] < 3
    )


def replay(
    adapter: Adapter, source: Path, described: dict[str, Any], target: Path, key: str
) -> None:
    """Write again the episode that a report describes, from the recorded one. Raises RpaugError."""
    recipe = build_recipe(described["recipe"])
    job = Job(
        adapter.name,
        source,
        described["source"],
        target,
        ((described["copy"], key),),
        described["recipe"],
        described["plan"]["tier"],
        donor=described["plan"].get("fit", {}).get("founder"),
    )
    episode = adapter.read(source, job.key)
    scene, plan = prepare_scene(episode, recipe, job.tier, donor=_donor(adapter, job))
    scene, draws = redraw(scene, described["draws"])
    trial = None
    if judged := described.get("gates"):
        kept = not any(fault.startswith(simulate.INVALID) for fault in judged["faults"])
        trial = Trial(recipe.gates, judged["attempt"], False, kept)
    made = render(scene, draws, plan, counted=recipe.gates is not None)
    write(adapter, made, job, CopyPlace(described["copy"], target, key), {}, trial)
