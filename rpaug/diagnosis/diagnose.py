"""From an evaluation to its causes, and from causes to a recipe."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from rpaug.diagnosis import keyframes, remedies
from rpaug.diagnosis.analyst import Analyst, Judged
from rpaug.diagnosis.evaluation import Evaluation
from rpaug.diagnosis.messages import KEPT, Cause, Diagnosis
from rpaug.diagnosis.reference import Reference, learn
from rpaug.diagnosis.rules import RuleAnalyst

FEW = 10  # rollouts: one that fails by chance is a tenth of them
ALL_FAILED = 0.9  # only causes that are all but certain are left over 0.8


def diagnose(
    evaluation: Evaluation,
    dataset: Path | None,
    *,
    analyst: Analyst | None = None,
    second: Analyst | None = None,
    reference: Reference | None = None,
    seed: int = 0,
    copies: int = 1,
) -> Diagnosis:
    """Why rollouts failed, and the recipe against it.

    `dataset` holds the training recordings: its images are what is usual, and the recipe is meant for it. `reference`
    is what `reference.learn` made of it, if that was done before. `analyst` is the rule-based one unless given; with a
    `second` one only causes that both name are kept. Raises RpaugError; nothing is written.
    """
    analyst = analyst or RuleAnalyst(seed)
    label = analyst.label if second is None else f"{analyst.label}; cross-checked: {second.label}"
    failures = evaluation.failures
    facts: dict[str, Any] = {
        "analyst": label,
        "rollouts": len(evaluation.rollouts),
        "failures": len(failures),
    }
    if not failures:
        return Diagnosis(verdict="nothing to fix", notes=evaluation.notes, **facts)
    moments = {one.name: keyframes.select(one) for one in failures}
    if reference is None and dataset is not None:
        reference = learn(dataset)
    share, scarce = _told_by(evaluation)
    judged = _lowered(analyst(evaluation, reference, moments), share)
    other = _lowered(second(evaluation, reference, moments), share) if second is not None else None
    causes, notes = _kept(judged, other)
    mended = [remedies.mended(cause, reference, seed) for cause in causes]
    recipe = remedies.recipe(mended, seed=seed, copies=copies)
    return Diagnosis(
        verdict="causes found" if mended else "no cause found",
        causes=tuple(mended),
        measured=judged.measured,
        notes=(*evaluation.notes, *scarce, *judged.notes, *notes),
        recipe=recipe,
        key_frames=moments,
        usage={
            one.label: stated.usage
            for one, stated in ((analyst, judged), (second, other))
            if one is not None and stated is not None and stated.usage is not None
        },
        trace=judged.trace + (other.trace if other else ()),
        **facts,
    )


def _told_by(evaluation: Evaluation) -> tuple[float, tuple[str, ...]]:
    """What confidences are multiplied by where rollouts tell little, and why: they are few, or all of them failed."""
    share, notes = 1.0, []
    if (count := len(evaluation.rollouts)) < FEW:
        share *= count / FEW
        notes.append(f"{count} rollouts, fewer than {FEW}: confidences are multiplied by {share:g}")
    if len(evaluation.failures) == count:
        share *= ALL_FAILED
        notes.append(
            f"every rollout failed, so none shows what succeeds: confidences are multiplied by {ALL_FAILED:g}"
        )
    return share, tuple(notes)


def _lowered(judged: Judged, share: float) -> Judged:
    causes = [
        one.model_copy(update={"confidence": one.confidence * share}) for one in judged.causes
    ]
    return replace(judged, causes=tuple(causes))


def _kept(first: Judged, second: Judged | None) -> tuple[list[Cause], tuple[str, ...]]:
    """The causes above the bar, and with a second opinion only those it shares; what was dropped is told."""
    kept = [cause for cause in first.causes if cause.confidence > KEPT]
    dropped = [
        f"{cause.factor}: confidence {cause.confidence:.2f} is not over {KEPT}: left out"
        for cause in first.causes
        if cause.confidence <= KEPT
    ]
    if second is None:
        return kept, tuple(dropped)
    shared = {cause.factor: cause for cause in second.causes if cause.confidence > KEPT}
    both = [cause for cause in kept if cause.factor in shared]
    dropped += [
        f"{cause.factor}: named by the first analyst only: left out"
        for cause in kept
        if cause.factor not in shared
    ]
    named = {cause.factor for cause in kept}
    dropped += [
        f"{name}: named by the second analyst only: left out"
        for name in shared
        if name not in named
    ]
    return both, tuple(dropped)
