"""All rollouts in numbers: how far each factor lies from the training recordings, in their standard deviations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float64, Int64

from rpaug.diagnosis.evaluation import CameraShot, Evaluation, Rollout
from rpaug.diagnosis.messages import FACTORS, Factor
from rpaug.diagnosis.reference import Plates, Reference, ReferenceCamera
from rpaug.diagnosis.sight import NUMBERS, Seen, SightCamera, measured, stage

MOST_CAMERAS = 3
FEW = 0.5  # share of the rollouts in which a factor must be measured
FURTHEST = 30.0  # standard deviations: what is further off is as far


@dataclass(frozen=True)
class Table:
    """Rollouts by rows. `away[factor]` are distances from the recordings, NaN where they could not be measured.

    `usual` are the recordings' own distances, each left out of what it is held against; `numbers[factor]` the
    differences themselves in the recordings' standard deviations, averaged over cameras; `plain[factor]` in their own
    units (`sight.NUMBERS`), where the camera that shows the most counts.
    """

    names: tuple[str, ...]
    failed: Bool[np.ndarray, "n"]
    away: Mapping[Factor, Float64[np.ndarray, "n"]]
    numbers: Mapping[Factor, Float64[np.ndarray, "n k"]]
    usual: Mapping[Factor, Float64[np.ndarray, "m"]]
    plain: Mapping[Factor, Float64[np.ndarray, "n k"]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def taken(self, rows: Int64[np.ndarray, "k"], failed: Bool[np.ndarray, "k"]) -> "Table":
        """Some of the rollouts, with outcomes of their own."""
        return replace(
            self,
            names=tuple(self.names[row] for row in rows),
            failed=failed,
            away={factor: found[rows] for factor, found in self.away.items()},
            numbers={factor: found[rows] for factor, found in self.numbers.items()},
            plain={factor: found[rows] for factor, found in self.plain.items()},
        )


def table(evaluation: Evaluation, reference: Reference) -> Table:
    """The numbers of every rollout's first frame in the cameras that the recordings have too."""
    known = {name for one in evaluation.rollouts for name in one.shots}
    cameras = [name for name in reference.plates if name in known][:MOST_CAMERAS]
    rollouts = evaluation.rollouts
    names = tuple(one.name for one in rollouts)
    failed = np.array([not one.success for one in rollouts])
    if not cameras:
        there = ", ".join(sorted(reference.plates)) or "no fixed camera with roles"
        note = f"no camera of the evaluation ({', '.join(sorted(known))}) is one of the recordings' ({there})"
        return Table(names, failed, {}, {}, {}, notes=(note,))
    scores = [_by_task(name, rollouts, reference) for name in cameras]
    numbers: dict[Factor, Float64[np.ndarray, "n k"]] = {}
    usual: dict[Factor, Float64[np.ndarray, m]] = {}
    plain: dict[Factor, Float64[np.ndarray, "n k"]] = {}
    missing = []
    for factor in FACTORS[:-1]:
        mean = _mean([now[factor] for now, _, _ in scores])
        if np.isfinite(mean).all(1).mean() < FEW:
            missing.append(factor)
            continue
        numbers[factor] = mean
        usual[factor] = _length(np.concatenate([own[factor] for _, own, _ in scores]))
        plain[factor] = _largest([found[factor] for _, _, found in scores])
    notes = (f"not to be measured in these images: {', '.join(missing)}",) if missing else ()
    away = {factor: _length(found) for factor, found in numbers.items()}
    return Table(names, failed, away, numbers, usual, plain, notes)


Scores = dict[Factor, Float64[np.ndarray, "n k"]]


