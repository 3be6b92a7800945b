"""Meshes of turned, folded and bent household shapes, standing on z = 0 about the z axis, in metres."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int32, UInt8

from rpaug.core.types import Mesh

Parts = list[np.ndarray]

AROUND = 40  # segments of a turned shape
SHARP = 0.6  # radians: an edge of a profile that turns by more is seen as an edge
INSET = 0.02  # of a tile of the image: kept free, so that no neighbour shows at a seam


@dataclass(frozen=True)
class Piece:
    """Part of a shape with a picture of its own; `uv` within 0..1."""

    points: Float64[np.ndarray, "v 3"]
    normals: Float64[np.ndarray, "v 3"]
    uv: Float64[np.ndarray, "v 2"]
    faces: Int32[np.ndarray, "f 3"]
    picture: UInt8[np.ndarray, "n n 3"]


def _piece(points: Parts, normals: Parts, uv: Parts, faces: Parts, picture: np.ndarray) -> Piece:
    return Piece(
        np.concatenate(points),
        np.concatenate(normals),
        np.concatenate(uv),
        np.concatenate(faces).astype(np.int32),
        picture,
    )


def joined(pieces: Sequence[Piece]) -> Mesh:
    """One mesh, its pieces' pictures side by side in one image."""
    points, normals, uv, faces, count = [], [], [], [], 0
    for index, piece in enumerate(pieces):
        points.append(piece.points)
        normals.append(piece.normals)
        inside = INSET + (1 - 2 * INSET) * piece.uv
        uv.append((inside + np.array([index, 0.0])) / [len(pieces), 1])
        faces.append(piece.faces + count)
        count += len(piece.points)
    return Mesh(
        np.concatenate(points),
        np.concatenate(normals),
        np.concatenate(uv),
        np.concatenate(faces).astype(np.int32),
        np.concatenate([piece.picture for piece in pieces], 1),
    )


def turned(profile: Sequence[tuple[float, float]], picture: UInt8[np.ndarray, "n n 3"]) -> Piece:
    """A shape turned about z from (radius, height) pairs, outside first going up: the picture once around."""
    line = np.array(profile, float)
    step = np.diff(line, axis=0)
    length = np.linalg.norm(step, axis=1)
    across = np.stack([step[:, 1], -step[:, 0]], -1) / length[:, None]
    along = np.concatenate([[0.0], np.cumsum(length)]) / length.sum()
    turn = np.linspace(0, 2 * np.pi, AROUND + 1)
    points: Parts = []
    normals: Parts = []
    uv: Parts = []
    faces: Parts = []
    for k in range(len(step)):
        ends = [_blended(across, k, k - 1), _blended(across, k, k + 1)]
        for end in (0, 1):
            radius, height = line[k + end]
            ring = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], -1)
            points.append(radius * ring + [0, 0, height])
            normals.append(ends[end][0] * ring + [0, 0, ends[end][1]])
            uv.append(np.stack([turn / (2 * np.pi), np.full_like(turn, along[k + end])], -1))
        faces.append(_strip(2 * k * (AROUND + 1)))
    return _piece(points, normals, uv, faces, picture)


def _blended(across: Float[np.ndarray, "k 2"], here: int, there: int) -> Float64[np.ndarray, "2"]:
    """A segment's normal at its end: the mean with its neighbour's, unless there is an edge between."""
    if not 0 <= there < len(across) or across[here] @ across[there] < np.cos(SHARP):
        return across[here]
    both = across[here] + across[there]
    return both / np.linalg.norm(both)


def _strip(first: int) -> Int32[np.ndarray, "f 3"]:
    low = first + np.arange(AROUND)
    high = low + AROUND + 1
    return np.concatenate(
        [np.stack([low, low + 1, high + 1], -1), np.stack([low, high + 1, high], -1)]
    ).astype(np.int32)


