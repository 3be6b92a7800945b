"""Things on a hinge: a track that turns about one axis in the world that stays where it is."""

import cv2
import numpy as np
from jaxtyping import Float64

from rpaug.scene.tracking.slide import OFF_RAIL, TURN

SWING = 0.2  # radians: less does not show an axis


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
