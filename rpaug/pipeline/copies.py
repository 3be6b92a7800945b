"""One copy of an episode in memory: drawn from its recipe, judged, and drawn again while it has a fault.

`draw_copy` is the only place where copies are drawn: writers, training datasets, replays and benches call it.
"""

import json
import time
from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from rpaug import instruct
from rpaug.compose import views
from rpaug.core import devices, progress
from rpaug.core.errors import Missing, TargetError, Unsupported
from rpaug.core.interfaces import Operator, Painted
from rpaug.core.sampling import spans
from rpaug.core.types import Episode, Scene
from rpaug.physics import verdict
from rpaug.pipeline import gates as gating
from rpaug.pipeline import plan as planning
from rpaug.pipeline import report, self_check
from rpaug.pipeline.recipe import Instructions, Option, Recipe, option
from rpaug.scene.instances.jumps import jumps
from rpaug.scene.recorded.surfels import Surfels
from rpaug.scene.targets import survey

WORDS = 2**31  # the random stream of a copy's words: no step's
MOST_STEPS = 128  # that a memory keeps: some ten draws of a long recipe
ORIGINAL = 0
"""The copy number of an untouched episode; augmented copies count from 1."""


@dataclass(frozen=True)
class PreparedEpisode:
    """What all copies of one episode share.

    `surfels` gives those of the recorded scene; without it each copy builds its own. Copies whose recorded actions no
    longer hold are faulty unless `keep_invalid`. `memory` keeps what steps came to, for copies that are drawn again.
    """

    scene: Scene
    plan: planning.Plan
    recipe: Recipe
    surfels: Callable[[], Surfels] | None = None
    keep_invalid: bool = False
    device: str = "cpu"
    memory: "StepMemory | None" = None


@dataclass(frozen=True)
class Draw:
    """What one step of the recipe came to: an operator with its edit, or nothing.

    `left_out` says why an operator that was drawn has no edit: the episode lacks what it would be made of.
    `painted_over` says of which earlier steps it takes the place, in sentences.
    """

    step: int
    option: Option | None
    edit: dict[str, Any] | None
    left_out: str = ""
    painted_over: tuple[str, ...] = ()

    @property
    def painted(self) -> frozenset[int]:
        """Instance ids that it paints in the place of earlier paint."""
        if self.option is None or self.edit is None:
            return frozenset()
        said = self.option.operator.says(self.edit)
        anew = [one.instance_ids for one in said if isinstance(one, Painted) and one.anew]
        return frozenset().union(*anew)

    @property
    def puts(self) -> bool:
        """Whether it puts things where none were."""
        return self.option is not None and self.edit is not None and self.option.operator.puts

    def after(self, earlier: Sequence["Draw"]) -> "Draw":
        """The same, with what it says of the draws before it."""
        hidden = (one for one in earlier if one.painted & self.painted)
        words = (f"{self} takes the place of {one} on what both paint" for one in hidden)
        return replace(self, painted_over=tuple(words))

    def __str__(self) -> str:
        assert self.option is not None
        of = ", ".join(map(str, planning.targets(self.option.operator)))
        return f"edits.{self.step} ({self.option.name}{f' of {of}' if of else ''})"

    def describe(self) -> dict[str, Any]:
        """Plain values, enough to apply the edit again."""
        if self.option is None:
            return {"step": self.step, "skipped": True}
        came_to: dict[str, Any] = (
            {"left_out": self.left_out} if self.left_out else {"edit": self.edit}
        )
        if short := self._short():
            came_to["fell_short"] = short
        if self.painted_over:
            came_to["painted_over"] = list(self.painted_over)
        chosen = {"op": self.option.name, "fields": self.option.fields}
        return {"step": self.step, **chosen, **came_to}

    def _short(self) -> list[str]:
        """In sentences, what of the edit's wish could not be had."""
        if self.option is None or self.edit is None:
            return []
        found = self.option.operator.falls_short(self.edit)
        return [
            f"{missed} of {asked} {words}" for words, (missed, asked) in found.items() if missed
        ]


