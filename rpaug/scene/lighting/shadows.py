"""Shadows that standing things cast on the table: found where a recording has them, sent along with edited things.

A lamp far away darkens the same share of light on all that a thing hides from it. Where a direction is a lamp's, the
table is darker inside the outlines that all standing things cast along it than just outside. What moves tells more: its
shadow comes and goes, and the table's own pattern does not. Outlines are the convex outlines of what was seen of the
things. Only the table's own shading is changed, by one factor per lamp and place.

In photographs there is light from all sides too, and what is put in keeps a part of it from the table at its foot. A
simulator's renderer has nothing of the kind; so this is done only for sources without masks, which simulators have.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import chain
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64

from rpaug.core import geometry, sampling
from rpaug.core.memo import last
from rpaug.core.pixels import grown
from rpaug.core.types import Body, Relit, Rig, Scene, Surface
from rpaug.scene.lighting import light, rig
from rpaug.scene.placement import free_space, placing
from rpaug.scene.placement.placing import hull, points_by_instance_id, points_of

CELL, COARSE = (
    0.005,
    0.01,
)  # metres: shadows are drawn in cells of the first, lamps sought in the second
REACH = 0.3  # metres around the support's seen part in which shadows are drawn
LOWEST, HIGHEST = np.deg2rad(15.0), np.deg2rad(80.0)  # above the horizon
HEADINGS, HEIGHTS = 40, 8  # directions tried
FINER = 4  # times that directions around the best are tried in half the steps
LEAST = 0.1  # share of light that a shadow has to take to count
SURE = 4.0  # standard errors by which a shadow is darker than what lies beside it
AGREE = (
    0.75  # of the things, at least, that show a lamp's shadow each by itself, where it can be told
)
MOST_LAMPS = 3
FEW = 12  # cells
LOOKS = 8  # frames at which the shadows of what moves are looked for
CORNERS = 96  # directions in which a thing's outline is kept
AT_ONCE = 1024  # points whose corners are looked for at once
BESIDE = 3  # cells around an outline that it is compared with
SOFT = 0.7  # cells: standard deviation of a shadow's edge
THICK = 0.006  # metres: what is lower casts nothing worth drawing
APART = 0.03  # metres off the support's level from which a surface is not the support: depth is noisy by less
ROW = 256  # places looked up in one row: OpenCV takes no longer ones than 32767
RINGS, SECTORS = 12, 48  # of the sky, each as bright as another on level ground
SKY = 0.8  # of the light that a thing keeps away is lost: the rest comes off its own sides


@dataclass(frozen=True)
class Shade:
    """A factor on the colors of the support by place: cell (row, column) is about `origin + CELL * (column, row)`.

    What of the support's instances lies `APART` or more above or below its `level` (legs, an apron) is another place.
    """

    instance_ids: frozenset[int]
    origin: tuple[float, float]
    level: float
    gain: Float32[np.ndarray, "r c"]

    def __call__(
        self, color: Float32[np.ndarray, "n 3"], surface: Surface
    ) -> Float32[np.ndarray, "n 3"]:
        at = (surface.points[:, :2] - np.array(self.origin, np.float32)) / np.float32(CELL)
        rest = -len(at) % ROW
        x, y = np.pad(at.T.astype(np.float32), ((0, 0), (0, rest))).reshape(2, -1, ROW)
        found = cv2.remap(self.gain, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        level = np.abs(surface.points[:, 2] - np.float32(self.level)) < APART
        factor = np.where(level, found.ravel()[: len(at)], np.float32(1))
        return np.clip(color * factor[:, None], 0, 1).astype(np.float32)


@dataclass(frozen=True)
class CastShadow:
    """One lamp's shadow on the support's top, gone from the outlines `before` and fallen on the outlines `after`.

    Outlines are convex and run around what the lamp does not reach: (n, 2) metres each. An edge is a pixel wide.
    """

    instance_ids: frozenset[int]
    level: float
    share: float  # of the support's light
    before: tuple[Float64[np.ndarray, "n 2"], ...]
    after: tuple[Float64[np.ndarray, "n 2"], ...]

    def __call__(
        self, color: Float32[np.ndarray, "n 3"], surface: Surface
    ) -> Float32[np.ndarray, "n 3"]:
        rows = np.flatnonzero(np.abs(surface.points[:, 2] - np.float32(self.level)) < APART)
        at, pixel = surface.points[rows, :2], surface.footprint[rows]
        was, now = (_covered(at, pixel, outlines) for outlines in (self.before, self.after))
        out = color.copy()
        out[rows] *= ((1 - self.share * now) / (1 - self.share * was))[:, None]
        return np.clip(out, 0, 1)


def _covered(
    at: Float32[np.ndarray, "n 2"],
    pixel: Float32[np.ndarray, "n"],
    outlines: Sequence[Float64[np.ndarray, "k 2"]],
) -> Float32[np.ndarray, "n"]:
    """How much of each pixel at these places lies within one of the convex outlines, 0..1."""
    out = np.zeros(len(at), np.float32)
    wide = pixel[:, None] / 2
    for corners in outlines:
        near = (at > corners.min(0) - wide) & (at < corners.max(0) + wide)
        rows = np.flatnonzero(near.all(1))
        along = np.roll(corners, -1, 0) - corners
        inwards = np.stack([-along[:, 1], along[:, 0]], 1) / np.linalg.norm(along, axis=1)[:, None]
        depth = (at[rows] @ inwards.T - (corners * inwards).sum(1)).min(1)
        out[rows] = np.maximum(out[rows], np.clip(0.5 + depth / pixel[rows], 0, 1))
    return out


@dataclass(frozen=True)
class _SupportPlane:
    """The support from above: its origin, level and shape in cells, and what stands on it."""

    instance_ids: frozenset[int]
    origin: Float64[np.ndarray, "2"]
    level: float
    cell: float
    shape: tuple[int, int]


def relit(scene: Scene) -> Relit | None:
    """The lamps whose shadows the scene shows, recorded and now; None where moving shadows do not tell them."""
    if scene.relit is not None:
        return scene.relit
    known = rig.find(scene)
    return None if known is None else Relit(known, known, unlit=light.unlit(scene.episode))


Cast = Mapping[str, Any] | Sequence[Sequence[float]]
"""The lamps that cast the recorded shadows, as plain values: all that light the scene (`Rig`), or those that are told
by the table's shadows alone, each by its direction and the share of light that it takes there."""


