"""Which instances move as one rigid body, and where each of them is at every frame."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int

from rpaug.core import geometry
from rpaug.core.types import Body, Episode
from rpaug.scene.sampled_frames import SampledFrames, events, facing, look
from rpaug.scene.tracking import evidence
from rpaug.scene.tracking.arms import KNOWN, Kinematics, link_tracks
from rpaug.scene.tracking.chain import OFTEN, ChainPosition, places
from rpaug.scene.tracking.jaws import fingers, sliding
from rpaug.scene.tracking.motion import (
    FREE,
    GRIPPER,
    STATIC,
    TrackedInstance,
    at_events,
    cheapest,
    costs,
    follow,
    sharpen,
    spread,
    total,
)
from rpaug.scene.tracking.slide import straightened
from rpaug.scene.tracking.slip import slips
from rpaug.scene.tracking.touch import touching

LINK = 0.3  # millimetres per interval that a link of the arm must win by: there are many to choose from
POOR = 0.005  # metres: residual of a track that explains nothing
APART = 0.003  # metres: motions that differ by less are the same motion
AS_WELL = (
    1.25,
    0.15,
)  # another motion explains as much if it costs less than a * best + b per interval
REACH = 0.1  # metres around the middle of a body within which tracks are compared
CHECKED = 10  # frames over which a track's residual is taken


@dataclass(frozen=True)
class _Track:
    """One instance's motion; `labels` as in `motion`, one for each interval."""

    instance_id: int
    labels: Int[np.ndarray, "i"]
    to_world: Float64[np.ndarray, "t 4 4"]
    middle: Float64[np.ndarray, "3"]  # of what was seen, in the body's frame
    weight: int  # pixels it rests on
    ambiguous: bool
    residual: float

    @property
    def motion(self) -> str:
        """The label that explains most of the moving."""
        moving = self.labels[self.labels != STATIC].tolist()
        if not moving:
            return "static"
        if self.residual > POOR:
            return "unknown"
        label = max(sorted(set(moving), reverse=True), key=moving.count)
        return {GRIPPER: "gripper", FREE: "aligned"}.get(label, "link")


def track(
    episode: Episode, sampled: SampledFrames | None = None, arms: Sequence[Kinematics] = KNOWN
) -> tuple[Body, ...]:
    """Every instance's rigid motion, instances that move as one in one body, most pixels first.

    A motion is chosen among standing still, hanging on the gripper (from a grasp on, until a release), being
    a link of one of the `arms` (told along their row, `chain`), and, where none of these explains the depth
    images, alignment by depth. What cannot be told (one frame only, nothing seen twice) is called static and
    `ambiguous`. Without depth or instance ids there is no body.
    """
    sampled = facing(look(episode) if sampled is None else sampled)
    instance_ids = sampled.instance_ids
    if not len(instance_ids):
        return ()
    samples = evidence.draw(sampled, instance_ids)
    representations = _representations(episode, arms)
    happens = events(episode.robot.gripper_open)
    cases = []
    for number, instance_id in enumerate(instance_ids.tolist()):
        seen = np.flatnonzero((samples.counts[:, number] >= evidence.ENOUGH).any(1))
        cases.append(TrackedInstance(number, instance_id, sampled, samples, seen, representations))
    costed = {case.instance_id: costs(case) for case in cases if len(case.seen) > 1}
    touch = touching(sampled)
    row = _row(cases, costed, touch)
    jaws = fingers(episode.robot)
    tracks = [
        _track(case, happens, *costed[case.instance_id], row.get(case.instance_id), jaws)
        if case.instance_id in costed
        else _unseen(case)
        for case in cases
    ]
    return _merge(tracks, touch)


def _representations(
    episode: Episode, arms: Sequence[Kinematics]
) -> Float64[np.ndarray, "m t 4 4"]:
    """World poses of the world itself, the gripper, and the arm's links but the last, which is the gripper's.

    A gripper whose pose is unknown stands as still as the world, so that nothing is found to hang on it.
    """
    if episode.robot.gripper_to_world is None:
        return np.tile(np.eye(4), (2, episode.length, 1, 1))
    gripper = episode.robot.gripper_to_world.copy()
    # Recorded rotations are rounded to float32: made exact, or their products over a track grow.
    left, _, right = np.linalg.svd(gripper[:, :3, :3])
    gripper[:, :3, :3] = left @ right
    world = np.broadcast_to(np.eye(4), gripper.shape)
    links = link_tracks(episode.robot, arms)
    return np.stack([world, gripper, *(() if links is None else links[:-1])])


def _row(
    cases: Sequence[TrackedInstance],
    costed: Mapping[int, tuple[Float64[np.ndarray, "i m"], Bool[np.ndarray, "i"]]],
    touch: Mapping[frozenset[int], int],
) -> dict[int, ChainPosition]:
    """Places of the instances that are an arm's links."""
    fits = {h: cost.sum(0) / known.sum() for h, (cost, known) in costed.items() if known.any()}
    limits = {h: AS_WELL[0] * float(fit.min()) + AS_WELL[1] for h, fit in fits.items()}
    seen = {case.instance_id: set(case.seen.tolist()) for case in cases}
    often = {
        pair
        for pair, times in touch.items()
        if pair <= fits.keys() and times >= OFTEN * len(set.intersection(*(seen[h] for h in pair)))
    }
    return places(fits, limits, often)


