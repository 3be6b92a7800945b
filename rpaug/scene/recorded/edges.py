"""Straight edges of what rests: table top, floor, walls, sides of boxes, each a flat face with the lines at which it
ends.

A face is a plane that many recorded pixels of one instance lie on, found by RANSAC (Fischler and Bolles 1981). It ends
where a camera saw past it, right beside a pixel that lies on it; lines through such places, with the whole face on one
side, are its edges. So an edge that leaves the frame, or goes on behind something, is known to go on straight.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float64

from rpaug.core import geometry
from rpaug.core.types import CameraView
from rpaug.render.holes import NO_EDGES, Edges
from rpaug.render.zbuffer import Source
from rpaug.scene.recorded.plates import source_at, spread

FRAMES = 6  # of the episode, of which the farthest depth is taken: things that pass are nearer
FLAT = 0.008  # metres from a plane, of what lies on it
PAST = 0.02  # of depth, and FLAT: so much farther is past a face
FACING = 0.95  # cosine between the normals of a face and of its pixels
FEWEST = 100  # pixels of a face
SEEN = 8  # places at which an edge was seen
STRAIGHT = 0.015  # metres from an edge, of its places
WITHIN = 0.99  # share of a face that lies at the inner side of its edge
MOST = 6  # faces of an instance, and edges of a face
DRAWS = 60  # of planes and lines
MANY = 4000  # points of an instance that its faces are found by


def farthest(view: CameraView, length: int) -> Source:
    """The farthest that a fixed camera recorded in each pixel: infinite where it recorded no depth."""
    out = source_at(view, 0)
    far, ids = np.where(_known(out), out.depth, np.inf).astype(np.float32), out.ids.copy()
    for t in spread(length)[:FRAMES]:
        now = source_at(view, t)
        depth = np.where(_known(now), now.depth, np.inf).astype(np.float32)
        farther = depth > far
        far[farther], ids[farther] = depth[farther], now.ids[farther]
    return replace(out, depth=far, ids=ids, distant=True)


def _known(source: Source) -> Bool[np.ndarray, "h w"]:
    return np.isfinite(source.depth) & (source.depth > 0)


def straight(seen: Sequence[Source], static: frozenset[int]) -> Edges:
    """The edges of the `static` instance ids' faces, by what fixed cameras have `seen` farthest, if there are any."""
    if not seen:
        return NO_EDGES
    clouds = [_cloud(source) for source in seen]
    rng = np.random.default_rng(0)
    ids: list[int] = []
    found: list[np.ndarray] = []
    for instance_id in sorted(static):
        own = [source.ids == instance_id for source in seen]
        points = np.concatenate([cloud[0][use] for cloud, use in zip(clouds, own, strict=True)])
        normals = np.concatenate([cloud[1][use] for cloud, use in zip(clouds, own, strict=True)])
        good = np.flatnonzero(np.isfinite(normals).all(1))
        good = good[:: max(1, len(good) // MANY)]
        for face in _faces(points[good], normals[good], rng):
            for side in _sides(face, seen, clouds, own, rng):
                ids.append(instance_id)
                found.append(np.concatenate([face, side]))
    both = np.array(found).reshape(-1, 8)
    return Edges(np.array(ids, np.int32), both[:, :4].copy(), both[:, 4:].copy())


def _cloud(source: Source) -> tuple[Float64[np.ndarray, "h w 3"], Float64[np.ndarray, "h w 3"]]:
    """World points and normals of a recording, not a number where they are unknown."""
    rows, columns = np.mgrid[: source.depth.shape[0], : source.depth.shape[1]]
    depth = np.where(_known(source), source.depth, np.nan).astype(np.float64)
    rays = geometry.rays(columns, rows, source.K)
    points = geometry.transform(source.cam_to_world, rays * depth[..., None])
    steps = np.full((2, *points.shape), np.nan)
    ids = source.ids
    level = (ids[:, 2:] == ids[:, 1:-1]) & (ids[:, 1:-1] == ids[:, :-2])
    upright = (ids[2:] == ids[1:-1]) & (ids[1:-1] == ids[:-2])
    steps[0, :, 1:-1][level] = (points[:, 2:] - points[:, :-2])[level]
    steps[1, 1:-1][upright] = (points[2:] - points[:-2])[upright]
    normals = np.cross(*steps)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    return points, np.divide(normals, length, out=np.full_like(normals, np.nan), where=length > 0)


def _faces(
    points: Float64[np.ndarray, "n 3"],
    normals: Float64[np.ndarray, "n 3"],
    rng: np.random.Generator,
) -> Iterator[Float64[np.ndarray, "4"]]:
    """Planes (unit normal, offset) that many of the points lie on, the largest first."""
    for _ in range(MOST):
        if len(points) < FEWEST:
            return
        few = rng.choice(len(points), min(DRAWS, len(points)), replace=False)
        offsets = (points[few] * normals[few]).sum(1)
        on = np.abs(points @ normals[few].T - offsets) < FLAT
        on &= np.abs(normals @ normals[few].T) > FACING
        use = on[:, on.sum(0).argmax()]
        if use.sum() < FEWEST:
            return
        plane = _fitted(points[use])
        yield plane
        off = np.abs(points @ plane[:3] - plane[3])
        rest = ~use & ((off > 2 * FLAT) | (np.abs(normals @ plane[:3]) < FACING))
        points, normals = points[rest], normals[rest]


def _fitted(points: Float64[np.ndarray, "n d"]) -> Float64[np.ndarray, "d+1"]:
    """The plane (line, in two dimensions) of least squares: unit normal, offset."""
    middle = points.mean(0)
    away = points - middle
    normal = np.linalg.eigh(away.T @ away)[1][:, 0]
    return np.append(normal, normal @ middle)


def _sides(
    face: Float64[np.ndarray, "4"],
    seen: Sequence[Source],
    clouds: Sequence[tuple[np.ndarray, np.ndarray]],
    own: Sequence[np.ndarray],
    rng: np.random.Generator,
) -> Iterator[Float64[np.ndarray, "4"]]:
    """Planes across the face at its edges, their normals towards it."""
    axes = np.linalg.svd(face[None, :3])[2][1:]
    inner, places = [], []
    for source, (points, _), mine in zip(seen, clouds, own, strict=True):
        with np.errstate(invalid="ignore"):
            on = mine & (np.abs(points @ face[:3] - face[3]) < 2 * FLAT)
        rows, columns = np.mgrid[: on.shape[0], : on.shape[1]]
        eye = source.cam_to_world[:3, 3]
        rays = geometry.rays(columns, rows, source.K) @ source.cam_to_world[:3, :3].T
        toward = rays @ face[:3]
        depth = np.divide(
            face[3] - eye @ face[:3], toward, out=np.zeros_like(toward), where=toward != 0
        )
        past = ~on & (depth > 0) & (source.depth > depth * (1 + PAST) + FLAT)
        flat = (eye + rays * depth[..., None]) @ axes.T
        inner.append(flat[on])
        for one, other in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:], np.s_[:-1])):
            for a, b in ((one, other), (other, one)):
                ends = on[a] & past[b]
                places.append((flat[a][ends] + flat[b][ends]) / 2)
    face_points = np.concatenate(inner)
    few = face_points[:: max(1, len(face_points) // MANY)]
    for line in _lines(np.concatenate(places), few, rng):
        yield np.append(line[:2] @ axes, line[2])


def _lines(
    places: Float64[np.ndarray, "n 2"], inner: Float64[np.ndarray, "m 2"], rng: np.random.Generator
) -> Iterator[Float64[np.ndarray, "3"]]:
    """Lines (unit normal, offset) through many of the `places`, with what is `inner` at their positive side."""
    for _ in range(MOST):
        if len(places) < SEEN:
            return
        a, b = places[rng.integers(len(places), size=(2, DRAWS))]
        normals = np.stack([a[:, 1] - b[:, 1], b[:, 0] - a[:, 0]], 1)
        length = np.linalg.norm(normals, axis=1)
        apart = length > 3 * STRAIGHT
        normals, a = normals[apart] / length[apart, None], a[apart]
        lines = np.concatenate([normals, (normals * a).sum(1)[:, None]], 1)
        lines *= np.sign(inner.mean(0) @ normals.T - lines[:, 2])[:, None]
        near = np.abs(places @ lines[:, :2].T - lines[:, 2]) < STRAIGHT
        best = None
        for k in np.argsort(-near.sum(0), kind="stable"):
            if near[:, k].sum() < SEEN:
                break
            if _within(inner, lines[k]):
                best = k
                break
        if best is None:
            return
        line = _fitted(places[near[:, best]])
        line *= np.sign(lines[best, :2] @ line[:2])
        yield line if _within(inner, line) else lines[best]
        places = places[np.abs(places @ line[:2] - line[2]) > STRAIGHT]


def _within(inner: Float64[np.ndarray, "m 2"], line: Float64[np.ndarray, "3"]) -> bool:
    return float((inner @ line[:2] - line[2] > -STRAIGHT).mean()) >= WITHIN
