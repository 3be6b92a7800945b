"""Where recorded pixels and Gaussians lie on their bodies, worked out only when an edit asks for it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from threading import Lock

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, Int8, Int32

from rpaug.core import geometry, memo
from rpaug.core.errors import SourceLacks
from rpaug.core.jit import kernel
from rpaug.core.types import Body, Camera, CameraView, Gaussians, Surface
from rpaug.scene.recorded import pooled
from rpaug.scene.recorded.pooled import Pool

GRAZING = 0.1  # cosine: a surface seen at a smaller angle is sampled as if at this one
LONE = 0.5  # of its step: what a side of one pixel counts as bent, since none can see how straight it is
SMOOTH = 0.5  # radians, about: a surface that turns by less within one pixel has no crease there
EXTENT = 2.0  # standard deviations of a Gaussian that its one color stands for

Depth = Callable[[], Float32[np.ndarray, "h w"]]
Light = Callable[[], Float32[np.ndarray, "h w"] | None] | None
Mirrored = Callable[
    [Float32[np.ndarray, "n 3"], Float32[np.ndarray, "n 3"], Int32[np.ndarray, "n"]],
    Float32[np.ndarray, "n 3"] | None,
]
Shine = Callable[[], Mirrored | None] | None

OfPlaces = Callable[[Surface], Float32[np.ndarray, "n k"]]


class KnownPlaces:
    """What edits found of the places that a fixed camera's pixels show, the latest of each pixel: of a place that
    rests it is the same in all frames."""

    def __init__(self) -> None:
        # By edit, which is held so that its id stays its own: the slot of each pixel (0: not known), and its values.
        self._held: dict[int, tuple[object, np.ndarray, np.ndarray]] = {}
        self._lock = Lock()  # frames are drawn by several threads

    def of(
        self, edit: object, surface: "PixelSurface", find: OfPlaces
    ) -> Float32[np.ndarray, "n k"]:
        """What `find` says of each pixel; it is asked of those alone whose place is not known."""
        rows, slots = surface.rows, surface.slots
        with self._lock:
            held = self._held.get(id(edit))
            if held is not None:
                _, known, values = held
                new = np.flatnonzero((slots == 0) | (known.take(rows) != slots))
                out = values.take(rows, 0)
        if held is None:
            new, out = np.arange(len(rows)), np.empty((len(rows), 0), np.float32)
        if not len(new):
            return out
        found = find(surface if len(new) == len(rows) else replace(surface, rows=rows[new]))
        if len(new) == len(rows):
            out = found
        else:
            out[new] = found
        with self._lock:
            size = surface.instance_ids.size
            empty = edit, np.zeros(size, np.int8), np.zeros((size, found.shape[1]), np.float32)
            _, known, values = self._held.setdefault(id(edit), empty)
            known[rows[new]], values[rows[new]] = slots[new], found
        return out


def of_places(surface: Surface, edit: object, find: OfPlaces) -> Float32[np.ndarray, "n k"]:
    """What `find` tells an `edit` of each row of a surface by its points, normals, facing, footprint and id alone.

    `find` must treat every row alone, to the last bit: what rests before a fixed camera is asked about once.
    """
    if isinstance(surface, PixelSurface) and surface.known is not None:
        return surface.known.of(edit, surface, find)
    return find(surface)


@dataclass(frozen=True)
class PixelSurface:
    """Pixels of one image, given by flat index; depth, 0 where unknown, is decoded only for who asks where they lie.

    `pool` says what other frames of the same camera showed beside them, None for this one alone; `light` is an image
    of `lit.share`, or None where nothing tells; `shine` gives, where highlights are known, what
    tells of points, normals and instance ids in the world what they show mirrored.
    """

    rows: Int[np.ndarray, "n"]
    depth: Depth
    instance_ids: Int32[np.ndarray, "h w"]
    camera: Camera
    t: int
    bodies: Sequence[Body]
    pool: Callable[[], Pool] | None = None
    light: Light = None
    shine: Shine = None
    known: KnownPlaces | None = None

    @property
    def ids(self) -> Int32[np.ndarray, "n"]:
        return self.instance_ids.reshape(-1)[self.rows]

    @property
    def slots(self) -> Int8[np.ndarray, "n"]:
        """By number from 1, which place of its pool each pixel shows; 0 for none, and for what has left its frame."""
        if self.pool is None:
            return np.zeros(len(self.rows), np.int8)
        pool, away = self.pool(), [instance_id for instance_id, _ in moved(self.bodies, self.t)]
        return _slots(
            self.depth(), self.instance_ids, self.rows, pool.ids, pool.depths, pool.tolerance,
            np.array(away, np.int32),
        )  # fmt: skip

    @property
    def points(self) -> Float32[np.ndarray, "n 3"]:
        return self._in_bodies[0]

    @property
    def normals(self) -> Float32[np.ndarray, "n 3"]:
        return self._in_bodies[1]

    @property
    def facing(self) -> Float32[np.ndarray, "n 3"]:
        return self._in_world[1]

    @property
    def towards(self) -> Float32[np.ndarray, "n 3"]:
        return geometry.towards(self._in_world[0], self.camera.cam_to_world[self.t, :3, 3])

    @property
    def footprint(self) -> Float32[np.ndarray, "n"]:
        return self._in_world[2]

    @property
    def lit(self) -> Float32[np.ndarray, "n"]:
        light = self.light() if self.light else None
        return (
            np.ones(len(self.rows), np.float32) if light is None else light.reshape(-1)[self.rows]
        )

    @property
    def mirrored(self) -> Float32[np.ndarray, "n 3"] | None:
        shine = self.shine() if self.shine else None
        if shine is None:
            return None
        points, facing, _ = self._in_world
        return shine(points, facing, self.ids)

    @cached_property
    def _in_world(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        depth = self.depth()
        pool = self.pool() if self.pool else pooled.nothing(*depth.shape)
        pose = self.camera.cam_to_world[self.t]
        return lift(depth, self.instance_ids, self.camera.K, pose, self.rows, pool)

    @cached_property
    def _in_bodies(self) -> tuple[np.ndarray, np.ndarray]:
        points, facing, _ = self._in_world
        points, normals, ids = points.copy(), facing.copy(), self.ids
        away = moved(self.bodies, self.t)
        shown = _shown(ids, np.array([instance_id for instance_id, _ in away], ids.dtype))
        for (instance_id, pose), seen in zip(away, shown, strict=True):
            if seen:
                held = ids == instance_id
                back = geometry.inverse(pose)
                points[held] = geometry.transform(back, points[held])
                normals[held] = normals[held] @ back[:3, :3].T
        return points, normals


def of_view(
    view: CameraView,
    t: int,
    bodies: Sequence[Body],
    ids: Int32[np.ndarray, "h w"] | None,
    pool: Callable[[], Pool] | None = None,
    light: Light = None,
    shine: Shine = None,
    known: KnownPlaces | None = None,
) -> Callable[[Int[np.ndarray, "n"]], PixelSurface]:
    """The surfaces that pixels of one recorded image show, by their flat index."""
    depth = partial(_known_depth, view, t)
    return of_image(depth, ids, view.camera, t, bodies, pool, light, shine, known)


def _known_depth(view: CameraView, t: int) -> Float32[np.ndarray, "h w"]:
    known = depth_of(view, t)
    if known is None:
        raise SourceLacks("this edit needs recorded depth, and this source has none")
    return known


def depth_of(view: CameraView, t: int) -> Float32[np.ndarray, "h w"] | None:
    """What the view's pixels lie on: at their recorded depth, else on its stage; None where it has neither."""
    if view.depth is not None:
        return view.depth(t)
    return None if view.proxy is None else view.proxy.depth


