"""What the light from far away reaches: all surfaces as it sees them (shadow maps; Williams 1978).

Surfaces are the pixels of a few frames, carried along with their bodies. Walls and floor cast nothing: lamps hang
inside the room. A pixel is a small disc across its normal, so that a surface does not shade itself.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64, Int32, Int64, UInt8

from rpaug.core import geometry, sampling
from rpaug.core.jit import kernel
from rpaug.core.memo import once
from rpaug.core.types import Body, Camera, CameraView, Episode, Mesh, Scene
from rpaug.scene.recorded import pooled, surface

FRAMES = 6
WIDE = 160  # pixels: larger images are thinned to about this
CELL = 0.006  # metres, of a map
GRAIN = 0.004  # metres: one disc is kept in each cube of this side
LIFT = 0.006  # metres above its surface that a place is looked up at
CLOSE = 0.010  # metres: what lies no further before a place is its own surface
GRAZING = 0.2  # cosine: discs turned further from the light are drawn as if turned so far
LARGEST = 4096  # cells a side
FOOT = 0.005  # quantile of a thing's heights that it stands on
MOST_STEPS = 64  # along a triangle's side that is drawn as discs
KEPT = 192  # maps: other cameras of that time ask for them again


Direction = tuple[float, float, float]


@dataclass(frozen=True)
class Discs:
    """Small flat pieces of surface, and how wide they are; metres."""

    points: Float32[np.ndarray, "n 3"]
    normals: Float32[np.ndarray, "n 3"]
    width: Float32[np.ndarray, "n"]


@dataclass(frozen=True, eq=False)
class Casters:
    """All that may stand in a lamp's way, by instance id: discs, and the track that carries them into the world.

    What rests is drawn once for each lamp, and what moves over it at each time.
    """

    parts: Mapping[int, tuple[Float64[np.ndarray, "t 4 4"], Discs]]
    _kept: dict[tuple[int | None, Direction], "LightMap"] = field(default_factory=dict, repr=False)

    @cached_property
    def resting(self) -> Discs:
        """Those that never move."""
        return joined([_placed(pose[0], one) for pose, one in self.parts.values() if _rests(pose)])

    def moving(self, t: int) -> Discs:
        """Where the others are at t."""
        there = [pose_one for pose_one in self.parts.values() if not _rests(pose_one[0])]
        return joined([_placed(pose[t], one) for pose, one in there])

    def maps(self, t: int, directions: Sequence[Direction]) -> list["LightMap"]:
        """What lamps in these directions see of them at t; the last ones are kept."""
        found = {one: self._kept[t, one] for one in directions if (t, one) in self._kept}
        if len(found) < len(directions):
            moving = self.moving(t)
            for one in directions:
                if one not in found:
                    beneath = self._map(None, one, self.resting)
                    found[one] = self._map(t, one, moving, beneath)
        return [found[one] for one in directions]

    def _map(
        self, t: int | None, direction: Direction, discs: Discs, over: "LightMap | None" = None
    ) -> "LightMap":
        key = t, direction
        made = self._kept.get(key) or light_map(discs, np.array(direction), CELL, over)
        while key not in self._kept and len(self._kept) >= KEPT:
            self._kept.pop(next(iter(self._kept)), None)
        self._kept[key] = made
        return made


def _rests(track: Float64[np.ndarray, "t 4 4"]) -> bool:
    return bool((track == track[0]).all())


def _placed(pose: Float64[np.ndarray, "4 4"], discs: Discs) -> Discs:
    turn = pose[:3, :3].T.astype(np.float32)
    points = geometry.transform(pose, discs.points).astype(np.float32)
    return Discs(points, discs.normals @ turn, discs.width)


def casters(scene: Scene) -> Casters:
    """Those of the recorded scene, a `memo.bare` one: the same whatever colors its images have."""
    shapes = tuple((view.camera, view.depth, view.ids) for view in known(scene.episode))
    return _casters(shapes, tuple(scene.tracked), frozenset(scene.roles.get("background", ())))


def _colorless(t: int) -> UInt8[np.ndarray, "h w 3"]:
    raise AssertionError("shapes are asked for alone")


@once
def _casters(
    shapes: tuple[tuple[Camera, Callable[[int], Any], Callable[[int], Any]], ...],
    tracked: tuple[Body, ...],
    walls: frozenset[int],
) -> Casters:
    tracks = {one: body.to_world for body in tracked for one in body.instance_ids}
    views = [CameraView(camera, _colorless, depth, ids) for camera, depth, ids in shapes]
    length = len(views[0].camera.cam_to_world) if views else 0
    still = np.broadcast_to(np.eye(4), (length, 4, 4))
    found: dict[int, tuple[np.ndarray, list[Discs]]] = {}
    for t in sampling.frames(length, FRAMES) if views else ():
        for view in views:
            ids, discs = discs_of(view, t, every(view))
            for one in np.unique(ids).tolist():
                if one == 0 or one in walls:
                    continue
                track = tracks.get(one, still)
                mine = ids == one
                back = geometry.inverse(track[t])
                own = Discs(
                    geometry.transform(back, discs.points[mine]).astype(np.float32),
                    discs.normals[mine] @ back[:3, :3].T.astype(np.float32),
                    discs.width[mine],
                )
                found.setdefault(one, (track, []))[1].append(own)
    return Casters(
        {one: (track, thinned(joined(parts), GRAIN)) for one, (track, parts) in found.items()}
    )


def standing(scene: Scene, recorded: Casters) -> Casters:
    """Those of an edited scene: what was recorded where its bodies are now, and what was put in. What bends casts
    nothing."""
    held = {one for body in scene.tracked for one in body.instance_ids}
    parts = {one: part for one, part in recorded.parts.items() if one not in held}
    for body in scene.bodies:
        if body.mesh is not None:
            parts |= dict.fromkeys(body.instance_ids, (body.to_world, of_mesh(body.mesh)))
        elif body.soft is None:
            names = body.copy_of or {one: one for one in body.instance_ids}
            for source in names.keys() & recorded.parts.keys():
                _, discs = recorded.parts[source]
                size = np.float32(body.scale)
                grown = Discs(size * discs.points, discs.normals, size * discs.width)
                parts[names[source]] = body.to_world, grown
    return Casters(parts)


def with_supports(scene: Scene, recorded: Casters) -> Casters:
    """The recorded ones, and what resting things stand on beneath them, where nobody saw it."""
    still = {one for body in scene.tracked if body.motion == "static" for one in body.instance_ids}
    still -= scene.roles.get("table", frozenset())
    below = {-one: _below(*recorded.parts[one]) for one in still & recorded.parts.keys()}
    return Casters({**recorded.parts, **below})


def _below(
    track: Float64[np.ndarray, "t 4 4"], discs: Discs
) -> tuple[Float64[np.ndarray, "t 4 4"], Discs]:
    """A thing pressed flat at its foot, which does not go where the thing goes."""
    still = np.broadcast_to(np.eye(4), track.shape)
    points = geometry.transform(track[0], discs.points)
    points[:, 2] = np.quantile(points[:, 2], FOOT)
    up = np.broadcast_to(np.array([0, 0, 1], np.float32), points.shape)
    return still, thinned(Discs(points.astype(np.float32), up, discs.width), GRAIN)


def of_mesh(mesh: Mesh) -> Discs:
    """A mesh's surface as discs about as wide as the `GRAIN`."""
    corners = mesh.points[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=-1) / 2
    longest = np.linalg.norm(corners - np.roll(corners, 1, 1), axis=-1).max(1)
    parts = []
    steps = np.clip(np.ceil(longest / GRAIN), 1, MOST_STEPS).astype(int)
    for step in np.unique(steps).tolist():
        mine = (steps == step) & (area > 0)
        i, j = np.nonzero(np.add.outer(np.arange(step), np.arange(step)) < step)
        weights = np.stack([i + 1 / 3, j + 1 / 3, step - i - j - 2 / 3], -1) / step
        points = np.einsum("kc,fcd->fkd", weights, corners[mine]).reshape(-1, 3)
        normals = (across[mine] / (2 * area[mine, None])).repeat(len(weights), 0)
        width = (longest[mine] / step).repeat(len(weights))
        parts.append(Discs(*(one.astype(np.float32) for one in (points, normals, width))))
    return thinned(joined(parts), GRAIN)