@dataclass(frozen=True)
class Made:
    """One copy; its images are rendered when they are asked for, and `tally` counts what changes meanwhile.

    `attempt` numbers its draws from 0; `seconds` went into this draw and those before it. `known` are the faults that
    show before anything is rendered: an instruction that cannot be kept true, actions that no longer hold, roles that
    the recording refutes, an edit left out though the recipe says `on_missing: skip_copy`. `faults` say why the copy is
    rejected; a copy without any is kept.
    """

    episode: Episode
    scene: Scene
    draws: tuple[Draw, ...]
    plan: planning.Plan
    tally: report.Tally
    untrue: str = ""
    left: tuple[str, ...] = ()
    gates: gating.Gates | None = None
    attempt: int = 0
    seconds: float = 0.0
    known: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()

    @property
    def recorded(self) -> Episode:
        """The episode as its source has it: `episode` is what the scene shows."""
        back = self.scene.back
        return back(self.episode, views.everywhere(self.scene)) if back else self.episode

    @property
    def lacking(self) -> tuple[str, ...]:
        """What is not edited, or may be wrongly, in frames of a video: where its camera was not found, or a role is
        doubted."""
        missing = getattr(self.scene.back, "missing", ())
        edits = [one.option for one in self.draws if one.edit is not None and one.option]
        placed = dict.fromkeys(one.name for one in edits if not one.operator.everywhere)
        named = [target.role for one in edits for target in planning.targets(one.operator)]
        named += ["things"] if any(one.puts for one in self.draws) else []
        known = getattr(self.scene.back, "doubts", {})
        doubts = tuple(doubt for role in dict.fromkeys(named) for doubt in known.get(role, ()))
        if not missing or not placed:
            return doubts
        total = f"{len(missing)} of {len(missing) + self.episode.length} frames"
        lacking = f"({spans(missing)}) have no camera pose and go without {', '.join(placed)}"
        lacking += ": there these vanish, even in full view"
        return (f"{total} {lacking}", *doubts)

    @property
    def uneven(self) -> tuple[str, ...]:
        """Where what an edit paints has grown or shrunk at once, where instances were worked out. Ask once all images
        were rendered."""
        times: Sequence[int] = getattr(self.scene.back, "times", range(self.episode.length))
        said = list[str]()
        for (camera, ids), areas in self.tally.areas.items():
            total = self.tally.total[camera, next(iter(areas))]
            steps, found = jumps({times[t]: pixels for t, pixels in areas.items()}, total)
            if not found:
                continue
            named, worst = f"{camera}: {', '.join(map(str, sorted(ids)))}", found[0]
            where = (
                f"between frames {worst.t} and {worst.after}, from {worst.before_pixels / total:.1%} to"
                f" {worst.after_pixels / total:.1%} of the pixels"
            )
            said.append(
                f"{named} is seen to jump {where}: in one of them something else may be painted, or it left out"
                if len(found) == 1
                else f"{named} is seen to jump in {len(found)} of {steps} steps, most {where}: painted, it flickers"
            )
        return tuple(said)

    @property
    def repainted(self) -> dict[int, str]:
        """The recorded color, as a word, of each instance that an edit paints."""
        edits = [one.edit for one in self.draws if one.edit is not None]
        ids = {one["handle"] for edit in edits for one in edit.get("surfaces", ())}
        return survey.color_names(self.scene.episode, ids) if ids else {}

    @cached_property
    def figures(self) -> gating.Figures:
        """What the gates measure, none without gates. Ask once all images were rendered."""
        if self.gates is None:
            return gating.Figures()
        outside = sum(self.tally.outside.values())
        return gating.measure(
            self.scene,
            self.episode,
            self.plan.representations,
            outside,
            self.tally.holes,
            self.tally.moving,
            self.gates.limits,
        )

    def judged(self) -> tuple[str, ...]:
        """All faults, those that the gates find among them. Ask once all images were rendered."""
        found = self.gates.faults(self.figures) if self.gates else []
        return (*found, *self.known)


Words = Callable[[Scene, Sequence[tuple[Operator, Any]]], instruct.Followed]
Judge = Callable[[Made], Sequence[str]]
"""Is handed a draw without known faults and returns the faults that its images show. A writer's judge writes the copy
as it judges it, so that every image is rendered once."""


def _go_on() -> None:
    """Let every frame be made."""


def rendered(made: Made, before: Callable[[], None] = _go_on) -> Sequence[str]:
    """The judge of copies that stay in memory: renders every edited image if there are limits to judge them by.

    `before` is called before each frame, and may raise to end it.
    """
    if made.gates is None or not made.gates.limits:
        return ()
    for name, view in made.episode.views.items():
        if view.rgb is not made.scene.episode.views[name].rgb:
            for t in range(made.episode.length):
                before()
                view.rgb(t)
    return made.judged()


@dataclass
class StepMemory:
    """What the latest steps came to. Under recipes that differ in one step, those before it need no second draw, and
    what was found of their scenes is found again."""

    _held: OrderedDict[Hashable, tuple[Scene, tuple[Scene, Draw]]] = field(
        default_factory=OrderedDict
    )

    def take(
        self, scene: Scene, key: Hashable, drawn: Callable[[], tuple[Scene, Draw]]
    ) -> tuple[Scene, Draw]:
        """What the step of that key came to in this very scene."""
        key = id(scene), key  # no other scene has this id: the one is kept
        if key not in self._held:
            self._held[key] = scene, drawn()
        self._held.move_to_end(key)
        while len(self._held) > MOST_STEPS:
            self._held.popitem(last=False)
        return self._held[key][1]