def lamps(scene: Scene) -> Cast:
    """The lamps that an edited thing's shadow follows.

    Those of the whole scene where moving shadows tell them. Else directions to the lamps that cast shadows on the
    table, and the share of light that each takes: (x, y, z, share). Empty where the recording has no shadows, or no
    fixed camera saw a table to see them on.
    """
    known = relit(scene)
    return of_table(scene) if known is None else plain(known.recorded)


def of_table(scene: Scene) -> list[list[float]]:
    """Lamps by the recorded shadows on the table alone: what was edited casts none of them."""
    return _lamps(rig.recorded(scene))


def plain(lamps: Rig) -> dict[str, Any]:
    """Lamps as plain values."""
    directions = [list(one) for one in lamps.directions]
    return {"ambient": lamps.ambient, "directions": directions, "strengths": list(lamps.strengths)}


def rig_of(cast: Mapping[str, Any]) -> Rig:
    """Lamps from plain values."""
    directions = tuple((float(x), float(y), float(z)) for x, y, z in cast["directions"])
    return Rig(float(cast["ambient"]), directions, tuple(map(float, cast["strengths"])))


@last
def _lamps(scene: Scene) -> list[list[float]]:
    table = None if placing.roving(scene) else _table(scene, COARSE)
    looks = [] if table is None else _looks(scene, table)
    if table is None or not looks:
        return []
    found: list[list[float]] = []
    for _ in range(MOST_LAMPS):
        best, share, sure = _surest(looks, table)
        if share < LEAST or sure < SURE:
            break
        alone = [_contrast([look for look in looks if look.relative], best, table)]
        alone += [
            _contrast([replace(look, things=[one])], best, table)
            for look in looks
            for one in look.things
            if not look.relative
        ]
        given = [one_share > LEAST / 2 for one_share, one_sure in alone if one_sure != 0]
        if np.mean(given) < AGREE if given else True:
            break
        found.append([round(float(value), 5) for value in (*best, share)])
        looks = [_without(look, best, share, table) for look in looks]
    return found


@dataclass(frozen=True)
class _Look:
    """The support's light by cell, levels of 255 or nan, the cells that things stand on, and the outlines of each
    thing that may cast a shadow there. Light that is `relative` is 255 where the cell is as bright as it ever is."""

    light: Float64[np.ndarray, "r c"]
    covered: Bool[np.ndarray, "r c"]
    things: list[list[Float64[np.ndarray, "n 3"]]]
    relative: bool

    @property
    def outlines(self) -> list[Float64[np.ndarray, "n 3"]]:
        return list(chain.from_iterable(self.things))

    @cached_property
    def known(self) -> Bool[np.ndarray, "r c"]:
        """The cells whose light is known, and nothing stands on them."""
        return ~self.covered & ~np.isnan(self.light)

    @cached_property
    def logs(self) -> Float64[np.ndarray, "r c"]:
        return np.asarray(np.log(np.maximum(self.light, 1)))


