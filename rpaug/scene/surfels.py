"""Which recorded pixels show a moved camera its view: its own, other cameras', and other times'.

A view at time t draws, in this order (an earlier source keeps a pixel that a later one confirms):

1. the camera's own recorded image at t;
2. what the other cameras recorded at t;
3. *plates*: what a fixed camera saw of static bodies where something moving hides them at t;
4. *history*: what a moving camera saw of static bodies at other times.

All but the first are carved by the first: a surfel where the own camera saw farther is not there.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8

from rpaug.errors import TargetError, Unsupported
from rpaug.render import holes, zbuffer
from rpaug.render.zbuffer import Rendered, Source
from rpaug.types import CameraView, Scene

PLATE_SAMPLES = (
    9  # recordings of a static pixel, spread over the episode, whose median is its plate
)
HISTORY_FRAMES = 6  # frames of a moving camera kept for what they show of static bodies
SAME_DEPTH = 0.01  # of depth: a plate's samples agree this well or are another surface


@dataclass(frozen=True)
class Plate:
    """What one fixed camera saw of static bodies over the whole episode; `known` where it ever saw any."""

    rgb: UInt8[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]
    ids: Int32[np.ndarray, "h w"]
    known: Bool[np.ndarray, "h w"]


@dataclass(frozen=True)
class Surfels:
    """What is kept of an episode between views: its static handles, a plate per fixed camera, and history."""

    static: frozenset[int]
    plates: Mapping[str, Plate]
    history: Mapping[str, tuple[Source, ...]]


def build(scene: Scene) -> Surfels:
    """Plates of the fixed cameras and history of the moving ones, from bodies whose motion is "static".

    Reads each image at most once and keeps a few images in memory. Raises Unsupported if a source has no depth.
    """
    static = frozenset().union(*(body.handles for body in scene.bodies if body.motion == "static"))
    plates, history = {}, {}
    for name, view in scene.episode.views.items():
        if view.depth is None:
            raise Unsupported(
                f"{name}: moving a camera needs recorded depth, and this source has none"
            )
        if not static:
            continue
        if view.camera.fixed:
            plates[name] = _plate(view, scene.episode.length, static)
        else:
            history[name] = tuple(_history(view, scene.episode.length, static))
    return Surfels(static=static, plates=plates, history=history)


def view(surfels: Surfels, scene: Scene, camera_name: str, t: int) -> Rendered:
    """What `scene.cameras[camera_name]` sees at time t, drawn from recorded pixels, holes filled.

    Colours are as recorded: appearance edits are functions of colour and id, and are applied to the result. Where
    the camera stands as recorded, the result is the recorded image bit for bit. Raises TargetError.
    """
    if camera_name not in scene.cameras or camera_name not in scene.episode.views:
        known = ", ".join(scene.episode.views)
        raise TargetError(f"no camera is called {camera_name!r}; there are: {known}")
    camera = scene.cameras[camera_name]
    shown = list(sources(surfels, scene, camera_name, t))
    drawn = zbuffer.render(
        camera.K, camera.cam_to_world[t], (camera.width, camera.height), shown, witness=shown[0]
    )
    return holes.fill(drawn)


def sources(surfels: Surfels, scene: Scene, own: str, t: int) -> Iterator[Source]:
    """The recorded images that show camera `own` its view at time t, the most trusted first, itself before all."""
    views = scene.episode.views
    yield (recorded := source_at(views[own], t, distant=True))
    now = {own: recorded}
    for name in views:
        if name != own:
            now[name] = source_at(views[name], t, carved=True)
            yield now[name]
    for name, plate in surfels.plates.items():
        hidden = plate.known & ~_among(now[name].ids, surfels.static)
        if hidden.any():
            yield Source(
                K=now[name].K, cam_to_world=now[name].cam_to_world, rgb=plate.rgb, depth=plate.depth,
                ids=plate.ids, use=hidden, carved=True,
            )  # fmt: skip
    for past in surfels.history.values():
        yield from past


def source_at(view: CameraView, t: int, distant: bool = False, carved: bool = False) -> Source:
    """One recorded image as surfels; a source without masks has handle 0 everywhere."""
    assert view.depth is not None  # build() refuses sources without depth
    depth = view.depth(t)
    ids = view.ids(t) if view.ids is not None else np.zeros(depth.shape, np.int32)
    return Source(
        K=view.camera.K,
        cam_to_world=view.camera.cam_to_world[t],
        rgb=view.rgb(t),
        depth=depth,
        ids=ids,
        distant=distant,
        carved=carved,
    )


def _among(ids: Int32[np.ndarray, "h w"], handles: frozenset[int]) -> Bool[np.ndarray, "h w"]:
    return np.isin(ids, np.fromiter(handles, np.int32, len(handles)))


def _spread(length: int) -> list[int]:
    """All frames, ordered so that any first few of them are spread over the episode (van der Corput)."""
    bits = max(1, (length - 1).bit_length())
    turned = (int(f"{i:0{bits}b}"[::-1], 2) for i in range(1 << bits))
    return [t for t in turned if t < length]


def _plate(view: CameraView, length: int, static: frozenset[int]) -> Plate:
    """Per pixel, the median of its first few static recordings in spread order; stops when all have enough."""
    size = (view.camera.height, view.camera.width)
    count = np.zeros(size, np.int64)
    ids = np.zeros(size, np.int32)
    depths = np.zeros((PLATE_SAMPLES, *size), np.float32)
    colours = np.zeros((PLATE_SAMPLES, *size, 3), np.uint8)
    for t in _spread(length):
        now = source_at(view, t)
        good = _among(now.ids, static) & np.isfinite(now.depth) & (now.depth > 0)
        good &= count < PLATE_SAMPLES
        agrees = (now.ids == ids) & (np.abs(now.depth - depths[0]) < SAME_DEPTH * depths[0])
        rows, columns = np.nonzero(good & ((count == 0) | agrees))
        slot = count[rows, columns]
        depths[slot, rows, columns] = now.depth[rows, columns]
        colours[slot, rows, columns] = now.rgb[rows, columns]
        ids[rows, columns] = now.ids[rows, columns]
        count[rows, columns] += 1
        if (count == PLATE_SAMPLES).all():
            break
    middle = np.maximum(count - 1, 0) // 2
    return Plate(
        rgb=_ranked(colours, count, middle),
        depth=_ranked(depths, count, middle),
        ids=ids,
        known=count > 0,
    )


def _ranked(samples: np.ndarray, count: np.ndarray, rank: np.ndarray) -> np.ndarray:
    """Per pixel, the sample of the given rank among its first `count`; each channel by itself."""
    extra = (None,) * (samples.ndim - 3)
    slots = np.arange(len(samples))[(slice(None), None, None, *extra)]
    worst = np.iinfo(samples.dtype).max if samples.dtype.kind == "u" else np.inf
    missing = slots >= count[(None, ..., *extra)]
    ordered = np.sort(np.where(missing, samples.dtype.type(worst), samples), axis=0)
    found = np.take_along_axis(ordered, rank[(None, ..., *extra)], axis=0)[0]
    return np.where(count[(..., *extra)] > 0, found, 0).astype(samples.dtype)


def _history(view: CameraView, length: int, static: frozenset[int]) -> Iterator[Source]:
    for t in sorted(_spread(length)[:HISTORY_FRAMES]):
        past = source_at(view, t)
        use = _among(past.ids, static)
        if use.any():
            yield Source(
                K=past.K, cam_to_world=past.cam_to_world, rgb=past.rgb, depth=past.depth, ids=past.ids,
                use=use, carved=True,
            )  # fmt: skip