def of_image(
    depth: Depth,
    ids: Int32[np.ndarray, "h w"] | None,
    camera: Camera,
    t: int,
    bodies: Sequence[Body],
    pool: Callable[[], Pool] | None = None,
    light: Light = None,
    shine: Shine = None,
    known: KnownPlaces | None = None,
) -> Callable[[Int[np.ndarray, "n"]], PixelSurface]:
    """The surfaces behind pixels of an image that `camera` took at t, by their flat index; depth, light and highlights
    are asked for once for all edits."""
    instance_ids = np.zeros((camera.height, camera.width), np.int32) if ids is None else ids
    known_depth = cache(lambda: np.nan_to_num(depth(), posinf=0.0, neginf=0.0))
    known_light, known_shine = light and cache(light), shine and cache(shine)
    return lambda rows: PixelSurface(
        rows, known_depth, instance_ids, camera, t, bodies, pool, known_light, known_shine, known
    )


@dataclass(frozen=True)
class GaussianSurface:
    """Gaussians, given by index, as a camera at t sees them: flat discs across their shortest axis."""

    rows: Int[np.ndarray, "n"]
    gaussians: Gaussians
    camera: Camera
    t: int
    bodies: Sequence[Body]

    @property
    def ids(self) -> Int32[np.ndarray, "n"]:
        return self.gaussians.ids[self.rows]

    @property
    def points(self) -> Float32[np.ndarray, "n 3"]:
        return self.gaussians.means[self.rows]

    @property
    def normals(self) -> Float32[np.ndarray, "n 3"]:
        return self._directions[0]

    @property
    def facing(self) -> Float32[np.ndarray, "n 3"]:
        return self._directions[1]

    @property
    def towards(self) -> Float32[np.ndarray, "n 3"]:
        return geometry.towards(self._directions[2], self.camera.cam_to_world[self.t, :3, 3])

    @property
    def footprint(self) -> Float32[np.ndarray, "n"]:
        return EXTENT * np.median(self.gaussians.scales[self.rows], axis=1)

    @property
    def lit(self) -> Float32[np.ndarray, "n"]:
        return np.ones(len(self.rows), np.float32)

    @property
    def mirrored(self) -> None:
        return None

    @cached_property
    def _directions(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Normals in the frames of bodies and in the world, and points there."""
        xyzw = self.gaussians.quats[self.rows][:, [1, 2, 3, 0]]
        turned = geometry.pose_of(np.zeros((len(self.rows), 3)), xyzw)[:, :3, :3]
        shortest = self.gaussians.scales[self.rows].argmin(1)
        normals = turned[np.arange(len(self.rows)), :, shortest].astype(np.float32)
        points, facing, ids = self.points.copy(), normals.copy(), self.ids
        for instance_id, pose in moved(self.bodies, self.t):
            held = ids == instance_id
            points[held] = geometry.transform(pose, points[held])
            facing[held] = facing[held] @ pose[:3, :3].T
        away = ((points - self.camera.cam_to_world[self.t, :3, 3]) * facing).sum(1) > 0
        sign = np.where(away, np.float32(-1), np.float32(1))[:, None]
        return normals * sign, facing * sign, points


def of_gaussians(
    gaussians: Gaussians, camera: Camera, t: int, bodies: Sequence[Body]
) -> Callable[[Int[np.ndarray, "n"]], GaussianSurface]:
    """The surfaces that Gaussians stand for, by their index."""
    return lambda rows: GaussianSurface(rows, gaussians, camera, t, bodies)


def moved(bodies: Sequence[Body], t: int) -> list[tuple[int, Float64[np.ndarray, "4 4"]]]:
    """Handles, and poses of their bodies, of what is not where its body's own frame is."""
    return [
        (instance_id, body.to_world[t])
        for body, away in zip(bodies, _away(tuple(bodies)), strict=True)
        if away[t]
        for instance_id in body.instance_ids
    ]


@memo.last
def _away(bodies: tuple[Body, ...]) -> tuple[Bool[np.ndarray, "t"], ...]:
    """When each body is not where its own frame is."""
    return tuple((body.to_world != np.eye(4)).any((1, 2)) for body in bodies)


@kernel
def _shown(ids: Int32[np.ndarray, "n"], among: Int32[np.ndarray, "k"]) -> Bool[np.ndarray, "k"]:
    """Which of the instance ids some pixel shows."""
    out, last = np.zeros(len(among), np.bool_), -1
    for n in range(len(ids)):
        if ids[n] != last:
            last = ids[n]
            for k in range(len(among)):
                out[k] |= among[k] == last
    return out


def lift(
    depth: Float32[np.ndarray, "h w"],
    ids: Int32[np.ndarray, "h w"],
    K: Float64[np.ndarray, "3 3"],
    pose: Float64[np.ndarray, "4 4"],
    rows: Int[np.ndarray, "n"],
    pool: Pool,
) -> tuple[Float32[np.ndarray, "n 3"], Float32[np.ndarray, "n 3"], Float32[np.ndarray, "n"]]:
    """World points, unit normals towards the camera, and footprints in metres of some pixels.

    1/z is affine over the image of a plane. Its slopes are taken within one instance id, and on one side of a crease. A
    pixel with no neighbour of its instance id faces the camera. What `pool` holds of a pixel's place stands for what
    this image alone shows of it.
    """
    return _lift(depth, ids, K, pose, rows, pool.ids, pool.depths, pool.tolerance)


@kernel
def _slots(
    depth: Float32[np.ndarray, "h w"],
    ids: Int32[np.ndarray, "h w"],
    rows: Int[np.ndarray, "n"],
    pooled_ids: Int32[np.ndarray, "h w slots"],
    pooled_depths: Float32[np.ndarray, "h w slots 9"],
    tolerance: float,
    away: Int32[np.ndarray, "k"],
) -> Int8[np.ndarray, "n"]:
    out = np.zeros(len(rows), np.int8)
    last, left = np.int32(0), (away == 0).any()
    for n in range(len(rows)):
        r, c = rows[n] // depth.shape[1], rows[n] % depth.shape[1]
        if ids[r, c] != last:  # a row has few runs of one id
            last = ids[r, c]
            left = (away == last).any()
        if not left:
            out[n] = 1 + pooled.find(
                pooled_ids[r, c], pooled_depths[r, c], ids[r, c], depth[r, c], tolerance
            )
    return out


@kernel
def _lift(
    depth: Float32[np.ndarray, "h w"],
    ids: Int32[np.ndarray, "h w"],
    K: Float64[np.ndarray, "3 3"],
    pose: Float64[np.ndarray, "4 4"],
    rows: Int[np.ndarray, "n"],
    pooled_ids: Int32[np.ndarray, "h w slots"],
    pooled_depths: Float32[np.ndarray, "h w slots 9"],
    tolerance: float,
) -> tuple[Float32[np.ndarray, "n 3"], Float32[np.ndarray, "n 3"], Float32[np.ndarray, "n"]]:
    """`lift` with the pool's parts; depth is 0 where it is not known."""
    width = depth.shape[1]
    focal = np.sqrt(abs(K[0, 0] * K[1, 1]))
    points = np.empty((len(rows), 3), np.float32)
    normals = np.empty((len(rows), 3), np.float32)
    footprint = np.empty(len(rows), np.float32)
    slope = np.zeros(2)
    around = np.empty(pooled.AROUND, np.float32)
    near = np.empty(pooled.AROUND)
    for n in range(len(rows)):
        r, c = rows[n] // width, rows[n] % width
        slot = pooled.find(pooled_ids[r, c], pooled_depths[r, c], ids[r, c], depth[r, c], tolerance)
        if slot >= 0:
            around[:] = pooled_depths[r, c, slot]
        else:
            pooled.gather(depth, ids, r, c, around)
        for k in range(pooled.AROUND):
            near[k] = 1.0 / around[k] if around[k] > 0 else 0.0
        z = float(around[0]) if around[0] > 0 else 0.0
        x, y = (c - K[0, 2]) / K[0, 0], (r - K[1, 2]) / K[1, 1]
        found = 0
        for axis in range(2):
            smooth = SMOOTH * near[0] / K[axis, axis]
            slope[axis], known = _slope(near[0], near[1 + 4 * axis : 5 + 4 * axis], smooth)
            found += known
        a, b, d = x, y, 1.0
        if found == 2:
            # The plane 1/z = g . (x, y, 1) in the camera's frame has the normal g.
            a, b = slope[0] * K[0, 0], slope[1] * K[1, 1]
            d = near[0] - a * x - b * y
        length = np.sqrt(a * a + b * b + d * d)
        cosine = (a * x + b * y + d) / (length * np.sqrt(x * x + y * y + 1.0))
        flip = -1.0 / length if cosine > 0 else 1.0 / length
        a, b, d = a * flip, b * flip, d * flip
        for k in range(3):
            points[n, k] = pose[k, 3] + z * (pose[k, 0] * x + pose[k, 1] * y + pose[k, 2])
            normals[n, k] = pose[k, 0] * a + pose[k, 1] * b + pose[k, 2] * d
        footprint[n] = z / focal / np.sqrt(max(abs(cosine), GRAZING))
    return points, normals, footprint


@kernel
def _slope(here: float, beside: np.ndarray, smooth: float) -> tuple[float, bool]:
    """Change of 1/z per pixel along an image axis, and whether there is any neighbour to tell it from.

    `beside` are 1/z of the neighbours, the nearer first, on one side and then on the other; 0 is unknown. The mean of
    both sides where they differ by less than `smooth`, as on a curved thing; else that of the side which runs on
    straightest.
    """
    least, best, other, sides = np.inf, 0.0, 0.0, 0
    for side in range(2):
        one, two = beside[2 * side], beside[2 * side + 1]
        if one == 0 or here == 0:
            continue
        step = one - here
        bend = LONE * abs(step) if two == 0 else abs(two - here - 2.0 * step)
        sides += 1
        other = best
        step *= 2 * side - 1
        if bend < least:
            least, best = bend, step
        else:
            other = step
    if sides == 2 and abs(best - other) < smooth:
        return (best + other) / 2, True
    return best, sides > 0