@dataclass(frozen=True)
class Known:
    """A draw that was judged before: its number and, where a report has them, its described draws and its words."""

    attempt: int = 0
    draws: Sequence[Mapping[str, Any]] | None = None
    words: Sequence[str] | None = None


def draw_copy(
    prepared: PreparedEpisode, copy: int, judge: Judge = rendered, known: Known | None = None
) -> Made:
    """Copy number `copy`: the first of its draws without a fault, else the last one, with its faults.

    It is drawn as often as its gates allow, once without gates; draws that came before are not judged twice. A `known`
    draw is made again, whatever it came to. Raises Missing, BadRecipe.
    """
    if copy == ORIGINAL:
        prepared = replace(
            prepared,
            recipe=replace(prepared.recipe, steps=(), gates=None, instructions=Instructions()),
        )
    scene, recipe = prepared.scene, prepared.recipe
    if known is not None:
        if known.draws is not None:
            return _made(prepared, *redraw(scene, known.draws), copy, known)
        return _made(prepared, *draw(scene, recipe, copy, known.attempt), copy, known)
    judged: list[tuple[Draw, ...]] = []
    seconds = 0.0
    for attempt in range(recipe.gates.tries if recipe.gates else 1):
        start = time.perf_counter()
        edited, draws = draw(scene, recipe, copy, attempt, prepared.memory)
        seconds += time.perf_counter() - start
        if draws in judged:
            continue
        judged.append(draws)
        made = replace(_made(prepared, edited, draws, copy, Known(attempt)), seconds=seconds)
        faults = made.known or tuple(judge(made))
        if not faults:
            return made
    return replace(made, faults=faults)


def _made(
    prepared: PreparedEpisode, scene: Scene, draws: tuple[Draw, ...], copy: int, known_draw: Known
) -> Made:
    recipe, gates = prepared.recipe, prepared.recipe.gates
    rng = recipe.generator(scene.episode.key, copy, WORDS)

    def words(scene: Scene, edits: Sequence[tuple[Operator, Any]]) -> instruct.Followed:
        if known_draw.words is not None:
            return instruct.Followed(tuple(known_draw.words))
        return instruct.followed(scene, edits, recipe.wording, rng)

    counted = gates is not None and gates.outside is not None
    made = render(scene, draws, prepared.plan, counted, prepared.surfels, words, prepared.device)
    known = [made.untrue] if made.untrue else []
    known += [] if prepared.keep_invalid else verdict.invalid(scene.simulated)
    if prepared.recipe.self_check:
        done = [(one.option, one.edit) for one in draws if one.option and one.edit is not None]
        known += self_check.faults(prepared.scene, scene, done)
    if prepared.recipe.on_missing == "skip_copy":
        known += [
            f"{draw.option.name}: {draw.left_out}"
            for draw in draws
            if draw.option and draw.left_out
        ]
    return replace(made, gates=gates, attempt=known_draw.attempt, known=tuple(known))


def draw(
    scene: Scene, recipe: Recipe, copy: int, attempt: int = 0, memory: StepMemory | None = None
) -> tuple[Scene, tuple[Draw, ...]]:
    """The scene after this copy's edits, and what was drawn.

    An edit that the scene has nothing for is left out: each step draws from a stream of its own, so that the others
    are drawn as they would be with it. Raises Missing where the recipe says `on_missing: fail`.
    """
    draws: list[Draw] = []
    for number, step in enumerate(recipe.steps):
        drawn = partial(_drawn, scene, recipe, number, copy, attempt)
        if memory is None:
            scene, one = drawn()
        else:
            key = (recipe.seed, recipe.on_missing, number, copy, attempt, step.describe())
            scene, one = memory.take(scene, key, drawn)
        draws.append(one.after(draws))
    return scene, tuple(draws)


def _drawn(
    scene: Scene, recipe: Recipe, number: int, copy: int, attempt: int
) -> tuple[Scene, Draw]:
    """The scene after one step, and what was drawn. Raises Missing."""
    step, key = recipe.steps[number], scene.episode.key
    place = number if step.stream is None else step.stream
    first, rng = (recipe.generator(key, copy, place, n) for n in (0, attempt))
    # What is drawn again is how an edit is done, not whether: else what often fails is done less than asked.
    chance, _ = first.random(), rng.random()
    chosen = step.draw(chance, rng)
    if chosen is None:
        return scene, Draw(number, None, None)
    if step.stream is not None:
        rng = recipe.generator(key, copy, number, attempt)
    try:
        planning.check(chosen.operator, scene)
        edit = json.loads(json.dumps(chosen.operator.sample(scene, rng)))
        edited = chosen.operator.apply(scene, edit)
        planning.check_shown(chosen.operator, scene, edited)
    except (TargetError, Unsupported) as error:
        if recipe.on_missing == "fail":
            raise Missing(f"{key}: {chosen.name}: {error}") from None
        return scene, Draw(number, chosen, None, str(error))
    return edited, Draw(number, chosen, edit)


