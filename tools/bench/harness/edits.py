"""Every factor's operator, and the baselines, against the factor truly changed on the twin."""

import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool
from pydantic import TypeAdapter

from rpaug import twin
from rpaug.core import registry
from rpaug.core.errors import RpaugError, Unsupported
from rpaug.core.types import CameraView, Episode
from rpaug.pipeline import plan, prepare
from rpaug.pipeline.copies import Known, PreparedEpisode, draw_copy
from rpaug.pipeline.recipe import Recipe
from tools.bench.harness import baselines, perceptual
from tools.bench.harness.cases import CASES, ESTIMATED, Ask, FactorCase
from tools.bench.harness.scores import HIGHER, Scores, measure

GAUSSIANS = "Gaussian render"
NONE, LAB, JITTER = "no edit", "CIELAB in the mask", "color jitter"
LAB_ESTIMATED = "CIELAB in the mask, estimated"
SINGLE = frozenset(case.baseline[0] for case in CASES.values() if case.baseline is not None)
BASELINES = SINGLE | {GAUSSIANS, NONE, LAB, LAB_ESTIMATED, JITTER}
TOLD_MORE = frozenset({GAUSSIANS, LAB})  # than an operator that is left to estimate

Light = Literal["plain", "shadows", "highlights", "both"]
"""What the lamps do beside lighting matte surfaces: cast shadows, be mirrored."""


@dataclass(frozen=True, kw_only=True)
class EditSetting:
    """What is recorded: seeds take `tasks` in turn, and where a factor has several targets those too."""

    factors: tuple[str, ...] = tuple(CASES)
    tasks: tuple[str, ...] = tuple(twin.TASKS)
    seeds: int = 10
    first_seed: int = 0
    frames: int = 17
    size: int = 128
    antialias: bool = False
    light: Light = "plain"
    lamps: int = len(twin.RIG)
    finish: twin.Finish | None = None  # of what the task moves
    gaussians: bool = False  # a fit of its own for each seed
    eyes: perceptual.Eyes = field(default_factory=perceptual.Eyes)  # networks that judge too

    def __post_init__(self) -> None:
        for kind, names, known in (
            ("factor", self.factors, tuple(CASES)),
            ("task", self.tasks, tuple(twin.TASKS)),
        ):
            for name in names:
                if name not in known:
                    raise RpaugError(f"no {kind} is called {name!r}; there are: {', '.join(known)}")


@dataclass(frozen=True)
class EditRow:
    """One method's figures on one seed; `changed` names what was truly changed, `perceived` are networks' figures."""

    factor: str
    method: str
    seed: int
    task: str
    changed: str
    scores: Scores
    perceived: Mapping[str, float] = field(default_factory=dict)

    @property
    def figures(self) -> dict[str, float]:
        """All that was measured, by name."""
        return {**asdict(self.scores), **self.perceived}

    def flat(self) -> dict[str, Any]:
        """The row as plain values."""
        facts = {k: v for k, v in vars(self).items() if k not in ("scores", "perceived")}
        return facts | self.figures


@dataclass(frozen=True)
class EditTrial:
    """One seed's episodes: what was recorded, what truly came of the change, and each method's result."""

    factor: str
    seed: int
    recorded: twin.Take
    true: twin.Take
    made: dict[str, Episode]


def missing(setting: EditSetting) -> dict[str, str]:
    """Factors that cannot be measured, with the reason."""
    known = registry.operator_names()
    without = {
        factor: f"no operator is called {CASES[factor].operator!r}"
        for factor in setting.factors
        if CASES[factor].operator not in known
    }
    untold = {
        factor: "without cast shadows lamps are not told"
        for factor in setting.factors
        if CASES[factor].shadows and setting.light not in ("shadows", "both")
    }
    return untold | without


