"""Which known motion an instance follows in each interval between the frames that show it."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float64, Int

from rpaug.core import geometry
from rpaug.scene.sampled_frames import FacingFrames
from rpaug.scene.tracking import evidence
from rpaug.scene.tracking.align import between

# Costs are millimetres of mean distance per interval.
SWITCH = 6.0  # from static to held, anywhere
SWITCH_AT_EVENT = (
    1.0  # the same next to a frame at which the gripper opens or closes; and back, anywhere
)
FULL_WEIGHT = 60  # points on which an interval's evidence counts in full
TIE = 5e-5  # metres: switch times that explain the images as well as one another

REACH = 2  # seen frames before and after a switch among which its moment is looked for
QUIET = 1e-4  # metres a frame: slower is at rest

STATIC, GRIPPER, FREE = 0, 1, -1  # labels; 2 and up are links of the arm


@dataclass(frozen=True)
class TrackedInstance:
    """One instance: its number among the instance ids, the numbers of the frames that show it (two or more), and
    the world poses of all it may hang on: the world itself, the gripper, the arm's links."""

    number: int
    instance_id: int
    sampled: FacingFrames
    samples: evidence.Samples
    seen: Int[np.ndarray, "n"]
    representations: Float64[np.ndarray, "m t 4 4"]

    @property
    def times(self) -> Int[np.ndarray, "n"]:
        """Frames of the episode that show it."""
        return self.sampled.frames[self.seen]

    def points(self, s: int) -> tuple[Float64[np.ndarray, "k 3"], int]:
        """World points in frame number s, and how many of them are from fixed cameras."""
        return self.samples.of(s, self.number)

    def ahead(self, a: int, b: int) -> Float64[np.ndarray, "m 4 4"]:
        """How every carrier moves from frame number a to frame number b."""
        first, last = self.sampled.frames[[a, b]]
        return self.representations[:, last] @ geometry.inverse(self.representations[:, first])

    def judge(
        self, a: int, b: int, motions: Float64[np.ndarray, "m 4 4"]
    ) -> tuple[Float64[np.ndarray, "m"], Float64[np.ndarray, "m"]]:
        """Mean distance in metres and number of points: a's points moved to b, and b's moved back."""
        ahead = evidence.judge(*self.points(a), motions, self.sampled, b, self.instance_id)
        back = evidence.judge(
            *self.points(b), geometry.inverse(motions), self.sampled, a, self.instance_id
        )
        return evidence.mean(ahead + back)


REST = 0.02  # millimetres per interval that a motion must win by against rest


def costs(case: TrackedInstance) -> tuple[Float64[np.ndarray, "i m"], Bool[np.ndarray, "i"]]:
    """Cost of every carrier's motion in every interval, and whether the interval shows anything at all."""
    cost = np.zeros((len(case.seen) - 1, len(case.representations)))
    known = np.zeros(len(case.seen) - 1, bool)
    for i, (a, b) in enumerate(pairwise(case.seen.tolist())):
        average, count = case.judge(a, b, case.ahead(a, b))
        cost[i] = price(average, count)
        cost[i, STATIC + 1 :] += REST  # a plane that slides in itself looks the same at rest
        known[i] = count.max() > 0
    return cost, known


def price(
    average: Float64[np.ndarray, "m"], count: Float64[np.ndarray, "m"]
) -> Float64[np.ndarray, "m"]:
    """Cost of motions that leave an `average` distance in metres over `count` points."""
    return 1e3 * average * np.minimum(count / FULL_WEIGHT, 1.0)


def at_events(times: Int[np.ndarray, "n"], events: Int[np.ndarray, "e"]) -> Bool[np.ndarray, "n"]:
    """For each seen frame: does the gripper open or close within one interval of it?"""
    if not len(events):
        return np.zeros(len(times), bool)
    width = np.maximum(np.diff(times, prepend=times[0]), np.diff(times, append=times[-1]))
    return (np.abs(times[:, None] - events) <= width[:, None] + 1).any(1)


def cheapest(
    cost: Float64[np.ndarray, "i m"], at_event: Bool[np.ndarray, "n"]
) -> Int[np.ndarray, "i"]:
    """The labels with the least cost, switches paid for (Viterbi 1967)."""
    total, back = cost[0].copy(), np.zeros(cost.shape, int)
    for i in range(1, len(cost)):
        step = total[:, None] + _tolls(len(total), bool(at_event[i]))
        back[i] = step.argmin(0)
        total = step.min(0) + cost[i]
    path = np.zeros(len(cost), int)
    path[-1] = total.argmin()
    for i in range(len(cost) - 1, 0, -1):
        path[i - 1] = back[i, path[i]]
    return path


