"""Instances of a video's still world: patches of one colour name, joined over frames where their points meet.

What a patch is in one image is told by colour alone, so that its outline is the image's own; which patches of several
images are one thing is told by where they are.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32, Float64, Int32, UInt8

from rpaug import geometry
from rpaug.sfm.patches import named, names_known, patches

BACKGROUND = 1  # handle of all that is no thing
FIRST = 2
CELL = 0.02  # of the median depth: points so near to each other, and of one colour, hang together
FEWEST = 60  # cells of a thing
MOST = 60  # things
SHARE = 0.3  # of a patch's points must be the thing's
FLAT = 0.6  # share of a thing's points in the support's plane, if it is part of that
LEVEL = 2.0  # cells: what is nearer to the support's height belongs to it
SAMPLES = 150
FACING = 0.9  # cosine to the vertical of what is level


@dataclass(frozen=True, eq=False)
class Look:
    """One frame: its image made small, depth, lens and pose, in a world whose z is up."""

    rgb: UInt8[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]
    K: Float64[np.ndarray, "3 3"]
    cam_to_world: Float64[np.ndarray, "4 4"]


@dataclass(frozen=True, eq=False)
class Things:
    """Handles by cell of the world, `names` of each handle's colour, and the support: its handles and its height."""

    cell: float
    handles: Mapping[tuple[int, int, int], int]
    count: int
    support: frozenset[int] = frozenset()
    level: float | None = None

    @property
    def every(self) -> list[int]:
        """All handles."""
        return [BACKGROUND, *range(FIRST, FIRST + self.count)]

    def of(self, look: Look) -> Int32[np.ndarray, "h w"]:
        """Handles of one frame's pixels."""
        patch = patches(look.rgb)
        points = _points(look)
        keys = np.floor(points / self.cell).astype(np.int64)
        known = _looked_up(keys.reshape(-1, 3), self.handles).reshape(patch.shape)
        number = int(patch.max()) + 1
        votes = np.zeros((number, FIRST + self.count), np.int64)
        np.add.at(votes, (patch.ravel(), known.ravel()), 1)
        best = votes[:, FIRST:].argmax(1) + FIRST if self.count else np.full(number, BACKGROUND)
        enough = votes[np.arange(number), best] >= SHARE * votes.sum(1)
        return np.where(enough, best, BACKGROUND)[patch].astype(np.int32)


def find(looks: Sequence[Look]) -> Things:
    """The things that several looks show."""
    size = float(np.median([np.median(look.depth) for look in looks]))
    cell = CELL * size
    keys, names, frames = [], [], []
    for k, look in enumerate(looks):
        called = named(look.rgb)
        at = np.floor(_points(look) / cell).astype(np.int64).reshape(-1, 3)
        keys.append(at)
        names.append(called.ravel())
        frames.append(np.full(len(at), k))
    cells, of = np.unique(np.concatenate(keys), axis=0, return_inverse=True)
    of = of.ravel()
    votes = np.zeros((len(cells), names_known()), np.int32)
    np.add.at(votes, (of, np.concatenate(names)), 1)
    mine = votes.argmax(1)
    group = _connected(cells, mine)
    _, of_group, sizes = np.unique(group, return_inverse=True, return_counts=True)
    order = [g for g in np.argsort(-sizes, kind="stable")[:MOST] if sizes[g] >= FEWEST]
    number = np.zeros(len(sizes), np.int64)
    number[order] = np.arange(FIRST, FIRST + len(order))
    handles = {
        tuple(key): int(handle)
        for key, handle in zip(cells.tolist(), number[of_group].tolist(), strict=True)
        if handle
    }
    return Things(cell, handles, len(order))


def _points(look: Look) -> Float64[np.ndarray, "h w 3"]:
    return geometry.transform(
        look.cam_to_world, geometry.unproject(look.depth.astype(np.float64), look.K)
    )


