"""The Gaussians a fit starts from: every surface that was ever recorded, once."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float32, Int

from rpaug.core import geometry
from rpaug.core.ahead import in_order
from rpaug.core.sampling import frames
from rpaug.core.types import Body, CameraView, Gaussians, Scene
from rpaug.gaussians.gaussians import SPREAD, LiftedImage, chosen, joined, lifted, moved
from rpaug.scene.recorded import surfels
from rpaug.scene.recorded.plates import Plate

SAME_DEPTH = 0.01  # of depth, beside 1 cm: a point that another picture shows too, or what is part of a surface
BODY_FRAMES = 20  # frames that moving bodies are gathered from
HISTORY_FRAMES = 32  # of moving cameras, for static surfaces that no fixed camera saw
MOST = 4000  # Gaussians of one moving body
AS_FINE = 1.1  # footprints that differ by less are equally fine
CHECKER = 2.0**0.5  # pixels between neighbours on a chequerboard
LARGE = 640 * 480  # pixels: larger images are lifted at so many at most


def seeds(scene: Scene) -> Gaussians:
    """Static surfaces from the fixed cameras' plates and, where those saw nothing, from moving cameras; each
    moving body gathered over time in its own frame."""
    still, plates, _ = surfels.plates_of(scene)
    static = joined(_static(scene, still, plates.values()))
    moving = [body for body in scene.bodies if not body.instance_ids <= still]
    return joined([static, *_bodies(scene, moving)])


def _static(scene: Scene, still: frozenset[int], recorded: Iterable[Plate]) -> Iterator[Gaussians]:
    fixed = [view.camera for view in scene.episode.views.values() if view.camera.fixed]
    plates = [
        LiftedImage(
            plate.rgb, plate.depth, plate.ids, camera.K, camera.cam_to_world[0], plate.known
        )
        for camera, plate in zip(
            fixed, recorded, strict=False
        )  # without anything still there are none
    ]
    yield from finest(plates)
    done = plates

    def of(view: CameraView, t: int) -> tuple[LiftedImage, Gaussians] | None:
        past = picture_of(view, t, still)
        return None if past is None else (past, _sparse(past))

    moving = [view for view in scene.episode.views.values() if not view.camera.fixed]
    times = frames(scene.episode.length, HISTORY_FRAMES)
    for found in in_order(partial(of, view, t) for view in moving for t in times):
        if found is not None:
            past, part = found
            yield _unseen(part, done)
            done = [*done, past]


def finest(pictures: Sequence[LiftedImage]) -> Iterator[Gaussians]:
    """A Gaussian for each used pixel of the grid, each place left to the picture that shows it finest; of equals to the
    first."""
    for k, picture in enumerate(pictures):
        part = _gridded(picture)
        earlier, later = _footprints(part, pictures[:k]), _footprints(part, pictures[k + 1 :])
        mine = (part.scales[:, 1] < earlier / AS_FINE) & (part.scales[:, 1] <= later * AS_FINE)
        yield chosen(part, mine)


def _sparse(picture: LiftedImage) -> Gaussians:
    """Every second pixel of the grid, as on a chequerboard."""
    step = _step(picture)
    height, width = picture.ids.shape
    row, column = np.arange(height)[:, None], np.arange(width)
    black = (row % step == 0) & (column % step == 0) & ((row // step + column // step) % 2 == 0)
    return lifted(replace(picture, use=picture.use & black), CHECKER * step)


def _gridded(picture: LiftedImage) -> Gaussians:
    """The pixels of a grid: all of an image that is no larger than `LARGE`."""
    step = _step(picture)
    on_grid = np.zeros_like(picture.use)
    on_grid[::step, ::step] = True
    return lifted(replace(picture, use=picture.use & on_grid), step)


def _step(picture: LiftedImage) -> int:
    """Pixels between neighbours on the grid: a large image shows surfaces finer than their Gaussians need to be."""
    return math.ceil(math.sqrt(picture.ids.size / LARGE))


def _unseen(part: Gaussians, by: Sequence[LiftedImage]) -> Gaussians:
    """Those whose place no picture shows. The latest comes first: it shows most, others are asked for the rest."""
    for picture in reversed(by):
        part = chosen(part, np.isinf(_footprints(part, [picture])))
    return part


def _footprints(part: Gaussians, by: Sequence[LiftedImage]) -> Float32[np.ndarray, "n"]:
    """The finest spread with which a picture shows each Gaussian's place; infinite where none does."""
    out = np.full(len(part), np.inf, np.float32)
    for picture in by:
        local = geometry.transform(geometry.inverse(picture.cam_to_world), part.means.astype(float))
        row, column, inside = geometry.in_image(local, picture.K, picture.depth.shape)
        r, c, z = row[inside], column[inside], local[inside, 2]
        near = np.abs(picture.depth[r, c] - z) < 0.01 + SAME_DEPTH * z
        shown = near & picture.use[r, c] & (picture.ids[r, c] == part.ids[inside])
        size = np.where(shown, SPREAD * _step(picture) * z / picture.K[0, 0], np.inf)
        out[inside] = np.minimum(out[inside], size)
    return out


def _bodies(scene: Scene, bodies: Sequence[Body]) -> Iterator[Gaussians]:
    """Gaussians of moving bodies, each in its own frame."""
    found: list[list[Gaussians]] = [[] for _ in bodies]
    instance_ids = frozenset().union(*(body.instance_ids for body in bodies))

    def of(view: CameraView, t: int) -> list[Gaussians]:
        picture = picture_of(view, t, instance_ids)
        if picture is None:
            return []
        part = _gridded(picture)
        mine = [chosen(part, np.isin(part.ids, list(body.instance_ids))) for body in bodies]
        back = [geometry.inverse(body.to_world[t]) for body in bodies]
        return [moved(one, pose) for one, pose in zip(mine, back, strict=True)]

    times = frames(scene.episode.length, BODY_FRAMES)
    views = scene.episode.views.values()
    for parts in in_order(partial(of, view, t) for t in times for view in views):
        for own, part in zip(found, parts, strict=False):  # none of a picture without any
            if len(part):
                own.append(part)
    return (thinned(joined(own)) for own in found if own)


def thinned(every: Gaussians, most: int = MOST) -> Gaussians:
    """At most so many of them, so that each place holds one, that of the finest view."""
    every = chosen(every, np.argsort(every.scales[:, 1], kind="stable"))
    cell = float(np.quantile(every.scales[:, 1], 0.1)) / SPREAD
    first = _first_of_each_cell(every, cell)
    while len(first) > most:
        cell *= 1.2
        first = _first_of_each_cell(every, cell)
    thin = chosen(every, first)
    scales = thin.scales.copy()
    scales[:, :2] = np.maximum(scales[:, :2], SPREAD * cell)
    return replace(thin, scales=scales)


def _first_of_each_cell(gaussians: Gaussians, cell: float) -> Int[np.ndarray, "m"]:
    cells = np.floor(gaussians.means / cell).astype(np.int64)
    return np.sort(np.unique(cells, axis=0, return_index=True)[1])


def picture_of(view: CameraView, t: int, instance_ids: frozenset[int]) -> LiftedImage | None:
    """What a camera shows of some instance ids at t."""
    if view.depth is None or view.ids is None:
        return None
    ids = view.ids(t)
    use = np.isin(ids, list(instance_ids))
    if not use.any():
        return None
    camera = view.camera
    return LiftedImage(view.rgb(t), view.depth(t), ids, camera.K, camera.cam_to_world[t], use)
