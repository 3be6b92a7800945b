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
FLAT = 0.5  # share of a thing's pixels in the support's plane, if it is part of that
NEAR = 0.12  # of depth: so near to the plane counts as in it
BROAD = 0.02  # of all pixels: what is smaller lies on the support and is no part of it
REACH = 2**20  # cells


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

    def at(self, points: Float32[np.ndarray, "n 3"]) -> Int32[np.ndarray, "n"]:
        """Handles of points in the world."""
        found = _looked_up(np.floor(points / self.cell).astype(np.int64), self.handles)
        return np.where(found > 0, found, BACKGROUND).astype(np.int32)

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
    codes, of = np.unique(_packed(np.concatenate(keys)), return_inverse=True)
    cells = _unpacked(codes)
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
    different, of = np.unique(_packed(keys), return_inverse=True)
    found = np.array([handles.get(tuple(key), 0) for key in _unpacked(different).tolist()])
    return found[of]


def _packed(cells: np.ndarray) -> np.ndarray:
    """Three whole numbers in one, which sorts faster; what is farther than REACH cells is brought there."""
    near = np.clip(cells, -REACH, REACH - 1) + REACH
    return (near[:, 0] * 2 * REACH + near[:, 1]) * 2 * REACH + near[:, 2]


def _unpacked(codes: np.ndarray) -> np.ndarray:
    side = 2 * REACH
    return np.stack([codes // side**2, codes // side % side, codes % side], 1) - REACH


def with_support(things: Things, looks: Sequence[Look], level: float) -> Things:
    """The same in a world whose z is up, with the plane at `level` as the support: the things that mostly lie there."""
    votes = np.zeros((FIRST + things.count, 2))
    for look in looks:
        ids, met = things.of(look), plane_depth(look.K, look.cam_to_world, look.depth.shape, level)
        there = (met > 0) & (np.abs(met / look.depth - 1) < NEAR)
        votes[:, 0] += np.bincount(ids[there], minlength=len(votes))
        votes[:, 1] += np.bincount(ids.ravel(), minlength=len(votes))
    share = votes[:, 0] / np.maximum(votes[:, 1], 1)
    large = votes[:, 1] > BROAD * sum(look.depth.size for look in looks)
    support = np.flatnonzero((share > FLAT) & large)
    if not len(support[support >= FIRST]):
        # One thing at least: the one that has most of it.
        support = np.array([FIRST + int(votes[FIRST:, 0].argmax())]) if things.count else support
    named = frozenset(int(h) for h in support if h >= FIRST)
    return replace(things, support=named, level=level)


def plane_depth(
    K: Float64[np.ndarray, "3 3"],
    cam_to_world: Float64[np.ndarray, "4 4"],
    shape: tuple[int, ...],
    level: float,
) -> Float64[np.ndarray, "h w"]:
    """Depth at which each pixel's ray meets the plane z = `level`; 0 where it never does."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    x, y = (columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1]
    down = cam_to_world[2, 0] * x + cam_to_world[2, 1] * y + cam_to_world[2, 2]
    with np.errstate(divide="ignore"):
        met = (level - cam_to_world[2, 3]) / down
    return np.where(np.isfinite(met) & (met > 0), met, 0.0)
