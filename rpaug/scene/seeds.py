"""The Gaussians a fit starts from: every surface that was ever recorded, once."""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float32

from rpaug import geometry
from rpaug.scene import surfels
from rpaug.scene.gaussians import Picture, chosen, joined, lifted, moved
from rpaug.scene.sampling import frames
from rpaug.types import Body, CameraView, Gaussians, Scene

SAME_DEPTH = 0.01  # of depth, beside 1 cm: a point that a fixed camera saw too
BODY_FRAMES = 16  # frames that moving bodies are gathered from
CELL = 1.5  # footprints: a body's Gaussians are no closer than this
FINER = (
    0.7  # another camera's Gaussian is kept beside a plate's if its footprint is smaller by this
)


def seeds(scene: Scene) -> Gaussians:
    """Static surfaces from the fixed cameras' plates and, where those saw nothing, from moving cameras; each
    moving body gathered over time in its own frame."""
    kept = surfels.build(scene)
    static = joined(_static(scene, kept))
    moving = [body for body in scene.bodies if not body.handles <= kept.static]
    parts = [_body(scene, body) for body in moving]
    return joined([static, *(part for part in parts if part is not None)])


def _static(scene: Scene, kept: surfels.Surfels) -> Iterator[Gaussians]:
    done: list[Picture] = []
    for name, plate in kept.plates.items():
        camera = scene.episode.views[name].camera
        picture = Picture(
            plate.rgb, plate.depth, plate.ids, camera.K, camera.cam_to_world[0], plate.known
        )
        part = lifted(picture)
        yield chosen(part, ~_seen_better(part, done))
        done.append(picture)
    for past in kept.history.values():
        for source in past:
            use = np.ones(source.ids.shape, bool) if source.use is None else source.use
            picture = Picture(
                source.rgb, source.depth, source.ids, source.K, source.cam_to_world, use
            )
            part = lifted(picture)
            yield chosen(part, ~_seen(part, done))
            done.append(picture)


def _seen(part: Gaussians, by: Sequence[Picture]) -> Bool[np.ndarray, "n"]:
    """Which Gaussians lie on a surface that one of the pictures shows."""
    return _footprints(part, by) < np.inf


def _seen_better(part: Gaussians, by: Sequence[Picture]) -> Bool[np.ndarray, "n"]:
    """The same, unless the picture's pixels are coarser there."""
    return _footprints(part, by) * FINER <= part.scales[:, 1]


def _footprints(part: Gaussians, by: Sequence[Picture]) -> Float32[np.ndarray, "n"]:
    """The finest spread with which a picture shows each Gaussian's place; infinite where none does."""
    from rpaug.scene.gaussians import SPREAD

    out = np.full(len(part), np.inf, np.float32)
    for picture in by:
        local = geometry.transform(geometry.inverse(picture.cam_to_world), part.means.astype(float))
        z = np.maximum(local[:, 2], 1e-6)
        column = np.rint(picture.K[0, 0] * local[:, 0] / z + picture.K[0, 2])
        row = np.rint(picture.K[1, 1] * local[:, 1] / z + picture.K[1, 2])
        height, width = picture.depth.shape
        inside = (local[:, 2] > 0) & (row >= 0) & (row < height) & (column >= 0) & (column < width)
        r, c = row[inside].astype(int), column[inside].astype(int)
        near = np.abs(picture.depth[r, c] - z[inside]) < 0.01 + SAME_DEPTH * z[inside]
        shown = near & picture.use[r, c] & (picture.ids[r, c] == part.ids[inside])
        size = np.where(shown, SPREAD * z[inside] / picture.K[0, 0], np.inf)
        out[inside] = np.minimum(out[inside], size)
    return out


def _body(scene: Scene, body: Body) -> Gaussians | None:
    """Gaussians of a moving body in its own frame, thinned so that each place holds one, nearest view first."""
    found = []
    for t in frames(scene.episode.length, BODY_FRAMES):
        for view in scene.episode.views.values():
            picture = _picture(view, t, body)
            if picture is not None:
                found.append(moved(lifted(picture), geometry.inverse(body.to_world[t])))
    if not found:
        return None
    every = joined(found)
    order = np.argsort(every.scales[:, 1], kind="stable")
    every = chosen(every, order)
    cell = CELL * float(np.median(every.scales[:, 1]))
    _, first = np.unique(np.floor(every.means / cell).astype(np.int64), axis=0, return_index=True)
    return chosen(every, np.sort(first))


def _picture(view: CameraView, t: int, body: Body) -> Picture | None:
    if view.depth is None or view.ids is None:
        return None
    ids = view.ids(t)
    use = np.isin(ids, list(body.handles))
    if not use.any():
        return None
    camera = view.camera
    return Picture(view.rgb(t), view.depth(t), ids, camera.K, camera.cam_to_world[t], use)
