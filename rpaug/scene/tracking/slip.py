"""Motions that no carrier explains, found by aligning depth: pushed things, things that slip, closing jaws."""

import numpy as np
from jaxtyping import Float64, Int

from rpaug.core import geometry
from rpaug.scene.tracking.align import align
from rpaug.scene.tracking.evidence import TRUST
from rpaug.scene.tracking.motion import FULL_WEIGHT, GRIPPER, STATIC, TrackedInstance, price

# Costs are millimetres of mean distance per interval, as in `motion`.
UNEXPLAINED = 2.0  # intervals explained worse than this are aligned
JAW_MOVED = 5.0  # the same for a part of the gripper, which hangs on it but for its jaws
TOLERATED = 0.3  # the same for a thing picked up by the gripper, which may slip
ALIGNED = 0.3  # what an alignment must win by: it has six free numbers
GAIN = 0.7  # and the share of the cost that it may leave
SLIDES = (
    0.8  # what counts of the cost of an alignment that turns nothing: it has three free numbers
)
MOST_TURN = 0.3  # radians in one interval beyond the guess
JAW, JAW_STEP = 0.06, 0.004  # metres: how far a jaw may slide in one interval, and the grid tried
WIDEST, FINEST = 8e-3, 4e-4  # metres: first and last step of the search for a shift
MODEL = 5  # seen frames whose points are aligned together, beside the newest


def slips(
    case: TrackedInstance, cost: Float64[np.ndarray, "i m"], labels: Int[np.ndarray, "i"]
) -> tuple[dict[int, Float64[np.ndarray, "4 4"]], bool]:
    """Motions of the intervals that `labels` (static or gripper) do not explain, and whether they are certain.

    First guesses are rest, the gripper's motion (68 mm off without it on a drawer), the last motion, and the
    shift of the middle; the last two keep the gripper's turn, as jaws do.
    """
    found: dict[int, Float64[np.ndarray, "4 4"]] = {}
    certain, last = True, np.eye(4)
    picked_up = bool((labels == STATIC).any())
    at = np.eye(4)  # pose at the interval's first frame
    model: list[Float64[np.ndarray, "k 4"]] = []  # points in the body's own frame, and their trust
    for i, known in enumerate(labels.tolist()):
        a, b = int(case.seen[i]), int(case.seen[i + 1])
        points, still = case.points(a)
        trust = np.where(np.arange(len(points)) < still, 1.0, TRUST)
        own = geometry.transform(geometry.inverse(at), points)
        model = [*model[-MODEL:], np.concatenate([own, trust[:, None]], 1)]
        rows = np.concatenate(model)
        ahead = case.ahead(a, b)[:2]
        limit = UNEXPLAINED if known == STATIC else TOLERATED if picked_up else JAW_MOVED
        if cost[i, known] > limit and len(rows) >= FULL_WEIGHT:
            rows[:, :3] = geometry.transform(at, rows[:, :3])
            motion, sure, least = _best(case, a, b, rows, [ahead[0], ahead[1], last], ahead[known])
            if least + ALIGNED < GAIN * cost[i, known]:
                found[i], last = motion, motion
                certain &= sure
        at = found.get(i, ahead[known]) @ at
    return found, certain


def _best(
    case: TrackedInstance,
    a: int,
    b: int,
    rows: Float64[np.ndarray, "k 4"],
    starts: list[Float64[np.ndarray, "4 4"]],
    known: Float64[np.ndarray, "4 4"],
) -> tuple[Float64[np.ndarray, "4 4"], bool, float]:
    """The alignment from a to b that explains most, whether it is certain, and what it costs."""
    shift = known.copy()
    middle = np.median(geometry.transform(known, case.points(a)[0]), 0)
    shift[:3, 3] += np.median(case.points(b)[0], 0) - middle
    aside = _aside(case, a, b, starts[GRIPPER])
    guesses = [(start, True) for start in starts] + [(shift, False), (aside, False)]
    fits = [
        align(rows[:, :3], rows[:, 3], guess, case.sampled, b, case.instance_id, turning=turning)
        for guess, turning in guesses
    ]
    motions = np.stack([motion for motion, _ in fits])
    average, count = case.judge(a, b, motions)
    # Nothing seen in common, or an implausible turn: no evidence for this one.
    turned = [_turn(m, g) > MOST_TURN for m, (g, _) in zip(motions, guesses, strict=True)]
    average[(count == 0) | turned] = 1.0
    k = int(np.argmin(average * np.array([1.0 if turning else SLIDES for _, turning in guesses])))
    if count[k] == 0:
        return motions[k], False, np.inf
    motion, left = motions[k], float(average[k])
    if not guesses[k][1]:
        motion, left = _settled(case, a, b, motion, left)
    return motion, fits[k][1], float(price(np.array([left]), count[k : k + 1])[0])


def _aside(
    case: TrackedInstance, a: int, b: int, start: Float64[np.ndarray, "4 4"]
) -> Float64[np.ndarray, "4 4"]:
    """`start` shifted along one of the gripper's axes, as far as explains most."""
    axes = case.representations[GRIPPER, case.sampled.frames[b], :3, :3].T
    far = np.arange(-JAW, JAW + JAW_STEP / 2, JAW_STEP)
    tries = np.repeat(start[None], 3 * len(far), 0)
    tries[:, :3, 3] += (axes[:, None] * far[:, None]).reshape(-1, 3)
    average, count = case.judge(a, b, tries)
    return tries[int(np.argmin(np.where(count > 0, average, np.inf)))]


def _settled(
    case: TrackedInstance, a: int, b: int, motion: Float64[np.ndarray, "4 4"], left: float
) -> tuple[Float64[np.ndarray, "4 4"], float]:
    """The shift nearby that explains outlines best too, by steps that halve: planes let flat things slide."""
    axes = case.representations[GRIPPER, case.sampled.frames[b], :3, :3].T
    size = WIDEST
    while size > FINEST:
        tries = np.repeat(motion[None], 6, 0)
        tries[:, :3, 3] += size * np.concatenate([axes, -axes])
        average, count = case.judge(a, b, tries)
        average = np.where(count > 0, average, np.inf)
        k = int(np.argmin(average))
        if average[k] < left:
            motion, left = tries[k], float(average[k])
        else:
            size /= 2
    return motion, left


def _turn(a: Float64[np.ndarray, "4 4"], b: Float64[np.ndarray, "4 4"]) -> float:
    """The angle between two rotations, in radians."""
    return float(np.arccos(np.clip((np.trace(a[:3, :3].T @ b[:3, :3]) - 1) / 2, -1, 1)))
