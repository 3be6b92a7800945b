"""An episode split into what its surfaces are and the cast shadows on them.

Each lamp reaches a place or does not, so that a pixel has one of few lights. Which one, known surfaces say (`casting`),
to within a pixel or two; the pixel itself says the rest: of the lights that are possible there, the one under which its
thing has the albedo that it has elsewhere. A camera that stands still sees a resting place at many times, whose albedo
is then the median over them, and what is left at each time is light (Weiss 2001), exact to the pixel.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import cv2
import numpy as np
from jaxtyping import Float32, Int32, UInt8

from rpaug.core import memo, sampling
from rpaug.core.image_cache import held, shelved
from rpaug.core.types import CameraView, Episode, Rig, Scene
from rpaug.scene.lighting import casting, highlights, rig
from rpaug.scene.recorded import lit

TIMES = 6  # at which the albedo of what rests is looked for
DARK = 2.0 / 255  # brightness below which nothing tells
ALIKE = 0.03  # log brightness by which one albedo is known at best
STRANGE = 3.0  # spreads: a light that misses an albedo by more is as bad as any
TRUST = 3.0  # squared spreads that it costs a lamp to be another than the surfaces say
UNSEEN = 1.0  # the same for walls and floor: much of what casts shadows there is in no image
EDGE = 7  # pixels wide: the map's edge of a shadow lies within so much of the recorded one
SHARP = 0.05  # of a lamp's light, from which the map changes
AWAY = 4.0  # times as much trust away from such edges
EDGED = 0.1  # log light by which neighbours differ, from which a shadow ends there
NEAR = 5  # pixels wide: neighbours that have the same light more often than not
ROUNDS = 3  # of albedo and spread
WELL_LIT = 0.98  # quantile of the light on a thing
SOLID = 60  # pixels of a thing, from which its albedo is known
MOST_BYTES = 64 << 20  # of images without shadows, and of their light, that are kept


def share(scene: Scene, name: str, t: int) -> Float32[np.ndarray, "h w"] | None:
    """Of the light that each pixel would have without cast shadows, what it has: 1 where nothing tells.

    Where no lamps are known, shadows that wander over what rests are told by the same pixel at other times (`lit`).
    """
    bare, lamps = _matte(scene)
    return (
        lit.share(scene.episode, name, scene.moving, t)
        if lamps is None
        else _share(bare, lamps, name, t)
    )


def _share(bare: Scene, lamps: Rig, name: str, t: int) -> Float32[np.ndarray, "h w"] | None:
    view = bare.episode.views[name]
    if view.depth is None or view.ids is None:
        return None
    found = _lights(bare, lamps)(name, t)
    if name not in _resting(bare, lamps):
        return found
    ids, lasting = _resting(bare, lamps)[name]
    level = _level(view.rgb(t))
    known = (view.ids(t) == ids) & (lasting > np.log(DARK))
    lights = np.clip(np.exp(level - lasting), lamps.ambient / 2, 1)
    return np.where(known, lights, found).astype(np.float32)


def unshadowed(scene: Scene) -> Episode:
    """The recorded episode as it would be if nothing shone or cast a shadow; itself where no lamps are known."""
    bare, lamps = _matte(scene)
    return bare.episode if lamps is None else _unshadowed(bare, lamps)


def _matte(scene: Scene) -> tuple[Scene, Rig | None]:
    """The scene as it was recorded, without highlights, and the lamps whose shadows pass over it."""
    return matte(scene), rig.find(scene)


def matte(scene: Scene) -> Scene:
    """The scene as it was recorded, without highlights."""
    return replace(rig.recorded(scene), episode=highlights.matte(scene))


def share_of(scene: Scene, lamps: Rig, name: str, t: int) -> Float32[np.ndarray, "h w"] | None:
    """`share` by lamps that are known; None for a camera that does not tell where surfaces lie."""
    return _share(matte(scene), lamps, name, t)


def evened(
    rgb: UInt8[np.ndarray, "h w 3"], share: Float32[np.ndarray, "h w"]
) -> UInt8[np.ndarray, "h w 3"]:
    """An image as it would be, had each pixel all its light and not just this share."""
    return np.minimum(np.rint(rgb / share[..., None]), 255).astype(np.uint8)


@memo.last
def _unshadowed(scene: Scene, lamps: Rig) -> Episode:
    def rgb(name: str, view: CameraView, t: int) -> UInt8[np.ndarray, "h w 3"]:
        found = _share(scene, lamps, name, t)
        return view.rgb(t) if found is None else evened(view.rgb(t), found)

    views = {
        name: replace(view, rgb=partial(rgb, name, view), radiance=None)
        for name, view in scene.episode.views.items()
    }
    return shelved(replace(scene.episode, views=views), MOST_BYTES)


def best_light(scene: Scene, instance_id: int) -> float:
    """The light on a thing's best-lit part, 1 that on level ground, and at most: less where it has none that faces the
    lamps. 1 where no lamps are known."""
    bare, lamps = _matte(scene)
    if lamps is None:
        return 1.0
    found = _albedos(bare, lamps).get(instance_id)
    return 1.0 if found is None else found.best_light


@dataclass(frozen=True)
class _Surfaces:
    """A thing's log brightness without cast shadows, by how much its pattern spreads it, and the light on its best-lit
    part."""

    level: float
    spread: float
    best_light: float


@memo.last
def _albedos(scene: Scene, lamps: Rig) -> Mapping[int, _Surfaces]:
    """Of each thing the albedo that leaves least unexplained when each pixel has the light that suits it best."""
    found: dict[int, list[tuple[np.ndarray, ...]]] = {}
    for t in sampling.frames(scene.episode.length, rig.FRAMES):
        for name, view in scene.episode.views.items():
            if view.depth is None or view.ids is None:
                continue
            seen = _candidates(scene, name, t, lamps)
            level = _level(view.rgb(t)).reshape(-1)
            inside = lit.inside(view.ids(t)).reshape(-1) & (level > np.log(DARK))
            for one in np.unique(view.ids(t)).tolist():
                rows = np.flatnonzero(inside & (view.ids(t).reshape(-1) == one))
                rows = rows[:: max(1, len(rows) // SOLID)]
                if len(rows):
                    own = level[rows, None] - seen.light[rows]
                    found.setdefault(one, []).append((own, seen.doubt[rows], seen.full[rows]))
    joined = {
        one: [np.concatenate(some) for some in zip(*parts, strict=True)]
        for one, parts in found.items()
    }
    return {
        one: _Surfaces(*_likeliest(own, doubt), min(float(np.quantile(full, WELL_LIT)), 1.0))
        for one, (own, doubt, full) in joined.items()
        if len(own) >= SOLID
    }


def _likeliest(
    albedo: Float32[np.ndarray, "n s"], doubt: Float32[np.ndarray, "n s"]
) -> tuple[float, float]:
    """The log albedo and its spread, of pixels that would have these under each light: both from each other."""
    own = np.take_along_axis(albedo, doubt.argmin(1)[:, None], 1)[:, 0]
    best = float(np.median(own))
    spread = max(1.4826 * float(np.median(np.abs(own - best))), ALIKE)
    for _ in range(ROUNDS):
        tried = np.linspace(best - 0.2, best + 1.2, 57)
        costs = [(_misfit(albedo - one, spread) + doubt).min(1).mean() for one in tried]
        best = float(tried[int(np.argmin(costs))])
        chosen = (_misfit(albedo - best, spread) + doubt).argmin(1)
        own = np.take_along_axis(albedo, chosen[:, None], 1)[:, 0]
        spread = max(1.4826 * float(np.median(np.abs(own - best))), ALIKE)
    return best, spread


def _misfit(
    off: Float32[np.ndarray, "*n"], spread: float | Float32[np.ndarray, "n 1"]
) -> Float32[np.ndarray, "*n"]:
    return np.minimum((off / spread) ** 2, STRANGE**2)


@dataclass(frozen=True)
class _Candidates:
    """By pixel and by which lamps reach it: log of the share of light, and how much known surfaces speak against
    it. `full` is the light where all lamps reach."""

    light: Float32[np.ndarray, "n s"]
    doubt: Float32[np.ndarray, "n s"]
    full: Float32[np.ndarray, "n"]


def _candidates(scene: Scene, name: str, t: int, lamps: Rig) -> _Candidates:
    view = scene.episode.views[name]
    rows = np.arange(view.camera.height * view.camera.width)
    _, places = casting.discs_of(view, t, rows)
    maps = casting.casters(scene).maps(t, lamps.directions)
    reached = [one.reached(places) for one in maps]
    full = lamps.light(places.normals, [1.0] * len(reached))
    states = np.array(list(product((1.0, 0.0), repeat=len(reached))), np.float32)
    light = (_apart(lamps, places.normals) @ states.T + np.float32(lamps.ambient)) / full[:, None]
    sure = np.stack([_sure(one, (view.camera.height, view.camera.width)) for one in reached], 1)
    share = np.stack(reached, 1)
    doubt = (sure * (1 - share)) @ states.T + (sure * share) @ (1 - states).T
    walls = np.isin(view.ids(t), sorted(scene.roles.get("background", ()))).reshape(-1, 1)  # type: ignore[misc]
    trust = np.where(walls, np.float32(UNSEEN), np.float32(TRUST))
    return _Candidates(np.log(light), trust * doubt, full)


def _apart(lamps: Rig, normals: Float32[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n l"]:
    """The light of each lamp on surfaces that it reaches."""
    towards = np.maximum(normals @ np.array(lamps.directions, np.float32).T, 0)
    return towards * np.array(lamps.strengths, np.float32)


def _sure(reached: Float32[np.ndarray, "n"], shape: tuple[int, int]) -> Float32[np.ndarray, "n"]:
    """How much more surfaces are trusted than at the edge of a shadow: where all around is reached alike."""
    image, kernel = reached.reshape(shape), np.ones((EDGE, EDGE), np.uint8)
    alike = cv2.dilate(image, kernel) - cv2.erode(image, kernel) < SHARP
    return np.where(alike, AWAY, 1).astype(np.float32).reshape(-1)


@memo.last
def _lights(scene: Scene, lamps: Rig) -> Callable[[str, int], Float32[np.ndarray, "h w"]]:
    """`_by_light` of an image; the last ones are kept for further copies."""
    return held(partial(_by_light, scene, lamps), MOST_BYTES)


def _by_light(scene: Scene, lamps: Rig, name: str, t: int) -> Float32[np.ndarray, "h w"]:
    """The share by the lights that are possible, each pixel with its neighbours."""
    view = scene.episode.views[name]
    ids, level = view.ids(t), _level(view.rgb(t))  # type: ignore[misc]
    seen = _candidates(scene, name, t, lamps)
    albedos = _albedos(scene, lamps)
    shown, where = np.unique(ids, return_inverse=True)
    nothing = _Surfaces(np.nan, 1.0, 1.0)
    each = [albedos.get(one, nothing) for one in shown.tolist()]
    known = np.array([one.level for one in each], np.float32)[where.reshape(ids.shape)]
    spread = np.array([one.spread for one in each], np.float32)[where.reshape(-1, 1)]
    off = (level - known).reshape(-1, 1) - seen.light
    fits = np.where(np.isnan(off), 0, _misfit(off, spread))
    cost = (fits + seen.doubt).reshape(*ids.shape, -1).astype(np.float32)
    chosen = _with_neighbours(cost, ids).argmin(-1)
    light = np.take_along_axis(seen.light.reshape(cost.shape), chosen[..., None], -1)[..., 0]
    light = _at_edges(light, level, ids)
    return np.where(ids > 0, np.exp(light), 1).astype(np.float32)


def _at_edges(
    light: Float32[np.ndarray, "h w"],
    level: Float32[np.ndarray, "h w"],
    ids: Int32[np.ndarray, "h w"],
) -> Float32[np.ndarray, "h w"]:
    """Log light, at the edge of a shadow as much between both sides as makes the albedo that of what is around."""
    kernel = np.ones((3, 3), np.uint8)
    low, high = cv2.erode(light, kernel), cv2.dilate(light, kernel)
    edge, pure = high - low > EDGED, lit.inside(ids)
    known = (pure & ~edge).astype(np.float32)
    size = (NEAR, NEAR)
    weight = cv2.boxFilter(known, -1, size)
    own = cv2.boxFilter(known * (level - light), -1, size) / np.maximum(weight, 1e-6)
    between = np.clip(level - own, low, high)
    return np.where(edge & pure & (weight > 0), between, light).astype(np.float32)


def _with_neighbours(
    cost: Float32[np.ndarray, "h w s"], ids: Int32[np.ndarray, "h w"]
) -> Float32[np.ndarray, "h w s"]:
    """Costs with the mean of those around a pixel, where these are of the same thing."""
    pure = lit.inside(ids)
    size = (NEAR, NEAR)
    weight = cv2.boxFilter(pure.astype(np.float32), -1, size)
    around = cv2.boxFilter(np.where(pure[..., None], cost, np.float32(0)), -1, size)
    mean = around / np.maximum(weight, 1e-6)[..., None]
    return np.where(weight[..., None] > 0, cost + mean, cost)


@memo.last
def _resting(scene: Scene, lamps: Rig) -> Mapping[str, tuple[np.ndarray, np.ndarray]]:
    """By camera that stands still: which resting thing each pixel shows, -1 for none, and its log brightness without
    shadows."""
    times = sampling.frames(scene.episode.length, TIMES)
    found = {}
    for name, view in scene.episode.views.items():
        if view.depth is None or view.ids is None or not view.camera.fixed:
            continue
        ids = np.stack([view.ids(t) for t in times])
        still = ~np.isin(ids, sorted(scene.moving)) & (ids > 0)
        first = np.take_along_axis(ids, still.argmax(0)[None], 0)[0]
        light = np.stack([_lights(scene, lamps)(name, t) for t in times])
        own = np.stack([_level(view.rgb(t)) for t in times]) - np.log(light)
        own = np.where(still & (ids == first), own, np.nan)
        seen = ~np.isnan(own).all(0)
        lasting = np.full(first.shape, -np.inf, np.float32)
        lasting[seen] = np.nanmedian(own[:, seen], 0)
        found[name] = np.where(seen, first, -1), lasting
    return found


def _level(rgb: UInt8[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w"]:
    return np.log(np.maximum(rgb.mean(-1) / 255, DARK / 2)).astype(np.float32)
