"""Finds the free space on the scene's support: seen, and free of other things and of all that moves, at all times.

The support is looked at from above in cells of a centimetre. What stands still keeps its cells from its foot up.
What moves keeps the cells it ever may be above, as `swept` has it.
"""

from collections.abc import Iterable
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64

from rpaug.core import geometry, sampling
from rpaug.core.errors import SourceLacks, TargetError
from rpaug.core.memo import bare, last
from rpaug.core.types import Body, Camera, Scene
from rpaug.scene.placement import free_space_rgb, swept
from rpaug.scene.placement.free_space import CELL, FreeSpace, cells_of, disc
from rpaug.scene.targets import roles

STILLS = 4  # frames looked at for what stands
ROUNDS = 16  # the same where all cameras move, and each frame shows another part
TWICE = 2  # of those show a part of the support, at least
LEVEL = 0.01  # metres: what is nearer to the plane than this is the support
FLYING = (
    3.0  # times the median distance from a thing's middle: no part of a rod or a box lies so far
)
FINE = 0.002  # metres between pixels: finer ones tell cells of a centimetre nothing more
SPARSE = 0.008  # the same where all cameras move: each frame shows a place by other pixels
BEHIND = 2.0  # times the farthest depth: what lies so far a frame does not show
CLOSED = 3  # cells: gaps between pixels of the support that count as seen


def find_free_space(scene: Scene, leaving: Iterable[int] = ()) -> FreeSpace:
    """The room on the scene's table. `leaving` are instance ids that do not count: they will stand elsewhere.

    Things that an edit put elsewhere count where they are now, and removed ones no more. Raises TargetError if there is
    no table, Unsupported without depth and masks.
    """
    return _room(bare(scene), frozenset(leaving))


@last
def _room(scene: Scene, leaving: frozenset[int]) -> FreeSpace:
    support = scene.roles.get("table")
    if not support:
        doubted = scene.beliefs.get("table")
        reason = "nothing was seen to be the table"
        if doubted is not None and doubted.confidence < roles.BOUND:
            reason = "; ".join(doubted.reasons)
        raise TargetError(f"{reason}, so there is nowhere to put things{_also(scene)}")
    if any(view.proxy for view in scene.episode.views.values()):
        return free_space_rgb.find_free_space(scene, leaving)
    points = _support(scene, support)
    level = float(np.median(points[:, 2]))
    points = points[np.abs(points[:, 2] - level) < LEVEL]
    low, high = points[:, :2].min(0), points[:, :2].max(0)
    shape = tuple((np.ceil((high - low) / CELL).astype(int) + 1)[::-1])
    seen = np.zeros(shape, np.uint8)
    rows, columns, inside = cells_of(points, low, shape)
    seen[rows[inside], columns[inside]] = 1
    seen = cv2.morphologyEx(seen, cv2.MORPH_CLOSE, np.ones((CLOSED, CLOSED), np.uint8))
    showing = seen > 0
    if roving(scene):
        showing &= _agreed(scene, support, low, level, shape)
    nothing = np.full(shape, np.inf, np.float32)
    empty = FreeSpace(low, level, showing, nothing, nothing)
    gone = leaving | support
    empty = replace(empty, seen=showing | _beneath(empty, scene, leaving | _vacated(scene)))
    standing = _standing(empty, scene, gone)
    return replace(standing, swept=swept.lowest(standing, scene, gone))


def _also(scene: Scene) -> str:
    """What putting things in lacks beside a table."""
    try:
        free_space_rgb.together(scene, "a new thing")
    except SourceLacks as error:
        return f"; and {error}"
    return ""


def _beneath(room: FreeSpace, scene: Scene, leaving: frozenset[int]) -> Bool[np.ndarray, "r c"]:
    """Support that nobody sees since things that leave stand on it: cells that they cover and that it surrounds."""
    found = np.zeros(room.seen.shape, bool)
    for points in points_by_instance_id(scene, leaving).values():
        if len(points) < 4:
            continue
        outline = hull(points)
        covered = room.covered(outline)
        size = disc(float(np.ptp(outline, axis=0).max()))
        rim = len(size)
        around = cv2.copyMakeBorder(
            (room.seen | found).astype(np.uint8), *(rim,) * 4, cv2.BORDER_CONSTANT, value=0
        )
        closed = cv2.morphologyEx(around, cv2.MORPH_CLOSE, size)[rim:-rim, rim:-rim]
        found |= covered & (closed > 0)
    return found