def _looks(scene: Scene, table: _SupportPlane) -> list[_Look]:
    """What stands, on the table as bright as it ever is; and frames of what moves, relative to that.

    Without things of either kind its looks are left out.
    """
    frames = sampling.frames(scene.episode.length, LOOKS)
    light = np.stack(
        [_brightness(scene, table, t) for t in frames]
    )  # frames, cameras, rows, columns
    most = np.fmax.reduce(light, axis=0)
    standing = list(_outlines(scene, table))
    covered = _filled([points[:, :2] for points in standing], table)
    looks = [_Look(_mean(most), covered, [[one] for one in standing], False)]
    for t, now in zip(frames, light, strict=True):
        moving = list(_moving(scene, table, t))
        below = [points[:, :2] for points in moving if points[:, 2].min() < free_space.MARGIN]
        looks.append(
            _Look(_mean(255 * now / most), covered | _filled(below, table), [moving], True)
        )
    return [look for look in looks if any(look.things)]


def _without(
    look: _Look, direction: Float64[np.ndarray, "3"], share: float, table: _SupportPlane
) -> _Look:
    """The look without one lamp's shadows. What is left at the edges of a shadow that moved is no other lamp's."""
    shadow = _cast(look.outlines, direction, table)
    light = np.where(shadow, look.light / (1 - share), look.light)
    if look.relative:
        light[grown(shadow, BESIDE) & grown(~shadow, BESIDE)] = np.nan
    return replace(look, light=light)


def _mean(light: Float64[np.ndarray, "k r c"]) -> Float64[np.ndarray, "r c"]:
    """Over cameras, by cell; nan where none knows it."""
    count = (~np.isnan(light)).sum(0)
    return np.divide(np.nansum(light, 0), count, out=np.full(count.shape, np.nan), where=count > 0)


def follow(before: Scene, after: Scene, cast: Cast) -> Scene:
    """The edited scene with the shadows of what was edited where the things are now. `cast` are `lamps`."""
    if isinstance(cast, Mapping):
        known = rig_of(cast)
        unlit = light.unlit(before.episode)
        return replace(after, relit=before.relit or Relit(known, known, unlit=unlit))
    table = _table(before, CELL) if cast else None
    if table is None:
        return after
    old, new = list(_outlines(before, table)), list(_outlines(after, table))
    fallen = []
    for *direction, share in cast:
        was, now = (
            [one for points in outlines if len(one := hull(_slid(points, np.array(direction)))) > 2]
            for outlines in (old, new)
        )
        if list(map(np.ndarray.tobytes, was)) != list(map(np.ndarray.tobytes, now)):
            shadow = CastShadow(table.instance_ids, table.level, share, tuple(was), tuple(now))
            fallen.append(shadow)
    return replace(after, appearance=(*after.appearance, *fallen)) if fallen else after


def grounded(before: Scene, after: Scene) -> Scene:
    """The edited scene with the support darker at the foot of what was put in, where the recording is photographs.

    The darkening is the part of an even sky, weighted by the cosine, that the thing's convex outline covers (ambient
    occlusion; Zhukov, Iones and Kronin 1998).
    """
    table = _photographed(before)
    known = {body.instance_ids for body in before.bodies}
    new = [
        geometry.transform(body.to_world[0], body.mesh.points) - [0, 0, table.level]
        for body in after.bodies
        if table is not None and body.mesh is not None and body.instance_ids not in known
    ]
    if table is None or not new:
        return after
    sky = _sky()
    gain = np.ones(table.shape, np.float32)
    for direction in sky:
        gain -= np.float32(SKY / len(sky)) * _soft(_cast(new, direction, table))
    x, y = table.origin.tolist()
    shade = Shade(table.instance_ids, (x, y), table.level, gain)
    return replace(after, appearance=(*after.appearance, shade))


def _photographed(scene: Scene) -> _SupportPlane | None:
    """The support in finer cells, if no view came with masks."""
    instance_ids = scene.roles.get("table")
    if not instance_ids or not all(view.inferred for view in scene.episode.views.values()):
        return None
    around = placing.find_free_space(scene)
    rows, columns = (round(n * free_space.CELL / CELL) for n in around.seen.shape)
    return _SupportPlane(instance_ids, around.origin, around.level, CELL, (rows, columns))