def known(episode: Episode) -> Iterator[CameraView]:
    """Views that tell where what they show lies, and what it is."""
    return (v for v in episode.views.values() if v.depth is not None and v.ids is not None)


def every(view: CameraView) -> Int64[np.ndarray, "n"]:
    """Pixels of a view, thinned where there are many: flat indices."""
    step = max(1, round(view.camera.width / WIDE))
    all_of_them = np.arange(view.camera.height * view.camera.width)
    return all_of_them.reshape(view.camera.height, -1)[::step, ::step].reshape(-1)


def discs_of(view: CameraView, t: int, rows: Int64[np.ndarray, "n"]) -> tuple[np.ndarray, Discs]:
    """Instance ids and surfaces of some pixels; 0 where no depth is known."""
    assert view.depth is not None
    assert view.ids is not None
    depth, ids = view.depth(t), view.ids(t)
    discs = lifted(depth, ids, view.camera, t, rows)
    step = max(1, round(view.camera.width / WIDE))
    shown = np.where(_known_depth(depth).reshape(-1)[rows] > 0, ids.reshape(-1)[rows], 0)
    return shown, Discs(discs.points, discs.normals, step * discs.width)


def lifted(
    depth: Float32[np.ndarray, "h w"],
    ids: Int32[np.ndarray, "h w"],
    camera: Camera,
    t: int,
    rows: Int64[np.ndarray, "n"],
) -> Discs:
    """Surfaces of some pixels of any image."""
    pool = pooled.nothing(*depth.shape)
    pose = camera.cam_to_world[t]
    return Discs(*surface.lift(_known_depth(depth), ids, camera.K, pose, rows, pool))