def _vacated(scene: Scene) -> frozenset[int]:
    """Instance ids of what an edit took from where it was recorded."""
    now = {one: body.to_world for body in scene.bodies for one in body.instance_ids}
    return frozenset(
        one
        for body in scene.tracked
        for one in body.instance_ids
        if one not in now or not np.array_equal(now[one], body.to_world)
    )


def hull(points: Float[np.ndarray, "n 3"]) -> Float64[np.ndarray, "k 2"]:
    """The convex outline of points seen from above."""
    flat = np.ascontiguousarray(points[:, :2], np.float32)
    return cv2.convexHull(flat)[:, 0].astype(np.float64)


def points_of(
    scene: Scene, instance_ids: Iterable[int], count: int = STILLS
) -> Float64[np.ndarray, "n 3"]:
    """What cameras saw of some recorded instances, in the world of frame 0."""
    found = [
        points
        for points in points_by_instance_id(scene, instance_ids, count).values()
        if len(points)
    ]
    return np.concatenate(found) if found else np.zeros((0, 3))


def points_by_instance_id(
    scene: Scene, instance_ids: Iterable[int], count: int = STILLS
) -> dict[int, Float64[np.ndarray, "n 3"]]:
    """The same for each instance. Images are looked at once, at `count` times, or `ROUNDS` where all cameras move."""
    poses = {
        instance_id: body.to_world for body in scene.tracked for instance_id in body.instance_ids
    }
    found: dict[int, list[Float64[np.ndarray, "n 3"]]] = {
        instance_id: [] for instance_id in instance_ids
    }
    sampled, fine = (max(count, ROUNDS), SPARSE) if roving(scene) else (count, FINE)
    for view in scene.episode.views.values():
        if view.depth is None or view.ids is None:
            continue
        for t in sampling.frames(scene.episode.length, sampled):
            ids, depth = view.ids(t), view.depth(t)
            usable = (depth > 0) & np.isfinite(depth)
            for instance_id in found.keys() & set(np.unique(ids).tolist()):
                use = thinned(view.camera, depth, (ids == instance_id) & usable, fine)
                points, (first, now) = (
                    lifted(view.camera, t, depth, use),
                    poses[instance_id][[0, t]],
                )
                if not np.array_equal(first, now):
                    points = geometry.transform(first @ geometry.inverse(now), points)
                found[instance_id].append(points)
    clouds = {h: np.concatenate(some) if some else np.zeros((0, 3)) for h, some in found.items()}
    guessed = any(v.proxy is not None and v.proxy.modelled for v in scene.episode.views.values())
    return {h: _together(points) for h, points in clouds.items()} if guessed else clouds


