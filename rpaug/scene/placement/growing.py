"""What has to be resized with a thing, and how far it can grow before it meets what stands beside it or moves past.

A cabinet holds its drawers and a box its lid: no size suits one of them alone. What holds what is told by where their
surfaces lie, not by names.
"""

from collections.abc import Iterable, Mapping

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float64

from rpaug.core import geometry
from rpaug.core.errors import TargetError
from rpaug.core.types import Body, Scene
from rpaug.scene.placement.free_space import CELL, FreeSpace
from rpaug.scene.placement.placing import find_free_space, hull, points_by_instance_id, points_of
from rpaug.scene.placement.standing import LIFTED
from rpaug.scene.targets import agreement

STEPS = 24  # factors tried between the recorded size and the one asked for
INSIDE = 0.005  # metres inside or outside of a side, from which on that is clear
FEW = 8  # points that a growing thing's outside is told by
HELD = 0.05  # of what was seen of a thing: no more of a solid thing can lie in another that does not hold it
LID = 0.02  # metres above a thing, up to which what is there lies on it or closes it
FOOT = 0.02  # quantile of heights that counts as a thing's foot
OPEN = 0.7  # cosine between a side and the way a thing moves from which on that side is open


def held(
    scene: Scene, instance_ids: frozenset[int]
) -> tuple[frozenset[int], dict[frozenset[int], float]]:
    """What some instances hold at first, in them or on them: the ids of what never leaves them, and what does leave.

    Of each body that leaves, by its ids, the height in metres of its foot in the world. A drawer stays, pulled out as
    it may be, as long as some of it is inside. Of two things that lie in one another the larger holds; and
    what only lies above the instances, in what holds both, is held by that: one drawer does not carry the next.
    """
    apart = instance_ids | agreement.apart(scene)
    others = [body for body in scene.tracked if not body.instance_ids & apart]
    clouds = points_by_instance_id(scene, instance_ids.union(*(b.instance_ids for b in others)))
    outer = _joined(clouds, instance_ids)
    stays, leaves = frozenset[int](), dict[frozenset[int], float]()
    if len(outer) < FEW:
        return stays, leaves
    every = [_joined(clouds, body.instance_ids) for body in others]
    holders = [own for own in every if _contains(own, outer)]
    top = float(np.quantile(outer[:, 2], 1 - FOOT)) - INSIDE
    for body, own in zip(others, every, strict=True):
        if not _held(own, outer) or _contains(own, outer):
            continue
        above = float(np.quantile(own[:, 2], FOOT)) > top
        if above and any(_contains(holder, own) for holder in holders):
            continue
        if all(_held(geometry.transform(step, own), outer, 0.0) for step in _steps(body)):
            stays |= body.instance_ids
        else:
            leaves[body.instance_ids] = float(np.quantile(own[:, 2], FOOT))
    return stays, leaves


def _joined(
    clouds: Mapping[int, Float64[np.ndarray, "n 3"]], instance_ids: Iterable[int]
) -> Float64[np.ndarray, "m 3"]:
    return np.concatenate([clouds[instance_id] for instance_id in sorted(instance_ids)])


def _steps(body: Body) -> Float64[np.ndarray, "k 4 4"]:
    """How a body is moved from the first frame to each of those where it is elsewhere than in the frame before."""
    new = np.abs(np.diff(body.to_world, axis=0)).max((1, 2)) > 0
    return body.to_world[1:][new] @ geometry.inverse(body.to_world[0])


def _held(
    points: Float64[np.ndarray, "n 3"], outer: Float64[np.ndarray, "m 3"], least: float = HELD
) -> bool:
    """Whether at least that share of a thing lies in the outline of another, seen from above, and some of it above the
    other's foot and no higher than a lid would."""
    if len(points) < FEW:
        return False
    low, high = outer[:, 2].min() + INSIDE, outer[:, 2].max() + LID
    normals, offsets = _sides(hull(outer))
    within = (points[:, :2] @ normals.T - offsets).max(1, initial=-np.inf) < -INSIDE
    there = within & (points[:, 2] > low) & (points[:, 2] < high)
    return bool(within.mean() >= least and there.sum() >= FEW)


def _contains(holder: Float64[np.ndarray, "n 3"], outer: Float64[np.ndarray, "m 3"]) -> bool:
    """Whether a thing holds another rather than the other way round: it is the larger."""
    return len(holder) >= FEW and _room(holder) > _room(outer) and _held(outer, holder)


def _room(points: Float64[np.ndarray, "n 3"]) -> float:
    """The upright prism around points, cubic metres."""
    return float(cv2.contourArea(hull(points).astype(np.float32)) * np.ptp(points[:, 2]))