def run(
    setting: EditSetting,
    keep: Callable[[EditTrial], None] = lambda shot: None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[EditRow]:
    """All rows, seed by seed; `keep` sees every seed's images before they are dropped."""
    factors = [name for name in setting.factors if name not in missing(setting)]
    rows: list[EditRow] = []
    warm: set[str] = set()
    for seed in range(setting.seeds):
        for number, factor in enumerate(factors):
            rows += _one(setting, factor, setting.first_seed + seed, warm, keep)
            progress(seed * len(factors) + number + 1, len(factors) * setting.seeds)
    return sorted(rows, key=lambda row: factors.index(row.factor))


def summary(rows: Sequence[EditRow]) -> list[dict[str, Any]]:
    """Mean and worst of every figure by factor and method, and `lead`: dB over the mean of the best baseline that
    knows no more than the method does."""
    groups: dict[tuple[str, str], list[EditRow]] = {}
    for row in rows:
        groups.setdefault((row.factor, row.method), []).append(row)
    out = []
    for (factor, method), members in groups.items():
        figures: dict[str, Any] = {"factor": factor, "method": method, "seeds": len(members)}
        for name in members[0].figures:
            values = np.array([row.figures[name] for row in members])
            values = values[~np.isnan(values)]
            worst = np.min if name in HIGHER | perceptual.HIGHER else np.max
            figures[name] = float(values.mean()) if len(values) else None
            figures[f"{name}_worst"] = float(worst(values)) if len(values) else None
        out.append(figures)
    for entry in out:
        ours = entry["method"] not in BASELINES
        entry["lead"] = entry["psnr"] - _best(out, entry) if ours else None
    return out


def _best(entries: Sequence[Mapping[str, Any]], ours: Mapping[str, Any]) -> float:
    """The mean PSNR of the best baseline for the factor of `ours`, of those that know no more."""
    fair = BASELINES - (TOLD_MORE if ours["method"] == ESTIMATED else set())
    return max(
        entry["psnr"]
        for entry in entries
        if entry["factor"] == ours["factor"] and entry["method"] in fair
    )


def _one(
    setting: EditSetting, factor: str, seed: int, warm: set[str], keep: Callable[[EditTrial], None]
) -> Iterator[EditRow]:
    case, judge = CASES[factor], perceptual.opened(setting.eyes)
    try:
        recorded, true = _takes(setting, case, factor, seed)
    except RpaugError as error:  # nothing can be changed truly: where the operator draws it
        print(f"{factor}, seed {seed}: {error}", file=sys.stderr)
        return
    made: dict[str, Episode] = {}
    with tempfile.TemporaryDirectory() as folder:
        for method, make in _methods(setting, case, recorded, true, seed, Path(folder)):
            try:
                if method not in BASELINES and factor not in warm:
                    make()  # compiles what it needs
                    warm.add(factor)
                start = time.process_time()
                made[method], holes = make()
            except Unsupported as error:  # the others count
                print(f"{factor}, seed {seed}, {method}: {error}", file=sys.stderr)
                continue
            seconds = time.process_time() - start
            scores = measure(recorded, made[method], true, holes, setting.antialias, seconds)
            perceived = judge.measure(recorded, made[method], true, setting.antialias)
            names = {instance_id: name for name, instance_id in true.truth.handles.items()}
            everything = len(true.truth.changed) == len(names)
            changed = (
                "all"
                if everything
                else "+".join(names.get(h, "inserted") for h in true.truth.changed)
            )
            yield EditRow(factor, method, seed, true.truth.task, changed, scores, perceived)
    keep(EditTrial(factor, seed, recorded, true, made))


def _takes(
    setting: EditSetting, case: FactorCase, factor: str, seed: int
) -> tuple[twin.Take, twin.Take]:
    task = setting.tasks[seed % len(setting.tasks)]
    recorded = recording(setting, case.lamps, task, seed)
    if case.truth:
        return recorded, case.truth(recorded)
    target = case.targets[seed // len(setting.tasks) % len(case.targets)]
    if target == "receiver" and recorded.truth.receiver is None:
        target = "manipulated"
    true = twin.perform(
        task,
        seed,
        factor=factor,
        target=target,
        value=case.value(recorded) if case.value else None,
        look=recorded.truth.new,
        size=setting.size,
        frames=setting.frames,
    )
    if true.truth.new.extras:  # all that is new is what was put there
        new = tuple(extra.handle for extra in true.truth.new.extras)
        true = replace(true, truth=replace(true.truth, changed=new))
    return recorded, true


@lru_cache(2)  # factors share what was recorded
def recording(
    setting: EditSetting, lamps: tuple[twin.TwinLamp, ...], task: str, seed: int
) -> twin.Take:
    look = twin.Look(
        lamps=lamps[: setting.lamps],
        antialias=setting.antialias,
        shadows=setting.light in ("shadows", "both"),
        specular=setting.light in ("highlights", "both"),
    )
    finished = {"factor": "object_finish", "value": setting.finish} if setting.finish else {}
    return twin.perform(task, seed, look=look, frames=setting.frames, size=setting.size, **finished)


Holes = Mapping[str, Bool[np.ndarray, "h w"]]
"""Masks of invented pixels, by camera/frame."""

Make = Callable[[], tuple[Episode, Holes]]


def _methods(
    setting: EditSetting,
    case: FactorCase,
    recorded: twin.Take,
    true: twin.Take,
    seed: int,
    folder: Path,
) -> Iterator[tuple[str, Make]]:
    episode = recorded.episode
    asks = case.ask(recorded, true, folder)
    for ask in asks:
        yield ask.method, partial(edited, episode, case, ask, 0)
    yield NONE, lambda: (episode, {})
    if case.colors is not None:
        given, guessed = (case.colors(recorded, true, known) for known in (True, False))
        yield LAB, lambda: (_held(baselines.lab(episode, given)), {})
        yield LAB_ESTIMATED, lambda: (_held(baselines.lab(episode, guessed)), {})
    if case.baseline is not None:
        name, make = case.baseline
        yield name, lambda: (_held(make(recorded, true)), {})
    yield JITTER, lambda: (_held(baselines.jitter(episode, seed)), {})
    if setting.gaussians:
        yield GAUSSIANS, partial(edited, episode, case, asks[0], 3)


def edited(
    episode: Episode,
    case: FactorCase,
    ask: Ask,
    tier: int,
    shown: Callable[[Episode], Episode] = lambda made: made,
) -> tuple[Episode, Holes]:
    """The episode through the pipeline's own stages, every image rendered of what is `shown` of it."""
    kind = TypeAdapter(registry.operator(case.operator))
    operators = [kind.validate_python(dict(fields)) for fields in ask.steps]
    made = plan.make(operators, episode, tier)
    scene = prepare.prepare(episode, made)
    draws = []
    for step, (fields, operator) in enumerate(zip(ask.steps, operators, strict=True)):
        edit = ask.edit or operator.sample(scene, np.random.default_rng(0))
        plain = json.loads(json.dumps(edit))
        draws.append({"step": step, "op": case.operator, "fields": dict(fields), "edit": plain})
    prepared = PreparedEpisode(scene, made, Recipe.from_dict({"version": 1}))
    copy = draw_copy(prepared, 1, known=Known(draws=draws))
    return _held(shown(copy.episode)), copy.tally.holes


def _held(episode: Episode) -> Episode:
    """The episode with every image rendered."""

    def held(view: CameraView) -> CameraView:
        assert view.depth is not None
        assert view.ids is not None
        reels = [(view.rgb(t), view.depth(t), view.ids(t)) for t in range(episode.length)]
        rgb, depth, ids = zip(*reels, strict=True)
        return CameraView(view.camera, rgb.__getitem__, depth.__getitem__, ids.__getitem__)

    return replace(episode, views={name: held(view) for name, view in episode.views.items()})