def box(
    size: tuple[float, float, float],
    picture: UInt8[np.ndarray, "n n 3"],
    middle: tuple[float, float] = (0.0, 0.0),
    foot: float = 0.0,
) -> Piece:
    """A box of length, width and height, the picture on every side."""
    half = np.array(size) / 2
    points: Parts = []
    normals: Parts = []
    uv: Parts = []
    faces: Parts = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            right, up = (
                ((axis + 1) % 3, (axis + 2) % 3) if sign > 0 else ((axis + 2) % 3, (axis + 1) % 3)
            )
            corners = np.zeros((4, 3))
            corners[:, axis] = sign
            corners[:, right], corners[:, up] = [-1, 1, 1, -1], [-1, -1, 1, 1]
            faces.append(4 * len(points) + np.array([[0, 1, 2], [0, 2, 3]]))
            points.append(corners * half + [*middle, half[2] + foot])
            normals.append(np.tile(sign * np.eye(3)[axis], (4, 1)))
            # Pictures stand upright on the sides that do.
            uv.append(
                np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])[
                    :, :: 1 if up == 2 or axis == 2 else -1
                ]
            )
    return _piece(points, normals, uv, faces, picture)


def prism(
    outline: Sequence[tuple[float, float]], height: float, picture: UInt8[np.ndarray, "n n 3"]
) -> Piece:
    """A convex outline, counter-clockwise from above, raised to a height."""
    corners = np.array(outline, float)
    count = len(corners)
    reach = np.abs(corners).max()
    points: Parts = []
    normals: Parts = []
    uv: Parts = []
    faces: Parts = []
    for k in range(count):
        a, b = corners[k], corners[(k + 1) % count]
        out = np.array([b[1] - a[1], a[0] - b[0], 0.0])
        faces.append(4 * k + np.array([[0, 1, 2], [0, 2, 3]]))
        points.append(np.array([[*a, 0], [*b, 0], [*b, height], [*a, height]]))
        normals.append(np.tile(out / np.linalg.norm(out), (4, 1)))
        uv.append(np.array([[k, 0], [k + 1, 0], [k + 1, 1], [k, 1]]) / [count, 1])
    for z, sign in ((0.0, -1.0), (height, 1.0)):
        first = sum(map(len, points))
        fan = np.array([[0, k, k + 1] for k in range(1, count - 1)])
        faces.append(first + (fan if sign > 0 else fan[:, ::-1]))
        points.append(np.concatenate([corners, np.full((count, 1), z)], 1))
        normals.append(np.tile([0, 0, sign], (count, 1)))
        uv.append(0.5 + 0.5 * corners / reach)
    return _piece(points, normals, uv, faces, picture)


def bent(
    path: Float[np.ndarray, "k 3"],
    radius: float,
    picture: UInt8[np.ndarray, "n n 3"],
    sides: int = 10,
) -> Piece:
    """A round bar along a path that lies in a plane through z, as a handle does."""
    ahead = np.gradient(path, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    level = np.cross(ahead[0], ahead[-1])
    side = (
        level / np.linalg.norm(level) if np.linalg.norm(level) > 1e-9 else np.array([0.0, 1.0, 0.0])
    )
    turn = np.linspace(0, 2 * np.pi, sides + 1)
    points: Parts = []
    normals: Parts = []
    uv: Parts = []
    faces: Parts = []
    for k, (spot, way) in enumerate(zip(path, ahead, strict=True)):
        out = np.cross(way, side)
        ring = np.cos(turn)[:, None] * out + np.sin(turn)[:, None] * side
        points.append(spot + radius * ring)
        normals.append(ring)
        uv.append(np.stack([turn / (2 * np.pi), np.full_like(turn, k / (len(path) - 1))], -1))
        if k:
            low = (k - 1) * (sides + 1) + np.arange(sides)
            high = low + sides + 1
            faces.append(
                np.concatenate(
                    [np.stack([low, high + 1, low + 1], -1), np.stack([low, high, high + 1], -1)]
                )
            )
    return _piece(points, normals, uv, faces, picture)