def total(
    cost: Float64[np.ndarray, "i m"], labels: Int[np.ndarray, "i"], at_event: Bool[np.ndarray, "n"]
) -> float:
    """What a path costs with its switches."""
    tolls = sum(
        _tolls(cost.shape[1], bool(at_event[i]))[labels[i - 1], labels[i]]
        for i in range(1, len(labels))
    )
    return float(cost[np.arange(len(cost)), labels].sum() + tolls)


def _tolls(labels: int, at_event: bool) -> Float64[np.ndarray, "m m"]:
    """What going from one label (row) to another (column) costs. What was pushed may be left behind anywhere."""
    toll = (SWITCH_AT_EVENT if at_event else SWITCH) * (1 - np.eye(labels))
    toll[STATIC + 1 :, STATIC] = SWITCH_AT_EVENT
    return toll


def spread(case: TrackedInstance, labels: Int[np.ndarray, "i"]) -> Int[np.ndarray, "steps"]:
    """Labels of every step t to t + 1 of the episode; the ends go on as they are."""
    steps = np.arange(case.representations.shape[1] - 1)
    return labels[np.clip(np.searchsorted(case.times, steps, side="right") - 1, 0, len(labels) - 1)]


def sharpen(case: TrackedInstance, labels: Int[np.ndarray, "i"]) -> Int[np.ndarray, "steps"]:
    """Labels of every step, each switch moved to the frame that explains best what is seen around it."""
    steps, times = spread(case, labels), case.times
    for i in np.flatnonzero(labels[1:] != labels[:-1]):
        before, after = int(labels[i]), int(labels[i + 1])
        if FREE in (before, after):
            continue
        a, b = _around(labels, int(i))
        first, last = int(times[a]), int(times[b])
        turns = np.arange(first, last + 1)
        motions = (
            case.representations[after, last]
            @ geometry.inverse(case.representations[after, turns])
            @ case.representations[before, turns]
            @ geometry.inverse(case.representations[before, first])
        )
        average, _ = case.judge(int(case.seen[a]), int(case.seen[b]), motions)
        # Among switches that explain as much: where both are at rest to one another, as at a grasp or at the
        # beginning of a push, and close to the frame in the middle.
        close = np.flatnonzero(average <= average.min() + TIE)
        speed = np.maximum(_apart(case, before, after, turns[close]), QUIET)
        turn = int(turns[close[np.lexsort((np.abs(turns[close] - times[i + 1]), speed))[0]]])
        steps[first:turn], steps[turn:last] = before, after
    return steps


def _around(labels: Int[np.ndarray, "i"], i: int) -> tuple[int, int]:
    """Numbers of the seen frames between which the switch after interval i is looked for: no other lies there."""
    others = np.flatnonzero(labels[1:] != labels[:-1])
    first, last = max(i + 1 - REACH, 0), min(i + 1 + REACH, len(labels))
    earlier, later = others[others < i], others[others > i]
    return (
        max([first, *(earlier[-1:] + 1).tolist()]),
        min([last, *(later[:1] + 1).tolist()]),
    )


def _apart(
    case: TrackedInstance, before: int, after: int, turns: Int[np.ndarray, "n"]
) -> Float64[np.ndarray, "n"]:
    """How far two carriers go apart from each frame to the next, in metres where the thing is."""
    ahead = np.minimum(turns + 1, case.representations.shape[1] - 1)
    gap = (
        case.representations[after, ahead] @ geometry.inverse(case.representations[after, turns])
        - case.representations[before, ahead] @ geometry.inverse(case.representations[before, turns])
    )  # fmt: skip
    at = np.median(case.points(int(case.seen[0]))[0], 0)
    return np.linalg.norm(gap[:, :3, :3] @ at + gap[:, :3, 3], axis=-1)


def follow(
    case: TrackedInstance,
    steps: Int[np.ndarray, "steps"],
    free: Mapping[int, Float64[np.ndarray, "4 4"]],
) -> Float64[np.ndarray, "t 4 4"]:
    """Poses over all frames, the first one the identity; `free` gives the motion of aligned intervals."""
    times, back = case.times, geometry.inverse(case.representations)
    part: dict[int, tuple[int, Float64[np.ndarray, "4 4"]]] = {}
    for i, motion in free.items():
        start = int(times[i])
        for k, pose in enumerate(between(motion, int(times[i + 1]) - start)):
            part[start + k] = (start, pose)
    out = np.empty(case.representations.shape[1:])
    out[0] = np.eye(4)
    for t, label in enumerate(steps):
        if t in part:
            start, pose = part[t]
            out[t + 1] = pose @ out[start]
        elif label in (STATIC, FREE):
            out[t + 1] = out[t]
        else:
            out[t + 1] = case.representations[label, t + 1] @ back[label, t] @ out[t]
    return out