def _known_depth(depth: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    return np.nan_to_num(depth, posinf=0.0, neginf=0.0)


def joined(parts: list[Discs]) -> Discs:
    if not parts:
        return Discs(*(np.zeros(shape, np.float32) for shape in ((0, 3), (0, 3), 0)))
    return Discs(
        np.concatenate([one.points for one in parts]),
        np.concatenate([one.normals for one in parts]),
        np.concatenate([one.width for one in parts]),
    )


def thinned(discs: Discs, side: float) -> Discs:
    """One disc of those in each cube, the narrowest: the camera that saw it best."""
    cubes = np.floor(discs.points / side).astype(np.int64) + (1 << 20)
    keys = (cubes[:, 0] << 42) | (cubes[:, 1] << 21) | cubes[:, 2]
    order = np.lexsort((discs.width, keys))
    first = order[np.append(True, np.diff(keys[order]) != 0)] if len(order) else order
    width = np.maximum(discs.width[first], np.float32(side))
    return Discs(discs.points[first], discs.normals[first], width)


@dataclass(frozen=True, eq=False)
class LightMap:
    """How far towards a lamp the nearest surface lies, seen along its direction, by cell."""

    frame: Float32[np.ndarray, "3 3"]
    origin: Float32[np.ndarray, "2"]
    cell: float
    height: Float32[np.ndarray, "r c"]

    def reached(self, places: Discs) -> Float32[np.ndarray, "n"]:
        """How much of each place the lamp reaches, 0..1: in between at a shadow's edge."""
        lifted = places.points + np.float32(LIFT) * places.normals
        at = (lifted @ self.frame.T).astype(np.float32)
        return _looked_up(at, self.origin, self.cell, self.height, CLOSE)


def light_map(
    discs: Discs,
    direction: Float64[np.ndarray, "3"],
    cell: float = CELL,
    over: LightMap | None = None,
) -> LightMap:
    """What a lamp in that direction sees of the discs, and of all that is drawn in another map along it."""
    frame = _frame(direction)
    at = (discs.points @ frame.T).astype(np.float32)
    turned = (discs.normals @ frame.T).astype(np.float32)
    if not len(at):
        nothing = np.full((1, 1), -np.inf, np.float32)
        return over or LightMap(frame, np.zeros(2, np.float32), cell, nothing)
    across, along = at.T[:2]  # by column: NumPy is slow over a long first axis
    # In whole cells, so that maps of more or fewer surfaces agree.
    first = np.floor(np.array([across.min(), along.min()]) / cell).astype(int) - 4
    last = np.ceil(np.array([across.max(), along.max()]) / cell).astype(int) + 4
    if over is not None:
        begun = np.rint(over.origin / cell).astype(int)
        first = np.minimum(first, begun)
        last = np.maximum(last, begun + over.height.shape[::-1])
    columns, rows = np.clip(last - first, 1, LARGEST)
    height = np.full((rows, columns), -np.inf, np.float32)
    if over is not None:
        left, below = begun - first
        there = height[below:, left:][: over.height.shape[0], : over.height.shape[1]]
        there[:] = over.height[: there.shape[0], : there.shape[1]]
    low = (cell * first).astype(np.float32)
    _draw(at, turned, discs.width, low, cell, height)
    return LightMap(frame, low, cell, height)


def _frame(direction: Float64[np.ndarray, "3"]) -> Float32[np.ndarray, "3 3"]:
    towards = np.asarray(direction, float) / np.linalg.norm(direction)
    across = crossed(towards, np.eye(3)[np.abs(towards).argmin()])
    across /= np.linalg.norm(across)
    return np.stack([across, crossed(towards, across), towards]).astype(np.float32)


def crossed(
    one: Float64[np.ndarray, "3"], other: Float64[np.ndarray, "3"]
) -> Float64[np.ndarray, "3"]:
    """The cross product; NumPy's takes ten times as long for two vectors."""
    (a, b, c), (x, y, z) = one.tolist(), other.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


@kernel
def _draw(
    at: Float32[np.ndarray, "n 3"],
    normals: Float32[np.ndarray, "n 3"],
    width: Float32[np.ndarray, "n"],
    origin: Float32[np.ndarray, "2"],
    cell: float,
    height: Float32[np.ndarray, "r c"],
) -> None:
    rows, columns = height.shape
    for n in range(len(at)):
        x, y = (at[n, 0] - origin[0]) / cell, (at[n, 1] - origin[1]) / cell
        a, b, c = normals[n]
        steep = max(abs(c), GRAZING)
        flip = 1.0 if c >= 0 else -1.0
        reach = 0.5 * width[n] / cell
        across = max(reach, 0.5)
        tilt = max(np.sqrt(a * a + b * b), 1e-6)
        along = max(reach * abs(c), 0.5)  # a disc seen from its side is thin
        for j in range(max(0, int(np.ceil(y - across))), min(rows, int(y + across) + 1)):
            for i in range(max(0, int(np.ceil(x - across))), min(columns, int(x + across) + 1)):
                if abs(a * (i - x) + b * (j - y)) > along * tilt:
                    continue
                rise = -flip * (a * (i - x) + b * (j - y)) * cell / steep
                rise = min(max(rise, -width[n]), width[n])
                height[j, i] = max(height[j, i], at[n, 2] + rise)


@kernel
def _looked_up(
    at: Float32[np.ndarray, "n 3"],
    origin: Float32[np.ndarray, "2"],
    cell: float,
    height: Float32[np.ndarray, "r c"],
    close: float,
) -> Float32[np.ndarray, "n"]:
    rows, columns = height.shape
    out = np.ones(len(at), np.float32)
    for n in range(len(at)):
        x, y = (at[n, 0] - origin[0]) / cell, (at[n, 1] - origin[1]) / cell
        i, j = int(np.floor(x)), int(np.floor(y))
        if i < 0 or j < 0 or i + 1 >= columns or j + 1 >= rows:
            continue
        p, q = x - i, y - j
        lit = 0.0
        for k in range(2):
            for m in range(2):
                weight = (q if k else 1 - q) * (p if m else 1 - p)
                if height[j + k, i + m] <= at[n, 2] + close:
                    lit += weight
        out[n] = lit
    return out
