"""The edited scene as an episode: every camera's images, each rendered when asked for."""

import hashlib
import time
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8

from rpaug.compose import inserted
from rpaug.core.errors import SourceLacks
from rpaug.core.image_cache import shelved
from rpaug.core.memo import once
from rpaug.core.types import CameraView, Episode, Everywhere, Relit, Rig, Scene, Sensor
from rpaug.render import holes
from rpaug.render.composite import Surfaces, composite
from rpaug.render.zbuffer import Rendered
from rpaug.scene.lighting import grain, highlights, intrinsic, recast, rig
from rpaug.scene.recorded import pooled, surface, surfels

if TYPE_CHECKING:
    from rpaug.gaussians import fill_gaussians

KEPT_FRAMES = 8  # a writer asks for rgb, depth and ids of one frame in turn
KEPT_PIXELS = 1 << 22  # more frames are kept of small images: gates look at them again


@dataclass(frozen=True)
class Frame:
    """One rendered image with what belongs to it, all from the same surfaces; `hole` marks invented pixels."""

    rgb: UInt8[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]
    ids: Int32[np.ndarray, "h w"]
    hole: Bool[np.ndarray, "h w"]


@dataclass(frozen=True)
class RenderedFrame:
    """A frame rendered anew: what was recorded, what is seen now, its hole mask if it can have one, the seconds its
    thread took, its mask where that is rendered anew and written, and which pixels of a moved camera show what moves.
    """

    camera: str
    t: int
    before: UInt8[np.ndarray, "h w 3"]
    image: UInt8[np.ndarray, "h w 3"]
    hole: Bool[np.ndarray, "h w"] | None
    seconds: float
    ids: Int32[np.ndarray, "h w"] | None = None
    moving: Bool[np.ndarray, "h w"] | None = None


Watch = Callable[[RenderedFrame], None]


@dataclass(frozen=True)
class Stands:
    """What is known of a camera that stands as it was recorded, each worked out when it is asked for: its images over
    time, how its pictures are made, and what edits found of the places that it shows, if it is fixed."""

    pool: Callable[[], pooled.Pool]
    grain: Callable[[], grain.Grain | grain.FrameBlur | None]
    places: surface.KnownPlaces | None


Whole = tuple[inserted.Image, Bool[np.ndarray, "h w"]]
"""Color, depth and ids of an image before things are put in and appearance is edited, and its holes."""


def edited(
    scene: Scene,
    representations: Mapping[str, int],
    watch: Watch,
    blended: Mapping[str, frozenset[int]] | None = None,
    kept: Callable[[], surfels.Surfels] | None = None,
    device: str = "cpu",
) -> Episode:
    """The episode the scene now shows. Images that no edit reaches keep their recorded accessors.

    `blended` names the instance ids that Gaussians show in a camera whose other pixels are surfels. `kept` gives the
    surfels of the recorded scene, where they were built before. Another `device` than "cpu" makes edits of appearance,
    of several frames at once.
    """
    cast = recast.of(scene)
    near = scene
    if 1 in representations.values():  # each camera's view is drawn from all cameras' images
        near = replace(scene, episode=shelved(scene.episode))

    drawn = _bases(scene, near, cast, kept)
    whole = None
    if any(tier >= 3 for tier in representations.values()):
        from rpaug.gaussians import fill_gaussians  # only here: it brings the rasteriser

        whole = fill_gaussians.patched(scene, kept)
    views = {}
    for name in scene.episode.views:
        stands = scene.cameras[name] is scene.episode.views[name].camera
        images = partial(pooled.of_camera, scene.episode, name)
        video = scene.back is not None
        made = grain.FrameBlur if video else partial(grain.of, scene.episode, name)
        places = surface.KnownPlaces() if scene.cameras[name].fixed else None
        stood = Stands(images, made, places) if stands else None
        proxy = scene.episode.views[name].proxy
        blank = proxy is not None and proxy.blank
        if representations[name] == 0 and inserted.bodies(scene) and not blank:
            base = partial(_recorded, scene.episode if cast is None else cast.recorded, name)
            render = _finished(scene, name, stood, base, cast, device, cast is not None)
            views[name] = _rendered(scene, name, render, watch)
        elif representations[name] == 0 or blank:
            views[name] = _composited(scene, name, stood, cast, watch, device)
        elif representations[name] == 1:
            matte = stands and (cast is not None or highlights.find(scene) is not None)
            base = partial(drawn(matte), name)
            render = _finished(scene, name, stood, base, cast, device, matte)
            if blended and blended.get(name):
                render = partial(_blended, near, render, name, blended[name])
            views[name] = _rendered(near, name, render, watch)
        else:
            render = partial(_gaussians, scene if whole is None else whole, name, cast)
            views[name] = _rendered(scene, name, render, watch)
    shown = {name: _as_recorded(view, scene.episode.views[name]) for name, view in views.items()}
    return replace(scene.episode, views=shown, descriptions=scene.descriptions)


