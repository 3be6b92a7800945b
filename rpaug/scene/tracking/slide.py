"""Instances on a rail or a hinge: a nearly straight track becomes exactly straight; a turning one has an axis."""

import cv2
import numpy as np
from jaxtyping import Float64

from rpaug.core import geometry
from rpaug.scene.tracking import evidence
from rpaug.scene.tracking.align import align
from rpaug.scene.tracking.evidence import TRUST
from rpaug.scene.tracking.motion import TrackedInstance

TRAVEL = 0.03  # metres: less does not show a direction
OFF_RAIL = 0.006  # metres beside the rail that alignment may have been off
TURN = 0.02  # radians that it may have been off
STIRS = 1e-3  # metres (and radians): less is rest
SWING = 0.2  # radians: less does not show an axis
MODEL = 6  # seen frames whose points are aligned together


def straightened(
    case: TrackedInstance, to_world: Float64[np.ndarray, "t 4 4"], middle: Float64[np.ndarray, "3"]
) -> Float64[np.ndarray, "t 4 4"] | None:
    """The same motion as a slide along one axis without turning, None if it is no slide.

    The axis is the main direction of the track; how far along it the body is comes from aligning each seen
    frame again with that one freedom, and in between from the track.
    """
    found = along_rail(to_world, middle)
    if found is None:
        return None
    axis, along = found
    corrected = _corrected(case, along, axis)
    out = np.tile(np.eye(4), (len(along), 1, 1))
    out[:, :3, 3] = corrected[:, None] * axis
    return out if _distance(case, out) <= _distance(case, to_world) else None


def along_rail(
    to_world: Float64[np.ndarray, "t 4 4"], middle: Float64[np.ndarray, "3"]
) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "t"]] | None:
    """The axis in the world of a track that is a slide, and how far along it a body around `middle` is; else None."""
    way = np.einsum("tij,j->ti", to_world[:, :3, :3], middle) + to_world[:, :3, 3] - middle
    axis = np.linalg.svd(way, full_matrices=False)[2][0]
    along = way @ axis
    cosine = (np.trace(to_world[:, :3, :3], axis1=1, axis2=2).min() - 1) / 2
    beside = np.linalg.norm(way - np.outer(along, axis), axis=-1).max()
    if np.ptp(along) < TRAVEL or beside > OFF_RAIL or cosine < np.cos(TURN):
        return None
    return axis, along


def _corrected(
    case: TrackedInstance, along: Float64[np.ndarray, "t"], axis: Float64[np.ndarray, "3"]
) -> Float64[np.ndarray, "t"]:
    """Positions on the rail: aligned in the seen frames, the track's own course in between.

    What alignment adds is spread over the way, not over time: where the track rests, so does what comes out.
    """
    times, found = case.times, []
    way = np.concatenate([[0.0], np.abs(np.diff(along)).cumsum()])
    last = 0
    model: list[Float64[np.ndarray, "k 4"]] = []
    before = 0.0
    for s, t in zip(case.seen.tolist(), times.tolist(), strict=True):
        points, still = case.points(s)
        trust = np.where(np.arange(len(points)) < still, 1.0, TRUST)
        resting = way[t] == way[last]
        position, last = along[t] + before, t
        if model and not resting:
            rows = np.concatenate(model)
            guess = np.eye(4)
            guess[:3, 3] = position * axis
            motion, certain = align(
                rows[:, :3], rows[:, 3], guess, case.sampled, s, case.instance_id, axis=axis
            )
            position = float(motion[:3, 3] @ axis) if certain else position
        before = position - along[t]
        found.append(before)
        model = [*model[-MODEL:], np.concatenate([points - position * axis, trust[:, None]], 1)]
    return along + np.interp(way, way[times], found)


def _distance(case: TrackedInstance, to_world: Float64[np.ndarray, "t 4 4"]) -> float:
    """Metres from each seen frame to the one a quarter of the way on: mean, and median to planes.

    The mean has outlines in it, which see a thing slide in its own plane but are as coarse as a pixel; the median
    has not, and tells half a millimetre.
    """
    step, outlines, planes = max(1, len(case.seen) // 4), [], []
    for a, b in zip(case.seen[:-step].tolist(), case.seen[step:].tolist(), strict=True):
        first, last = case.sampled.frames[[a, b]]
        motion = to_world[last] @ geometry.inverse(to_world[first])
        average, count = case.judge(a, b, motion[None])
        if count[0]:
            outlines.append(float(average[0]))
        if np.abs(motion - np.eye(4)).max() > STIRS:  # what rests fits any track that rests
            points, still = case.points(a)
            points = points[:still] if still >= evidence.ENOUGH else points
            off = evidence.distances(points, motion, case.sampled, b, case.instance_id)[0]
            planes.append(np.abs(off[~np.isnan(off)]))
    flat = np.concatenate([np.zeros(0), *planes])
    return float(np.mean(outlines or [0.0]) + np.median(flat if len(flat) else [0.0]))


def about_hinge(
    motions: Float64[np.ndarray, "t 4 4"], points: Float64[np.ndarray, "n 3"]
) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"], Float64[np.ndarray, "t"]] | None:
    """A point of the axis, near the points' middle, the axis, and the angles, of world motions from the first frame
    that turn about a hinge; None if the points, carried about it, leave the track by more than a rail may."""
    turns = np.array([cv2.Rodrigues(motion[:3, :3])[0][:, 0] for motion in motions])
    axis = np.linalg.svd(turns, full_matrices=False)[2][0]
    angles = turns @ axis
    if (
        np.ptp(angles) < SWING
        or np.linalg.norm(turns - np.outer(angles, axis), axis=1).max() > TURN
    ):
        return None
    middle = points.mean(0)
    away = np.einsum("tij,j->ti", motions[:, :3, :3], middle) + motions[:, :3, 3] - middle
    stays = (motions[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    # Least squares of the least length: the point of the axis nearest to the middle.
    at = middle + np.linalg.lstsq(stays, -away.ravel(), rcond=1e-3)[0]
    carried = (at - middle) @ (motions[:, :3, :3] - np.eye(3)).swapaxes(1, 2) + away
    if np.linalg.norm(carried, axis=-1).max() > OFF_RAIL:
        return None
    return at, axis, angles