def _by_task(
    camera: str, rollouts: Sequence[Rollout], reference: Reference
) -> tuple[Scores, Scores, Scores]:
    """`_scored`, each rollout held against the recordings of its own task."""
    tasks: dict[int, tuple[Plates, list[int]]] = {}
    for row, one in enumerate(rollouts):
        plates = reference.of(one.instruction)
        tasks.setdefault(id(plates), (plates, []))[1].append(row)
    now = {
        factor: np.full((len(rollouts), len(parts)), np.nan) for factor, parts in NUMBERS.items()
    }
    own: dict[Factor, list[Float64[np.ndarray, "m k"]]] = {factor: [] for factor in NUMBERS}
    plain = {factor: found.copy() for factor, found in now.items()}
    for plates, rows in tasks.values():
        if camera not in plates:
            continue
        found, usual, apart = _scored(camera, [rollouts[row] for row in rows], plates[camera])
        for factor in NUMBERS:
            now[factor][rows] = found[factor]
            plain[factor][rows] = apart[factor]
            own[factor].append(usual[factor])
    return now, {factor: np.concatenate(some) for factor, some in own.items()}, plain


def _scored(
    camera: str, rollouts: Sequence[Rollout], plate: ReferenceCamera
) -> tuple[Scores, Scores, Scores]:
    """Every rollout's and every recording's numbers in standard deviations of the recordings, in one camera; the
    rollouts' once more as plain differences."""
    made: SightCamera = stage(plate)
    own = [
        measured(CameraShot(lambda image=one.image: image), {}, made, without=k)  # type: ignore[misc]
        for k, one in enumerate(made.plate.firsts)
    ]
    now = [_first(one, camera, made) for one in rollouts]
    masked = any(
        shot.ids is not None for one in rollouts for shot in one.shots.get(camera, {}).values()
    )
    if masked and any(one.roles for one in rollouts):
        own = [
            measured(
                CameraShot(lambda i=one.image: i, lambda i=one.ids: i),  # type: ignore[misc]
                one.roles,
                made,
                without=k,
            )
            for k, one in enumerate(made.plate.firsts)
        ]
    scored: Scores = {}
    usual: Scores = {}
    plain: Scores = {}
    for factor, parts in NUMBERS.items():
        floor = np.array([noise for _, noise in parts])
        base, found = _rows(own, factor, len(parts)), _rows(now, factor, len(parts))
        seen = np.isfinite(base).all(1)
        if not seen.any():
            scored[factor], usual[factor] = np.full_like(found, np.nan), base
            plain[factor] = scored[factor]
            continue
        middle = np.median(base[seen], 0)
        spread = np.sqrt(np.var(base[seen], 0) + floor**2)
        plain[factor] = found - middle
        scored[factor], usual[factor] = plain[factor] / spread, (base - middle) / spread
    return scored, usual, plain


def _first(rollout: Rollout, camera: str, made: SightCamera) -> Seen:
    shots = rollout.shots.get(camera)
    return measured(shots[min(shots)], rollout.roles, made) if shots else {}


def _rows(seen: Sequence[Seen], factor: Factor, width: int) -> Float64[np.ndarray, "n k"]:
    nothing = np.full(width, np.nan)
    return np.array([one.get(factor, nothing) for one in seen]).reshape(-1, width)


def _mean(found: Sequence[Float64[np.ndarray, "n k"]]) -> Float64[np.ndarray, "n k"]:
    """The mean over cameras that could tell."""
    stacked = np.stack(found)
    known = np.isfinite(stacked)
    total = np.where(known, stacked, 0).sum(0)
    count = known.sum(0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _largest(found: Sequence[Float64[np.ndarray, "n k"]]) -> Float64[np.ndarray, "n k"]:
    """Each number from the camera in which it is largest."""
    stacked = np.stack(found)
    size = np.where(np.isfinite(stacked), np.abs(stacked), -1)
    return np.take_along_axis(stacked, size.argmax(0)[None], 0)[0]


def _length(numbers: Float64[np.ndarray, "n k"]) -> Float64[np.ndarray, "n"]:
    """Root mean square over a factor's numbers, bounded."""
    return np.minimum(np.sqrt((np.clip(numbers, -1e6, 1e6) ** 2).mean(1)), FURTHEST)