def _bases(
    scene: Scene,
    near: Scene,
    cast: recast.Recast | None,
    kept: Callable[[], surfels.Surfels] | None,
) -> Callable[[bool], Callable[[str, int], Whole]]:
    """Images drawn of surfels: of what was recorded, or, if they are to be `matte`, of it without cast shadows and
    highlights."""

    @cache
    def drawn(matte: bool) -> Callable[[str, int], Whole]:
        if not matte:
            return partial(_surfels, near, surfels.build(near, kept() if kept else None))
        if cast is not None:
            bare, known = cast.recorded, _evenly_lit(rig.recorded(scene), cast.relit.recorded)
        else:
            bare, known = highlights.matte(scene), _matte(rig.recorded(scene))
        base = replace(scene, episode=shelved(bare))
        return partial(_surfels, base, surfels.build(base, known))

    return drawn


@once
def _evenly_lit(recorded: Scene, lamps: Rig) -> surfels.Surfels:
    """Surfels of a recorded scene without cast shadows: all copies of an episode share them."""
    even = recast.Recast(recorded, Relit(lamps, lamps)).recorded
    return surfels.recorded(replace(recorded, episode=shelved(even)))


@once
def _matte(recorded: Scene) -> surfels.Surfels:
    """The same without highlights."""
    return surfels.recorded(replace(recorded, episode=shelved(highlights.matte(recorded))))


def _as_recorded(view: CameraView, recorded: CameraView) -> CameraView:
    """The view without what was only inferred: what a source lacks is not written into its copies."""
    view, proxy = _as_sensed(view, recorded), recorded.proxy
    if proxy is not None and view.camera is recorded.camera:
        view = replace(view, camera=proxy.camera)
    if proxy is not None and proxy.modelled:
        view = replace(view, depth=None)
    return replace(view, ids=None, inferred=False, proxy=None) if recorded.inferred else view


def _as_sensed(view: CameraView, recorded: CameraView) -> CameraView:
    """The view with the depth that its sensor gave wherever an edit left that, if a scene repaired it."""
    if recorded.sensed is None or recorded.depth is None or view.depth is None:
        return view
    measured, repaired, now = recorded.sensed.recorded, recorded.depth, view.depth
    if now is repaired:
        return replace(view, depth=measured, sensed=None)
    if view.camera is not recorded.camera:
        return view

    def depth(t: int) -> Float32[np.ndarray, "h w"]:
        shown = now(t)
        return np.where(shown == repaired(t), measured(t), shown)

    return replace(view, depth=depth, sensed=None)


def sense(
    sensor: Sequence[Sensor], image: UInt8[np.ndarray, "h w 3"], camera: str, t: int
) -> UInt8[np.ndarray, "h w 3"]:
    """The image as the camera's own faults would give it: the same whenever it is asked for again."""
    name = int.from_bytes(hashlib.blake2b(camera.encode(), digest_size=8).digest(), "little")
    for number, effect in enumerate(sensor):
        if effect.cameras is not None and camera not in effect.cameras:
            continue
        image = effect(image, np.random.default_rng([effect.seed, name, t, number]))
    return image


def everywhere(scene: Scene) -> Everywhere:
    """What the edits that need no place do to recorded images that the scene does not hold."""
    placeless = [one for one in scene.appearance if getattr(one, "everywhere", False)]
    nowhere = typing.cast("Surfaces", lambda rows: None)

    def shown(image: UInt8[np.ndarray, "h w 3"], name: str, t: int) -> UInt8[np.ndarray, "h w 3"]:
        made = composite(image, None, placeless, scene.antialiased, nowhere) if placeless else image
        return sense(scene.sensor, made, name, t)

    return shown


