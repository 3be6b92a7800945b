"""Moves one instance's points from frame to frame until they lie on what the other frame shows."""

import cv2
import numpy as np
from jaxtyping import Float64

from rpaug.core import geometry
from rpaug.scene.sampled_frames import FacingFrames
from rpaug.scene.tracking import evidence

ROUNDS = 12
REACH = 0.03  # metres: planes further off are not taken for the same place
SOFT = 0.002  # metres: half weight at this distance (Cauchy)
FLAT = 1e-3  # least over greatest curvature below which some direction is a guess


def align(
    points: Float64[np.ndarray, "k 3"],
    trust: Float64[np.ndarray, "k"],
    guess: Float64[np.ndarray, "4 4"],
    sampled: FacingFrames,
    s: int,
    instance_id: int,
    *,
    turning: bool = True,
    axis: Float64[np.ndarray, "3"] | None = None,
) -> tuple[Float64[np.ndarray, "4 4"], bool]:
    """The motion near `guess` that lays `points` on the planes of frame number s, and whether it is certain.

    `trust` weighs the points. With `turning` false the guess's rotation is kept, as a gripper's jaw keeps it;
    with an `axis` (a unit vector) the points only slide along it.
    Point-to-plane Gauss-Newton with projective association (Rusinkiewicz and Levoy 2001). Directions in which
    the planes let the points slide keep the guess.
    """
    motion, certain = guess.copy(), False
    for _ in range(ROUNDS):
        off, moved, normals = evidence.distances(points, motion, sampled, s, instance_id)
        used = np.abs(np.where(np.isnan(off), np.inf, off)) < REACH
        if used.sum() < evidence.ENOUGH:
            return motion, False
        r, n = off[used], normals[used]
        centre = moved[used].mean(0)
        arm = moved[used] - centre
        size = max(float(np.sqrt((arm**2).sum(-1).mean())), 1e-3)
        weight = trust[used] / (1.0 + (r / SOFT) ** 2)
        J = np.concatenate([np.cross(arm / size, n), n], 1)
        if axis is not None or not turning:
            J[:, :3] = 0.0
        if axis is not None:
            J[:, 3:] = (n @ axis)[:, None] * axis
        H = J.T @ (J * weight[:, None])
        curvature, axes = np.linalg.eigh(H)
        firm = curvature > FLAT * curvature[-1]
        certain = bool(firm.sum() == (1 if axis is not None else 6 if turning else 3))
        held = axes[:, firm]
        step = held @ ((held.T @ (-J.T @ (r * weight))) / curvature[firm])
        by = geometry.rigid(step[:3] / size, np.zeros(3))
        by[:3, 3] = step[3:] + centre - by[:3, :3] @ centre
        motion = by @ motion
        if np.abs(step).max() < 2e-5:
            break
    return motion, certain


def between(motion: Float64[np.ndarray, "4 4"], parts: int) -> Float64[np.ndarray, "p 4 4"]:
    """The motion cut in `parts` equal steps: poses after 1, 2, ... of them, the last being the motion."""
    turn = cv2.Rodrigues(motion[:3, :3])[0][:, 0]
    share = np.arange(1, parts + 1) / parts
    out = np.stack([geometry.rigid(turn * f, motion[:3, 3] * f) for f in share])
    out[-1] = motion
    return out
