"""Pieces of a video's model: frames that see enough of the same points.

Where blurred frames part a video, its pieces hang together by a few points: how they lie beside each other, and what
lengths in one are in another, nothing tells. Each stands in a part of the world of its own: z up, its support at z = 0,
too far from the others to be taken for a part of them.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float32

from rpaug.core import geometry
from rpaug.scene.video import world
from rpaug.scene.video.instances import joined
from rpaug.scene.video.model import Reconstruction

LINKED = 15  # points that two frames see both: then they hang together
MOSTLY = 0.5  # of the points of the frame that sees fewer: then they do as well
BESIDE = 2.0  # of the farthest depth: so far beyond the cameras a piece ends


def pieces(seen: Bool[np.ndarray, "m p"]) -> list[list[int]]:
    """The rows of each piece, ascending; pieces of most frames first."""
    shared = seen.astype(np.int32) @ seen.T.astype(np.int32)
    own = np.diag(shared)
    least = np.minimum(LINKED, MOSTLY * np.minimum(own[:, None], own))
    group = joined(len(own), np.argwhere((shared >= least) & (shared > 0)))
    found = [np.flatnonzero(group == number).tolist() for number in np.unique(group)]
    return sorted(found, key=lambda rows: (-len(rows), rows))


def placed(
    model: Reconstruction,
    parts: Sequence[Sequence[int]],
    depths: Sequence[Float32[np.ndarray, "h w"]],
) -> tuple[Reconstruction, list[Float32[np.ndarray, "h w"]], list[int], float | None]:
    """The model with its pieces `parts` each in its place, depth in its unit, each frame's piece, and the supports'
    height, None where no piece has one.

    The median depth of the first piece is `world.TYPICAL`; in all that have a support the camera is as high above it.
    """
    up, scaled, piece = world.upward(model.cam_to_world), list(depths), [0] * len(depths)
    made, eye, edge = list[Reconstruction](), None, 0.0
    for number, rows in enumerate(parts):
        factor = world.unit([depths[k] for k in rows])
        part = model.some(list(rows)).moved(np.eye(4), factor)
        motion, level = world.upright(part, up)
        part = part.moved(motion, 1.0)
        if level is not None:
            height = float(np.median(part.cam_to_world[:, 2, 3])) - level
            eye = height if eye is None else eye
            part, factor, level = (
                part.moved(np.eye(4), eye / height),
                factor * eye / height,
                level * eye / height,
            )
        for k in rows:
            scaled[k], piece[k] = np.asarray(factor * depths[k], np.float32), number
        reach = BESIDE * max(float(scaled[k].max()) for k in rows)
        at = part.cam_to_world[:, :3, 3]
        # What has no support lies below all supports.
        low = -level if level is not None else -reach - float(at[:, 2].max())
        aside = edge + reach - float(at[:, 0].min()) if made else 0.0
        made.append(part.moved(geometry.rigid(np.zeros(3), np.array([aside, 0, low])), 1.0))
        edge = float(made[-1].cam_to_world[:, 0, 3].max()) + reach
    return _together(model, parts, made), scaled, piece, None if eye is None else 0.0


def _together(
    model: Reconstruction, parts: Sequence[Sequence[int]], made: Sequence[Reconstruction]
) -> Reconstruction:
    """One model of pieces that were placed."""
    poses = model.cam_to_world.copy()
    seen = np.zeros((len(model.times), sum(len(part.points) for part in made)), bool)
    first = 0
    for rows, part in zip(parts, made, strict=True):
        poses[rows] = part.cam_to_world
        seen[rows, first : first + len(part.points)] = part.seen
        first += len(part.points)
    return replace(
        model, cam_to_world=poses, seen=seen,
        points=np.concatenate([part.points for part in made]),
        colors=np.concatenate([part.colors for part in made]),
    )  # fmt: skip