def largest(
    scene: Scene, instance_ids: frozenset[int], pivot: Float64[np.ndarray, "3"], wanted: float
) -> tuple[float, str | None]:
    """The largest factor up to `wanted` by which the things can grow about `pivot` (world), and what stops them there.

    Only what the growth newly takes counts: as things were recorded they met nothing. What lies in another thing, as a
    drawer in its cabinet, grows up to that one's sides. Apart from that, things that do not stand on the support, or
    that the robot moves, are judged by their contacts alone.
    """
    moved = scene.roles.get("manipulated", frozenset()) | scene.roles.get("robot", frozenset())
    points = points_of(scene, instance_ids)
    if wanted <= 1 or len(points) < 4:
        return wanted, None
    inner, what = _within(scene, instance_ids, points, pivot, wanted)
    if what is not None or instance_ids <= moved:
        return inner, what
    try:
        around = find_free_space(scene, instance_ids)
    except TargetError:  # no support, so nothing to stand beside
        return wanted, None
    if abs(float(np.quantile(points[:, 2], 0.01)) - around.level) > LIFTED:
        return wanted, None
    fits = 1.0
    for factor in np.linspace(1.0, wanted, STEPS + 1)[1:].tolist():
        what = _met(around, points, pivot + factor * (points - pivot))
        if what is not None:
            return fits, what
        fits = factor
    return wanted, None


def _within(
    scene: Scene,
    instance_ids: frozenset[int],
    points: Float64[np.ndarray, "n 3"],
    pivot: Float64[np.ndarray, "3"],
    wanted: float,
) -> tuple[float, str | None]:
    """The largest factor at which nothing comes out of the sides of a thing that it lay in.

    Sides are those of the upright prism around what was seen of the other thing. The way that the thing itself moves it
    may come out: there it is open. So it is at the top, unless some of the other thing was seen above it.
    """
    way = _way(scene, instance_ids)
    apart = instance_ids | agreement.apart(scene)
    for body in scene.tracked:
        if body.instance_ids & apart:
            continue
        other = points_of(scene, body.instance_ids)
        if len(other) < 4:
            continue
        normals, offsets = _sides(hull(other))
        below = points[:, 2] < float(other[:, 2].max())
        beyond = (points[:, :2] @ normals.T - offsets).max(1)
        if (below & (beyond < -INSIDE)).sum() < FEW:
            continue
        held = points[below & (beyond < 0)]
        closed, ceiling = np.abs(normals @ way) < OPEN, _ceiling(other, held)
        fits = 1.0
        for factor in np.linspace(1.0, wanted, STEPS + 1)[1:].tolist():
            grown = pivot + factor * (held - pivot)
            out = (grown[:, :2] @ normals[closed].T - offsets[closed]).max(1, initial=-np.inf)
            if ((out > INSIDE) | (grown[:, 2] > ceiling)).sum() >= FEW:
                names = ", ".join(map(str, sorted(body.instance_ids)))
                return fits, f"the sides of {names}, in which it lies"
            fits = factor
    return wanted, None


def _ceiling(other: Float64[np.ndarray, "n 3"], held: Float64[np.ndarray, "m 3"]) -> float:
    """The height of what was lowest seen of a thing above all that lies in it, metres; without end if nothing was."""
    normals, offsets = _sides(hull(held))
    over = (other[:, :2] @ normals.T - offsets).max(1) < 0
    heights = other[over & (other[:, 2] > held[:, 2].max()), 2]
    return float(heights.min()) if len(heights) >= FEW else np.inf


def _way(scene: Scene, instance_ids: frozenset[int]) -> Float64[np.ndarray, "2"]:
    """The direction over the ground in which the things move farthest, of length 1; 0 if they do not."""
    body = next(body for body in scene.tracked if body.instance_ids & instance_ids)
    steps = body.to_world[:, :2, 3] - body.to_world[0, :2, 3]
    step = steps[int(np.argmax((steps**2).sum(1)))]
    far = float(np.linalg.norm(step))
    return step / far if far > LIFTED else np.zeros(2)


def _sides(
    outline: Float[np.ndarray, "k 2"],
) -> tuple[Float64[np.ndarray, "k 2"], Float64[np.ndarray, "k"]]:
    """Outward normals of a convex outline's edges, and how far out each edge lies along its own."""
    corners = np.asarray(outline, float)
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.stack([edges[:, 1], -edges[:, 0]], 1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(1e-9)
    offsets = (corners * normals).sum(1)
    if (corners.mean(0) @ normals.T - offsets).mean() > 0:  # the corners run the other way round
        normals, offsets = -normals, -offsets
    return normals, offsets


def _met(
    around: FreeSpace, before: Float[np.ndarray, "n 3"], after: Float[np.ndarray, "n 3"]
) -> str | None:
    """What stands or passes where the grown thing is and the recorded one was not."""
    was, now = _covered(around, before), _covered(around, after)
    low, high = (float(points[:, 2].max()) - around.level for points in (before, after))
    for height, what in (
        (around.still, "what stands beside it"),
        (around.swept, "what moves past it"),
    ):
        taken = height < high
        if (taken & now & ~(was & (height < low))).any():
            return what
    return None


def _covered(around: FreeSpace, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "r c"]:
    mask = np.zeros(around.seen.shape, np.uint8)
    corners = np.rint((hull(points) - around.origin) / CELL).astype(np.int32)
    cv2.fillConvexPoly(mask, corners, 1)
    return mask > 0