def _unseen(case: TrackedInstance) -> _Track:
    """What no two frames show: at rest, for all we know."""
    rest = np.tile(np.eye(4), (case.representations.shape[1], 1, 1))
    weight = int(case.samples.counts[:, case.number].sum())
    return _Track(case.instance_id, np.zeros(0, int), rest, np.zeros(3), weight, True, 0.0)


def _track(
    case: TrackedInstance,
    happens: Int[np.ndarray, "e"],
    cost: Float64[np.ndarray, "i m"],
    known: Bool[np.ndarray, "i"],
    place: ChainPosition | None,
    jaws: Float64[np.ndarray, "f t 4 4"],
) -> _Track:
    counts = case.samples.counts[:, case.number].sum(1)
    weight = int(counts.sum())
    at_event = at_events(case.times, happens)
    choices: dict[float, np.ndarray] = {}
    path = cheapest(cost[:, :2], at_event)
    choices[total(cost, path, at_event)] = path
    for label in range(len(case.representations)):
        same = np.full(len(cost), label)
        extra = LINK * known.sum() if label > GRIPPER else 0.0
        choices.setdefault(total(cost, same, at_event) + extra, same)
    best, *others = sorted(choices)
    labels = choices[best]
    if place is not None and place.label > GRIPPER:
        labels = np.full(len(cost), place.label)
    free: Mapping[int, np.ndarray] = {}
    certain = True
    jaw = sliding(case, labels, jaws)
    if jaw is None and (labels <= GRIPPER).all():
        free, certain = slips(case, cost, labels)
        labels = np.where(np.isin(np.arange(len(cost)), list(free)), FREE, labels)
    to_world = follow(case, sharpen(case, labels), free) if jaw is None else jaw
    most = int(case.seen[np.argmax(counts[case.seen])])
    own = geometry.inverse(to_world[case.sampled.frames[most]])
    middle = geometry.transform(own, np.median(case.points(most)[0], 0))
    if (labels == STATIC).any() and (labels <= GRIPPER).all():
        straight = straightened(case, to_world, middle)
        to_world = to_world if straight is None else straight
    limit = AS_WELL[0] * best + AS_WELL[1] * known.sum()
    rivals = [follow(case, spread(case, choices[c]), {}) for c in others if c <= limit]
    rivalled = any(_apart(to_world, r, middle) > APART for r in rivals)
    if place is not None and (labels == place.label).all():
        rivalled = not place.certain
    ambiguous = not known.any() or not certain or rivalled
    return _Track(
        case.instance_id,
        labels,
        to_world,
        middle,
        weight,
        ambiguous,
        _residual(case, most, to_world),
    )


def _apart(
    a: Float64[np.ndarray, "t 4 4"],
    b: Float64[np.ndarray, "t 4 4"],
    middle: Float64[np.ndarray, "3"],
) -> float:
    """The most, in metres, that two tracks carry points around `middle` apart."""
    around = middle + REACH * np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, -1, -1]])
    gap = np.einsum("tij,kj->tki", (a - b)[:, :3, :3], around) + (a - b)[:, None, :3, 3]
    return float(np.linalg.norm(gap, axis=-1).max())


def _residual(case: TrackedInstance, anchor: int, to_world: Float64[np.ndarray, "t 4 4"]) -> float:
    """Median point-to-plane distance in metres, from frame number `anchor` to others."""
    points, still = case.points(anchor)
    points = points[:still] if still >= evidence.ENOUGH else points
    found = []
    for k in np.unique(np.linspace(0, len(case.seen) - 1, CHECKED).round().astype(int)):
        s = int(case.seen[k])
        if s != anchor:
            first, last = case.sampled.frames[[anchor, s]]
            motion = to_world[last] @ geometry.inverse(to_world[first])
            off = evidence.distances(points, motion, case.sampled, s, case.instance_id)[0]
            found.append(np.abs(off[~np.isnan(off)]))
    every = np.concatenate(found)
    return float(np.median(every)) if len(every) else 0.0


def _merge(tracks: Sequence[_Track], touch: Mapping[frozenset[int], int]) -> tuple[Body, ...]:
    """Instances that touch and move alike become one body, on the track that rests on most pixels."""
    groups: list[list[_Track]] = []
    for one in sorted(tracks, key=lambda t: -t.weight):
        for group in groups:
            near = any(touch.get(frozenset({m.instance_id, one.instance_id})) for m in group)
            if near and _together(group[0], one):
                group.append(one)
                break
        else:
            groups.append([one])
    return tuple(
        Body(
            frozenset(m.instance_id for m in group),
            group[0].to_world,
            group[0].motion,
            residual=group[0].residual,
            ambiguous=group[0].ambiguous,
        )
        for group in groups
    )


def _together(a: _Track, b: _Track) -> bool:
    """Do both move, certainly and alike?"""
    if "static" in (a.motion, b.motion) or a.ambiguous or b.ambiguous or a.motion != b.motion:
        return False
    return _apart(a.to_world, b.to_world, (a.middle + b.middle) / 2) <= APART