def _composited(
    scene: Scene,
    name: str,
    stood: Stands | None,
    cast: recast.Recast | None,
    watch: Watch,
    device: str,
) -> CameraView:
    view = scene.episode.views[name]
    if not scene.appearance and not scene.sensor and cast is None:
        return view

    def host(t: int, before: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
        ids = view.ids(t) if view.ids else None
        light: surface.Light = partial(intrinsic.share, scene, name, t)
        told = view.depth is not None and ids is not None and cast is None
        shine = partial(highlights.seen_by, scene, view, t) if told else None
        if cast is not None and view.depth and ids is not None:
            now = cast.light(name, t, view.depth(t), ids)
            before = cast.shown(name, t, cast.even(name, t), now)
            light = partial(np.asarray, now)
        pool, places = (stood.pool, stood.places) if stood else (None, None)
        surfaces = surface.of_view(view, t, scene.bodies, ids, pool, light, shine, places)
        radiance = view.radiance(t) if view.radiance else None
        made = composite(before, ids, scene.appearance, scene.antialiased, surfaces, radiance)
        if cast is None or not cast.relit.gains or not view.depth or ids is None:
            return made
        return recast.times(made, cast.tint(view.camera, t, view.depth(t), ids, name))

    drawn = _on_device(scene, name, device)

    def rgb(t: int) -> UInt8[np.ndarray, "h w 3"]:
        start = time.thread_time()
        before = view.rgb(t)
        image = sense(scene.sensor, drawn(t) if drawn else host(t, before), name, t)
        watch(RenderedFrame(name, t, before, image, None, time.thread_time() - start))
        return image

    return replace(view, rgb=rgb, radiance=None)


def _rendered(scene: Scene, name: str, render: Callable[[int], Frame], watch: Watch) -> CameraView:
    recorded = scene.episode.views[name]
    stands = scene.cameras[name] is recorded.camera

    @lru_cache(max(KEPT_FRAMES, KEPT_PIXELS // (recorded.camera.width * recorded.camera.height)))
    def frame(t: int) -> Frame:
        start = time.thread_time()
        made = render(t)
        made = replace(made, rgb=sense(scene.sensor, made.rgb, name, t))
        spent = time.thread_time() - start
        ids = made.ids if recorded.ids and not recorded.inferred else None
        moving = None if stands else np.isin(made.ids, list(scene.moving))
        watch(RenderedFrame(name, t, recorded.rgb(t), made.rgb, made.hole, spent, ids, moving))
        return made

    return CameraView(
        camera=scene.cameras[name],
        rgb=lambda t: frame(t).rgb,
        depth=(lambda t: frame(t).depth) if recorded.depth else None,
        ids=(lambda t: frame(t).ids) if recorded.ids else None,
    )


def _on_device(
    scene: Scene, name: str, device: str
) -> Callable[[int], UInt8[np.ndarray, "h w 3"]] | None:
    """What draws a camera's recorded frames under edits of appearance on a device; None where the host does."""
    if device == "cpu" or not scene.appearance:
        return None
    from rpaug.compose import batched  # only here: it brings torch

    if not batched.drawable(scene, name):
        return None
    return batched.ahead(scene, name, device)


Lit = tuple[inserted.Image, Bool[np.ndarray, "h w"], Float32[np.ndarray, "h w"] | None]
"""The same with what was put in, and the light on it where shadows were cast anew."""


def _recorded(episode: Episode, name: str, t: int) -> Whole:
    """What was recorded."""
    view = episode.views[name]
    depth = surface.depth_of(view, t)
    if depth is None:
        raise SourceLacks(
            f"{name}: inserting things needs recorded depth, and this source has none"
        )
    ids = view.ids(t) if view.ids else np.zeros(depth.shape, np.int32)
    return (view.rgb(t), depth, ids), np.zeros(depth.shape, bool)


def _surfels(scene: Scene, shared: surfels.Surfels, name: str, t: int) -> Whole:
    drawn = surfels.view(shared, scene, name, t)
    return (drawn.image, drawn.depth, drawn.ids), drawn.hole


def _finished(
    scene: Scene,
    name: str,
    stood: Stands | None,
    base: Callable[[int], Whole],
    cast: recast.Recast | None,
    device: str,
    matte: bool,
) -> Callable[[int], Frame]:
    """Images with what was inserted, in the light that falls now, and every appearance edit on all of it.
    What `matte` surfaces mirror is put onto them."""
    camera, view = scene.cameras[name], scene.episode.views[name]

    def filled(t: int) -> Lit:
        before, hole = base(t)
        rgb, depth, ids = inserted.draw(scene, camera, t, before)
        made = stood.grain() if stood else None
        if made is not None:
            rgb = made.onto(view.rgb(t), before[0], rgb, hole)
        light = None
        shine = highlights.across(scene, name, t, depth, ids) if matte else None
        if cast is not None and stood and view.depth and view.ids:
            light = cast.light(name, t, depth, ids)
            rgb = cast.shown(name, t, rgb, light, shine)
        elif cast is not None:
            rgb = recast.times(rgb, cast.gain(camera, t, depth, ids))
        elif shine is not None:
            rgb = highlights.shown(scene, name, t, rgb, shine)
        return (rgb, depth, ids), hole & (ids == before[2]), light

    def frame(t: int) -> Frame:
        (rgb, depth, ids), hole, now = filled(t)
        light, shine = _told(scene, name, stood, t, ids, now, matte)
        pool, places = (stood.pool, stood.places) if stood else (None, None)
        surfaces = surface.of_image(
            lambda: depth, ids, camera, t, scene.bodies, pool, light, shine, places
        )
        radiance = None
        if stood and view.radiance:
            same = (rgb == view.rgb(t)).all(-1, keepdims=True)
            radiance = np.where(same, view.radiance(t), np.float32(0))
        image = composite(rgb, ids, scene.appearance, scene.antialiased, surfaces, radiance)
        return Frame(image, depth, ids, hole)

    drawn = _finished_on_device(scene, name, stood, filled, device, matte) or frame
    if cast is None or not cast.relit.gains:
        return drawn

    def tinted(t: int) -> Frame:
        made = drawn(t)
        tint = cast.tint(camera, t, made.depth, made.ids, name if stood else None)
        return replace(made, rgb=recast.times(made.rgb, tint))

    return tinted


def _told(
    scene: Scene,
    name: str,
    stood: Stands | None,
    t: int,
    ids: Int32[np.ndarray, "h w"],
    now: Float32[np.ndarray, "h w"] | None,
    matte: bool,
) -> tuple[surface.Light, surface.Shine]:
    """What tells of the light and of the highlights in an image of a camera that stands as it was recorded; `now` is
    the light where it fell anew; `matte` surfaces were drawn, and what they mirror put onto them."""
    view = scene.episode.views[name]
    light: surface.Light = partial(_light, scene, name, t, ids) if stood else None
    if now is not None:
        light = partial(np.asarray, now)
    here = matte or scene.recorded_bodies is None
    told = here and stood and view.depth is not None and now is None
    return light, partial(highlights.seen_by, scene, view, t) if told else None


def _finished_on_device(
    scene: Scene,
    name: str,
    stood: Stands | None,
    filled: Callable[[int], Lit],
    device: str,
    matte: bool,
) -> Callable[[int], Frame] | None:
    """The same, appearance edited on a device; None where the host does it."""
    if device == "cpu" or not scene.appearance or scene.episode.views[name].radiance:
        return None
    from rpaug.compose import batched  # only here: it brings torch

    if not batched.editable(scene):
        return None

    def bases(t: int) -> tuple[batched.Base, Bool[np.ndarray, "h w"]]:
        (rgb, depth, ids), hole, now = filled(t)
        return batched.Base(rgb, depth, ids, *_told(scene, name, stood, t, ids, now, matte)), hole

    images = batched.ahead_over(scene, name, device, bases)

    def frame(t: int) -> Frame:
        image, base, hole = images(t)
        return Frame(image, base.depth, base.ids, hole)

    return frame


def _light(
    scene: Scene, name: str, t: int, ids: Int32[np.ndarray, "h w"]
) -> Float32[np.ndarray, "h w"] | None:
    """The recorded share of light, where what is shown was recorded there."""
    view = scene.episode.views[name]
    known = intrinsic.share(scene, name, t) if view.ids else None
    return None if known is None or not view.ids else np.where(ids == view.ids(t), known, 1)


def _blended(
    scene: Scene,
    surfels_frame: Callable[[int], Frame],
    name: str,
    instance_ids: frozenset[int],
    t: int,
) -> Frame:
    """Surfels, but where both carriers show one of the instance ids everything is the Gaussians'."""
    base, over = surfels_frame(t), _gaussians(scene, name, recast.of(scene), t)
    ours = np.isin(base.ids, list(instance_ids)) & (over.ids == base.ids) & ~over.hole
    return Frame(
        np.where(ours[..., None], over.rgb, base.rgb),
        np.where(ours, over.depth, base.depth),
        base.ids,
        base.hole & ~ours,
    )


def _gaussians(
    shown: "Scene | fill_gaussians.Patched", name: str, cast: recast.Recast | None, t: int
) -> Frame:
    from rpaug.gaussians import (  # only here: they bring the rasteriser
        fill_gaussians,
        gaussian_view,
    )

    whole = fill_gaussians.Patched(shown) if isinstance(shown, Scene) else shown
    scene = whole.scene
    rgb, depth, ids, index = gaussian_view.seen(scene, name, t)
    empty = depth == 0
    drawn = Rendered(
        rgb.astype(np.float32) / 255, depth, ids, -empty.astype(np.int16), empty, empty
    )
    filled = holes.fill(drawn)
    camera = gaussian_view.standing(scene, name)
    rgb, depth, ids = inserted.draw(scene, camera, t, (filled.image, filled.depth, filled.ids))
    if cast is not None:
        rgb = recast.times(rgb, cast.gain(camera, t, depth, ids))
    where = gaussian_view.surfaces(depth, ids, camera, t, scene.bodies)
    # Gaussians blend, so an outline's pixel is a mixture however sharp the recording was.
    image = composite(rgb, ids, scene.appearance, True, where)
    if cast is not None and cast.relit.gains:
        image = recast.times(image, cast.tint(camera, t, depth, ids, None))
    made_up = empty | whole.invented(t, index)
    return Frame(image, depth, ids, made_up & (ids == filled.ids))