def _connected(cells: np.ndarray, names: np.ndarray) -> np.ndarray:
    """A number for each cell, the same for neighbouring cells of one name (pointer jumping)."""
    low = cells.min(0) - 1
    shape = cells.max(0) - low + 2
    flat = _flat(cells - low, shape)
    order = np.argsort(flat)
    sorted_flat = flat[order]
    pairs = []
    for step in np.ndindex(3, 3, 3):
        if step <= (1, 1, 1):
            continue
        other = _flat(cells - low + np.array(step) - 1, shape)
        at = np.minimum(np.searchsorted(sorted_flat, other), len(flat) - 1)
        there = order[at]
        fits = (sorted_flat[at] == other) & (names[there] == names)
        pairs.append(np.stack([np.flatnonzero(fits), there[fits]], 1))
    edges = np.concatenate(pairs)
    root = np.arange(len(cells))
    while True:
        a, b = root[edges[:, 0]], root[edges[:, 1]]
        if (a == b).all():
            return root
        np.minimum.at(root, np.maximum(a, b), np.minimum(a, b))
        while (root[root] != root).any():
            root = root[root]


def _flat(cells: np.ndarray, shape: np.ndarray) -> np.ndarray:
    return (cells[:, 0] * shape[1] + cells[:, 1]) * shape[2] + cells[:, 2]


def _looked_up(keys: np.ndarray, handles: Mapping[tuple[int, int, int], int]) -> np.ndarray:
    different, of = np.unique(keys, axis=0, return_inverse=True)
    found = np.array([handles.get(tuple(key), 0) for key in different.tolist()])
    return found[of.ravel()]


@dataclass(frozen=True, eq=False)
class Plane:
    """The plane that most cells of a thing lie in: unit normal, offset (normal @ p = offset), and how many lie in it."""

    handle: int
    normal: Float64[np.ndarray, "3"]
    offset: float
    inside: int
    share: float


def planes(things: Things) -> list[Plane]:
    """The plane of every thing that is flat, by random samples (Fischler and Bolles 1981), always the same ones."""
    keys, owners = np.array(list(things.handles)), np.array(list(things.handles.values()))
    found = []
    for handle in np.unique(owners).tolist() if len(keys) else ():
        points = (keys[owners == handle] + 0.5) * things.cell
        plane = _plane(points, handle, 1.5 * things.cell)
        if plane.share > FLAT:
            found.append(plane)
    return found


def _plane(points: Float64[np.ndarray, "n 3"], handle: int, near: float) -> Plane:
    rng = np.random.default_rng(handle)
    best, kept = -1, np.zeros(len(points), bool)
    for _ in range(SAMPLES):
        a, b, c = points[rng.integers(len(points), size=3)]
        normal = np.cross(b - a, c - a)
        length = float(np.linalg.norm(normal))
        if length == 0:
            continue
        inside = np.abs((points - a) @ (normal / length)) < near
        if inside.sum() > best:
            best, kept = int(inside.sum()), inside
    middle = points[kept].mean(0)
    normal = np.linalg.svd(points[kept] - middle)[2][2]
    return Plane(handle, normal, float(normal @ middle), best, best / len(points))


def with_support(things: Things, below: float = np.inf) -> Things:
    """The same in a world whose z is up: the support is the largest level thing below the camera, with what lies in
    its plane."""
    level = [
        plane
        for plane in planes(things)
        if abs(plane.normal[2]) > FACING and plane.offset / plane.normal[2] < below
    ]
    if not level:
        return things
    main = max(level, key=lambda plane: plane.inside)
    height = main.offset / main.normal[2]
    keys, owners = np.array(list(things.handles)), np.array(list(things.handles.values()))
    near = np.abs((keys[:, 2] + 0.5) * things.cell - height) < LEVEL * things.cell
    inside = frozenset(p.handle for p in level if near[owners == p.handle].mean() > FLAT)
    return replace(things, support=inside | {main.handle}, level=float(height))