def _table(scene: Scene, cell: float) -> _SupportPlane | None:
    instance_ids = scene.roles.get("table")
    if not instance_ids or any(
        v.depth is None or v.ids is None for v in scene.episode.views.values()
    ):
        return None
    points = points_of(scene, instance_ids, 1)
    if not len(points):
        return None
    level = float(np.median(points[:, 2]))
    points = points[np.abs(points[:, 2] - level) < placing.LEVEL, :2]
    low, high = points.min(0) - REACH, points.max(0) + REACH
    columns, rows = np.ceil((high - low) / cell).astype(int) + 1
    return _SupportPlane(instance_ids, low, level, cell, (int(rows), int(columns)))


def _outlines(scene: Scene, table: _SupportPlane) -> Iterator[Float64[np.ndarray, "n 3"]]:
    """Points of each standing thing, where it is now, heights above the table."""
    for body in scene.bodies:
        if body.motion != "static" or body.soft or body.instance_ids & table.instance_ids:
            continue
        for points in _points(scene, body):
            points = points - [0, 0, table.level]
            small = np.ptp(points[:, :2], axis=0).max() < 1.0 if len(points) else False
            if small and points[:, 2].max() > THICK and points[:, 2].min() < free_space.MARGIN:
                yield _corners(points)


def _points(scene: Scene, body: Body) -> Iterator[Float64[np.ndarray, "n 3"]]:
    if body.mesh is not None:
        yield geometry.transform(body.to_world[0], body.mesh.points)
        return
    names = body.copy_of or {instance_id: instance_id for instance_id in body.instance_ids}
    for source in names:
        recorded = next(one for one in scene.tracked if source in one.instance_ids)
        own = geometry.transform(
            geometry.inverse(recorded.to_world[0]), points_of(scene, [source], 2)
        )
        if len(own) > 3:
            yield geometry.transform(body.to_world[0], body.scale * own)


def _moving(scene: Scene, table: _SupportPlane, t: int) -> Iterator[Float64[np.ndarray, "n 3"]]:
    """The same of each rigid instance that moves, where it is at t, whether it stands on the table or not."""
    moving = {
        one: body
        for body in scene.bodies
        if body.motion != "static" and not body.soft
        for one in body.instance_ids
    }
    for one, points in points_by_instance_id(scene, moving, 2).items():
        if len(points) > 3:
            to_world = moving[one].to_world
            motion = to_world[t] @ geometry.inverse(to_world[0])
            yield _corners(geometry.transform(motion, points) - [0, 0, table.level])


def _corners(points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "m 3"]:
    """The points that lie outermost in one of many directions: first of some at a time, which a cache holds."""
    some = np.array_split(points, max(1, len(points) // AT_ONCE))
    return _outermost(np.concatenate([_outermost(one) for one in some]))


def _outermost(points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "m 3"]:
    return points[np.unique((points @ _sphere().T).argmax(0))]


@cache
def _sphere() -> Float64[np.ndarray, "d 3"]:
    """Directions spread evenly (a Fibonacci lattice)."""
    number = np.arange(CORNERS) + 0.5
    z, turn = 1 - 2 * number / CORNERS, np.pi * (1 + 5**0.5) * number
    flat = np.sqrt(1 - z * z)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], -1)


def _brightness(scene: Scene, table: _SupportPlane, t: int) -> Float64[np.ndarray, "k r c"]:
    """The table's brightness by fixed camera and cell at t; nan where a camera does not see it."""
    out = []
    for view in scene.episode.views.values():
        if not view.camera.fixed or view.depth is None or view.ids is None:
            continue
        use = np.isin(view.ids(t), list(table.instance_ids)) & (view.depth(t) > 0)
        use = placing.thinned(view.camera, view.depth(t), use)
        points = placing.lifted(view.camera, t, view.depth(t), use)
        columns, rows = np.rint((points[:, :2] - table.origin) / table.cell).astype(int).T
        good = (np.abs(points[:, 2] - table.level) < placing.LEVEL) & (rows >= 0) & (columns >= 0)
        good &= (rows < table.shape[0]) & (columns < table.shape[1])
        cells, size = rows[good] * table.shape[1] + columns[good], table.shape[0] * table.shape[1]
        bright = view.rgb(t)[use][good].mean(-1)
        total, count = (
            np.bincount(cells, weights, size).reshape(table.shape) for weights in (bright, None)
        )
        out.append(np.divide(total, count, out=np.full(table.shape, np.nan), where=count > 0))
    return np.stack(out)