def _together(points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """Points without those that a guessed depth, or the outline of something else, put far from the others."""
    if not len(points):
        return points
    away = np.linalg.norm(points - np.median(points, 0), axis=1)
    return points[away <= FLYING * np.median(away)]


def roving(scene: Scene) -> bool:
    """Whether all cameras move, so that each frame shows another part of the scene."""
    return not any(view.camera.fixed for view in scene.episode.views.values())


def _support(scene: Scene, support: frozenset[int]) -> Float64[np.ndarray, "n 3"]:
    """Points of the support as cameras saw it over the episode; one that moves beside fixed ones adds a frame."""
    all_move = roving(scene)
    found = []
    for name, view in scene.episode.views.items():
        if view.depth is None or view.ids is None:
            raise SourceLacks(f"{name}: finding room needs recorded depth and masks")
        sampled = ROUNDS if all_move else STILLS if view.camera.fixed else 1
        for t in sampling.frames(scene.episode.length, sampled):
            depth = view.depth(t)
            use = np.isin(view.ids(t), list(support)) & (depth > 0) & np.isfinite(depth)
            if use.any():
                use = thinned(view.camera, depth, use, SPARSE if all_move else FINE)
                found.append(lifted(view.camera, t, depth, use))
    if not found:
        raise TargetError("the table was never seen, so there is nowhere to put things")
    return np.concatenate(found)


def _agreed(
    scene: Scene,
    support: frozenset[int],
    origin: Float64[np.ndarray, "2"],
    level: float,
    shape: tuple[int, ...],
) -> Bool[np.ndarray, "r c"]:
    """Cells that are the support in most of the frames that look there, and in two at least: one alone may err.

    What is far behind all that a frame shows, another table of a video of which nothing tells where it is, it does not
    look at.
    """
    cells = np.argwhere(np.ones(shape, bool))
    points = np.column_stack([origin + CELL * cells[:, ::-1], np.full(len(cells), level)])
    fair, looked = np.zeros(len(cells)), np.zeros(len(cells))
    for view in scene.episode.views.values():
        assert view.ids is not None
        assert view.depth is not None
        for t in sampling.frames(scene.episode.length, ROUNDS):
            ids = view.ids(t)
            local = geometry.local_points(points, view.camera, t)
            rows, columns, inside = geometry.in_image(local, view.camera.K, ids.shape)
            inside &= local[:, 2] < BEHIND * float(np.max(view.depth(t)))
            looked += inside
            fair[inside] += np.isin(ids[rows[inside], columns[inside]], list(support))
    return ((fair >= TWICE) & (fair >= looked / 2)).reshape(shape)


def _standing(free_space: FreeSpace, scene: Scene, gone: frozenset[int]) -> FreeSpace:
    """Each standing thing takes its cells from its lowest point up."""
    still = free_space.still.copy()
    for body in scene.bodies:
        if body.mesh is not None and not body.instance_ids & gone:
            placed = replace(free_space, still=still).with_thing(
                hull(geometry.transform(body.to_world[0], body.mesh.points))
            )
            still = placed.still.copy()
    standing = [
        (body, source)
        for body, instance_id, source in _things(scene)
        if source not in gone and instance_id not in gone and body.motion == "static"
    ]
    clouds = points_by_instance_id(scene, {source for _, source in standing}, 2)
    for body, source in standing:
        recorded = next(b for b in scene.tracked if source in b.instance_ids)
        own = geometry.transform(geometry.inverse(recorded.to_world[0]), clouds[source])
        points = geometry.transform(body.to_world[0], body.scale * own)
        height = points[:, 2] - free_space.level
        rows, columns, inside = cells_of(points, free_space.origin, still.shape)
        # Of the support's own kind: a floor below, a wall beside.
        inside &= height > -LEVEL
        if inside.any():
            base = max(float(np.quantile(height[inside], 0.02)), 0.0)
            np.minimum.at(still, (rows[inside], columns[inside]), np.float32(base))
    return replace(free_space, still=_closed(still))


def _things(scene: Scene) -> list[tuple[Body, int, int]]:
    """Bodies as they stand now, with an instance id and the recorded instance id whose pixels show it."""
    found = []
    for body in scene.bodies:
        if body.mesh is not None:
            continue
        names = body.copy_of or {instance_id: instance_id for instance_id in body.instance_ids}
        found += [(body, new, old) for old, new in names.items()]
    return found


def _closed(height: Float32[np.ndarray, "r c"]) -> Float32[np.ndarray, "r c"]:
    """The same with gaps between pixels filled by what is around them."""
    finite = np.where(np.isfinite(height), height, np.float32(1e3))
    square = np.ones((CLOSED, CLOSED), np.uint8)
    closed = cv2.dilate(cv2.erode(finite, square), square)
    return np.where(closed < 1e2, closed, np.float32(np.inf))


def thinned(
    camera: Camera,
    depth: Float32[np.ndarray, "h w"],
    use: Bool[np.ndarray, "h w"],
    fine: float = FINE,
) -> Bool[np.ndarray, "h w"]:
    """Of the pixels to use those of every so many rows and columns that they lie `fine` metres apart at most: of a
    large image others would tell cells no more."""
    if not use.any():
        return use
    step = int(fine * min(camera.K[0, 0], camera.K[1, 1]) / depth[use].mean(dtype=np.float64))
    if step < 2:
        return use
    out = np.zeros_like(use)
    out[::step, ::step] = use[::step, ::step]
    return out


def lifted(
    camera: Camera, t: int, depth: Float32[np.ndarray, "h w"], use: Bool[np.ndarray, "h w"]
) -> Float64[np.ndarray, "n 3"]:
    """World points of the pixels in `use`."""
    rows, columns = np.nonzero(use)
    z = depth[rows, columns].astype(np.float64)
    local = geometry.lifted(columns, rows, z, camera.K)
    return geometry.transform(camera.cam_to_world[t], local)
