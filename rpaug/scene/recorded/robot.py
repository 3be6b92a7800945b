"""The robot's unseen parts in a moved camera's view: its shape by its file, in the colors that were recorded of it.

A place takes its color from the recorded places of the same part that lie near it in the part's own frame and faced
the same way in the world, so that the light falls on both alike: Shepard's weights (1968), over all of them, so that
nothing jumps from frame to frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from rpaug.core import geometry
from rpaug.core.jit import kernel
from rpaug.core.types import Camera, RobotPart, Scene
from rpaug.render import mesh
from rpaug.render.zbuffer import Source
from rpaug.scene.recorded.plates import spread

FRAMES = 6  # of the episode that colors are taken from
SAME = 0.01  # metres: a recorded point so close to the shape shows it
PLACES = 600  # recorded places kept of a part
FACING = 0.05  # metres: two places so far apart are as unlike as two that face one radian apart
BLUR = 0.005  # metres: places nearer than this count alike


@dataclass(frozen=True)
class PartColors:
    """A robot's part, and recorded places of it: own coordinates and world normals times FACING, and their sRGB."""

    part: RobotPart
    places: Float64[np.ndarray, "n 6"]
    colors: Float64[np.ndarray, "n 3"]


def recorded(scene: Scene) -> tuple[PartColors, ...]:
    """What the recordings show of the robot's parts; those that they never show are left out."""
    parts, found = scene.robot_parts, [list[np.ndarray]() for _ in scene.robot_parts]
    times = spread(scene.episode.length)[:FRAMES] if parts else []
    for view in scene.episode.views.values():
        for t in times if view.ids else ():
            assert view.depth is not None
            assert view.ids is not None
            rows, columns, number, features = _seen(
                parts, view.camera, view.camera.cam_to_world[t], t
            )
            depth, ids, rgb = (
                image(t)[rows, columns] for image in (view.depth, view.ids, view.rgb)
            )
            at = geometry.world_points(view.depth(t).astype(np.float64), view.camera, t)[
                rows, columns
            ]
            for k, part in enumerate(parts):
                own = geometry.transform(geometry.inverse(part.to_world[t]), at)
                near = np.linalg.norm(own - features[:, :3], axis=1) < SAME
                use = (number == k) & near & (ids == part.instance_id) & (depth > 0)
                found[k].append(np.concatenate([features, rgb], 1)[use])
    kept = []
    for part, pieces in zip(parts, found, strict=True):
        every = np.concatenate(pieces) if pieces else np.empty((0, 9))
        if len(every):
            few = every[np.linspace(0, len(every) - 1, min(PLACES, len(every))).round().astype(int)]
            kept.append(PartColors(part, few[:, :6].copy(), few[:, 6:].copy()))
    return tuple(kept)


def source(
    kept: Sequence[PartColors], camera: Camera, cam_to_world: Float64[np.ndarray, "4 4"], t: int
) -> Source:
    """The parts at time t as a recording that the camera would take of them from `cam_to_world`."""
    parts = [one.part for one in kept]
    rgb = np.zeros((camera.height, camera.width, 3), np.uint8)
    depth = np.zeros(rgb.shape[:2], np.float32)
    ids = np.zeros(rgb.shape[:2], np.int32)
    rows, columns, number, features = _seen(parts, camera, cam_to_world, t, depth)
    for k, one in enumerate(kept):
        use = number == k
        rgb[rows[use], columns[use]] = np.rint(_blended(features[use], one.places, one.colors))
        ids[rows[use], columns[use]] = one.part.instance_id
    return Source(camera.K, cam_to_world, rgb, depth, ids, use=depth > 0, carved=True)


def _seen(
    parts: Sequence[RobotPart],
    camera: Camera,
    cam_to_world: np.ndarray,
    t: int,
    out: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, Float64[np.ndarray, "n 6"]]:
    """Rows, columns, part and features of the pixels that show a part; their depth is written to `out`."""
    size = camera.width, camera.height
    seen = mesh.nearest(
        [(one.mesh, one.to_world[t]) for one in parts], camera.K, cam_to_world, size
    )
    rows, columns = np.nonzero(seen.number >= 0)
    number = seen.number[rows, columns]
    ray = geometry.rays(columns, rows, camera.K) * seen.depth[rows, columns, None]
    points = geometry.transform(cam_to_world, ray)
    own = np.empty_like(points)
    for k, one in enumerate(parts):
        own[number == k] = geometry.transform(
            geometry.inverse(one.to_world[t]), points[number == k]
        )
    if out is not None:
        out[:] = seen.depth
    return rows, columns, number, np.concatenate([own, FACING * seen.normals[rows, columns]], 1)


@kernel
def _blended(wanted, places, colors):
    """Colors (n, 3) at the wanted features (n, 6): means over all places, by the inverse fourth power of distance."""
    out = np.zeros((len(wanted), 3))
    for n in range(len(wanted)):
        total = 0.0
        for k in range(len(places)):
            square = BLUR * BLUR
            for axis in range(6):
                square += (wanted[n, axis] - places[k, axis]) ** 2
            weight = 1.0 / (square * square)
            total += weight
            for channel in range(3):
                out[n, channel] += weight * colors[k, channel]
        for channel in range(3):
            out[n, channel] /= total
    return out