def _surest(
    looks: Sequence[_Look], table: _SupportPlane
) -> tuple[Float64[np.ndarray, "3"], float, float]:
    """The direction whose shadows are surest, of a grid and then of finer ones around the best; as `_contrast` says."""
    headings = 2 * np.pi * np.arange(HEADINGS) / HEADINGS
    heights = np.linspace(LOWEST, HIGHEST, HEIGHTS)
    steps = np.array([headings[1], heights[1] - heights[0]])
    tried = [(heading, up) for up in heights for heading in headings]
    for _ in range(FINER + 1):
        scores = [_contrast(looks, _towards(*angles), table) for angles in tried]
        best = int(np.argmax([sure for _, sure in scores]))
        angles, (share, sure) = tried[best], scores[best]
        steps = steps / 2
        tried = [tuple(angles + steps * (i, j)) for i in (0, -1, 1) for j in (0, -1, 1)]
    return _towards(*angles), share, sure


def _contrast(
    looks: Sequence[_Look], direction: Float64[np.ndarray, "3"], table: _SupportPlane
) -> tuple[float, float]:
    """Share of light that is missing in the shadows along a direction, and by how many standard errors, over the looks
    that can tell."""
    cast = [_cast(look.outlines, direction, table) for look in looks]
    bare = [look.known & ~shadow for look, shadow in zip(looks, cast, strict=True) if look.relative]
    comes_and_goes = np.any(bare, 0) if bare else np.zeros(table.shape, bool)
    offs, weights = [], []
    for look, shadow in zip(looks, cast, strict=True):
        x, y, wide, high = cv2.boundingRect(shadow.view(np.uint8))
        rows = slice(max(0, y - BESIDE), y + high + BESIDE)
        near = rows, slice(max(0, x - BESIDE), x + wide + BESIDE)
        use = look.known[near] & comes_and_goes[near] if look.relative else look.known[near]
        shadow, logs = shadow[near], look.logs[near]
        inside, beside = logs[shadow & use], logs[grown(shadow, BESIDE) & ~shadow & use]
        if len(inside) >= FEW and len(beside) >= FEW:
            error = np.hypot(
                inside.std() / np.sqrt(len(inside)), beside.std() / np.sqrt(len(beside))
            )
            offs.append(float(np.median(beside) - np.median(inside)))
            weights.append(1 / max(float(error), 1e-3) ** 2)
    if not offs:
        return 0.0, 0.0
    off = float(np.average(offs, weights=weights))
    return 1 - float(np.exp(-off)), off * float(np.sqrt(sum(weights)))


def _cast(
    casters: Sequence[Float[np.ndarray, "n 3"]],
    direction: Float[np.ndarray, "3"],
    table: _SupportPlane,
) -> Bool[np.ndarray, "r c"]:
    """Cells that lie in the shadow of one of the casters."""
    ends = np.cumsum([len(points) for points in casters])[:-1]
    return _filled(np.split(_slid(np.concatenate(casters), direction), ends), table)


def _slid(
    points: Float[np.ndarray, "n 3"], direction: Float[np.ndarray, "3"]
) -> Float64[np.ndarray, "n 2"]:
    """Where the shadows of points, heights above the support, fall on it."""
    return points[:, :2] - np.maximum(points[:, 2:], 0) * (direction[:2] / direction[2])


def _filled(
    parts: Sequence[Float[np.ndarray, "n 2"]], table: _SupportPlane
) -> Bool[np.ndarray, "r c"]:
    mask = np.zeros(table.shape, np.uint8)
    hulls = [hull(points) for points in parts]
    corners = np.concatenate([np.zeros((0, 2)), *hulls]) - table.origin
    fixed, start = np.rint(16 * (corners / table.cell)).astype(np.int32), 0
    for outline in hulls:
        cv2.fillConvexPoly(mask, fixed[start : start + len(outline)], 1, shift=4)
        start += len(outline)
    return mask.view(bool)


def _soft(mask: Bool[np.ndarray, "r c"]) -> Float32[np.ndarray, "r c"]:
    return np.asarray(cv2.GaussianBlur(mask.astype(np.float32), (0, 0), SOFT), np.float32)


def _sky() -> list[Float64[np.ndarray, "3"]]:
    """Unit vectors to parts of the sky from which level ground gets the same light each."""
    heights = np.arcsin(np.sqrt((np.arange(RINGS) + 0.5) / RINGS))
    turns = 2 * np.pi * np.arange(SECTORS) / SECTORS
    return [_towards(turn, up) for up in heights for turn in turns]


def _towards(heading: float, up: float) -> Float64[np.ndarray, "3"]:
    """The unit vector to where a lamp may be."""
    return np.array([np.cos(up) * np.cos(heading), np.cos(up) * np.sin(heading), np.sin(up)])