def redraw(scene: Scene, described: Sequence[Mapping[str, Any]]) -> tuple[Scene, tuple[Draw, ...]]:
    """The scene after the edits of a report: a replay, with nothing random in it. Raises BadRecipe."""
    draws: list[Draw] = []
    for entry in described:
        chosen = None if entry.get("skipped") else option(entry["op"], entry["fields"])
        edit = entry.get("edit")
        if chosen and edit is not None:
            scene = chosen.operator.apply(scene, edit)
        draws.append(Draw(entry["step"], chosen, edit, entry.get("left_out", "")).after(draws))
    return scene, tuple(draws)


def render(
    scene: Scene,
    draws: tuple[Draw, ...],
    plan: planning.Plan,
    counted: bool = False,
    kept: Callable[[], Surfels] | None = None,
    words: Words = instruct.followed,
    device: str = "cpu",
) -> Made:
    """The edited episode, every image still to be rendered when a writer or a trainer asks for it.

    `counted` counts changed pixels that no edit reaches, for the gates, as frames pass by. `kept` gives the recorded
    scene's surfels, which all copies of an episode share. `words` gives the instructions after the edits.
    """
    settled = planning.settle(plan, scene)
    untrue = ""
    left: tuple[str, ...] = ()
    edits = [
        (one.option.operator, one.edit) for one in draws if one.option and one.edit is not None
    ]
    try:
        followed = words(scene, edits)
        scene, left = replace(scene, descriptions=followed.texts), followed.left
    except instruct.Untrue as error:
        untrue = str(error)
    shown, settled = (scene, settled) if untrue else _refined(scene, settled)
    new = [body.instance_ids for body in scene.bodies if body.mesh is not None or body.copy_of]
    tally = report.Tally(list(scene.episode.views), frozenset().union(*new))
    painted = {one.instance_ids for one in scene.appearance if one.instance_ids}
    # Frames to be made: a view that asked its own episode for them would outlive its copy, in a cycle.
    every: list[int] = []

    def watch(frame: views.RenderedFrame) -> None:
        camera, t = frame.camera, frame.t
        tally.frame(camera, t, frame.before, frame.image, frame.seconds)
        progress.told(scene.episode.key, progress.FRAMES, len(tally.total), sum(every))
        if len(tally.total) == sum(every):
            progress.told(scene.episode.key, progress.WRITING)
        shows = scene.episode.views[camera]
        if painted and shows.inferred and shows.ids is not None:
            for some in painted:
                tally.area(camera, t, some, int(np.isin(shows.ids(t), list(some)).sum()))
        if frame.ids is not None:
            tally.mask(camera, t, frame.ids)
        if frame.hole is not None:
            tally.hole(camera, t, frame.hole)
            if frame.moving is not None:
                counts = int((frame.hole & frame.moving).sum()), int(frame.moving.sum())
                tally.moving[camera, t] = counts
        elif counted:
            ids = scene.episode.views[camera].ids
            tally.outside[camera, t] = gating.beyond(
                scene, frame.before, frame.image, ids(t) if ids else None
            )

    episode = views.edited(shown, settled.representations, watch, settled.blended, kept, device)
    recorded = scene.episode.views
    edited = sum(view.rgb is not recorded[name].rgb for name, view in episode.views.items())
    every.append(edited * episode.length)
    return Made(episode, scene, draws, settled, tally, untrue, left)


def _refined(scene: Scene, plan: planning.Plan) -> tuple[Scene, planning.Plan]:
    """The scene with its edited Gaussians tuned together, if that is wanted and Gaussians show every camera."""
    if not plan.refine:
        return scene, plan
    if scene.gaussians is None or min(plan.representations.values()) < 3:
        why = "Gaussians do not show every camera: --tier 3 makes them"
        return scene, replace(plan, refined={"kept": False, "skipped": why})
    from rpaug.compose import joint  # only here: it brings torch and the rasteriser

    asked = joint.RefineSettings(steps=plan.refine, backend=devices.backend(plan.device))
    tuned, facts = joint.refined(scene, asked)
    return tuned, replace(plan, refined=facts)
