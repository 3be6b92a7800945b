"""Images laid on parts by box projection: the exact mapping, and the mesh that makes OpenGL draw just that.

Each axis of the body's own frame has a picture, seen from outside along it: upright where z points
up, on the two z faces where y does. A point shows the picture of the axis that its surface's normal
mainly points along. Metres to the right and up, from the frame's origin, divided by the cover's
`side` count tiles: the first to the right in the image, the second up from its lower edge.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, Int, UInt8

from rpaug.core import geometry
from rpaug.core.errors import RpaugError
from rpaug.twin import textures
from rpaug.twin.world import Geom, Part

PARTS = 4  # strips a face is cut into each way, as MuJoCo cuts its own boxes: light is computed at corners
SLICES = 28  # of a cylinder, as MuJoCo's own


@dataclass(frozen=True, kw_only=True)
class Cover:
    """An image that repeats every `side` metres: one of `textures.KINDS`, drawn from `seed`.

    It takes the place of a part's colors, texture and tint; a tint given in the look multiplies it.
    """

    kind: str
    seed: int
    side: float

    @property
    def image(self) -> UInt8[np.ndarray, "n n 3"]:
        """The tile, its first row uppermost."""
        if self.kind not in textures.KINDS:
            raise RpaugError(
                f"no cover is called {self.kind!r}; there are: {', '.join(textures.KINDS)}"
            )
        return textures.picture(self.kind, self.seed)


@dataclass(frozen=True)
class CoverMesh:
    """Triangles in the body's frame with one normal and one image coordinate (tiles right, tiles up) a corner."""

    points: Float[np.ndarray, "v 3"]
    normals: Float[np.ndarray, "v 3"]
    tiles: Float[np.ndarray, "v 2"]
    faces: Int[np.ndarray, "f 3"]


def coordinates(
    points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], side: float
) -> Float[np.ndarray, "n 2"]:
    """Tiles to the right and up at each point of the body's frame; of equal parts of a normal the first counts."""
    axis = np.abs(normals).round(9).argmax(1)
    facing = np.sign(np.take_along_axis(normals, axis[:, None], 1)[:, 0])
    x, y, z = points.T
    right = np.choose(axis, [y, -x, x]) * facing
    return np.stack([right, np.where(axis == 2, y, z)], -1) / side


def mesh(part: Part, number: int, side: float) -> CoverMesh:
    """The mesh of one of a part's shapes. Raises RpaugError for shapes with round ends."""
    geom = part.geoms[number]
    if geom.shape == "box":
        grids = _box(geom)
    elif geom.shape == "cylinder":
        grids = _cylinder(geom)
    else:
        raise RpaugError(f"{part.name}: a {geom.shape} cannot be covered, only boxes and cylinders")
    points, normals, tiles, faces, count = [], [], [], [], 0
    for corners, smooth in grids:
        triangles = _triangles(corners, count)
        flat = np.cross(corners[0, 1] - corners[0, 0], corners[1, 0] - corners[0, 0])
        flat /= np.linalg.norm(flat)
        surface = corners.reshape(-1, 3)
        facing = np.tile(flat, (len(surface), 1))
        points.append(surface)
        normals.append(smooth.reshape(-1, 3) if smooth is not None else facing)
        tiles.append(coordinates(surface, facing, side))
        faces.append(triangles)
        count += len(surface)
    return CoverMesh(*map(np.concatenate, (points, normals, tiles, faces)))


Grid = tuple[Float[np.ndarray, "r c 3"], Float[np.ndarray, "r c 3"] | None]
"""Corners of one flat face in rows, columns x rows facing outwards, and their normals unless flat."""


def _box(geom: Geom) -> list[Grid]:
    turned = geometry.rotation(np.array([0, 0, geom.yaw]))
    steps = np.linspace(-1, 1, PARTS + 1)
    grids: list[Grid] = []
    for axis in range(3):
        for sign in (-1, 1):
            # (axis, right, up) is right-handed for one sign: then right x up faces outwards.
            right, up = ((axis + 1) % 3, (axis + 2) % 3)[::sign]
            unit = np.empty((len(steps), len(steps), 3))
            unit[..., axis], unit[..., right], unit[..., up] = sign, steps, steps[:, None]
            grids.append(((unit * geom.size) @ turned.T + geom.start, None))
    return grids


def _cylinder(geom: Geom) -> list[Grid]:
    """Flat facets with the normals of the round surface, and two caps of triangles."""
    (radius,) = geom.size
    start, end = np.array(geom.start), np.array(geom.end)
    quaternion, frame = np.empty(4), np.empty(9)
    mujoco.mju_quatZ2Vec(quaternion, (start - end) / np.linalg.norm(start - end))
    mujoco.mju_quat2Mat(frame, quaternion)
    angle = 2 * np.pi * np.arange(SLICES + 1) / SLICES
    out = np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1) @ frame.reshape(3, 3).T
    ring = radius * out
    grids: list[Grid] = []
    for k in range(SLICES):
        normals = np.stack([out[k : k + 2]] * 2)
        grids.append((np.stack([end + ring[k : k + 2], start + ring[k : k + 2]]), normals))
        for middle, order in ((start, 1), (end, -1)):
            a, b = (ring[k], ring[k + 1])[::order]
            grids.append((np.array([[middle, middle + a], [middle + b, middle + b]]), None))
    return grids


def _triangles(corners: Float[np.ndarray, "r c 3"], first: int) -> Int[np.ndarray, "f 3"]:
    rows, columns = corners.shape[:2]
    number = first + np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    both = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    points = corners.reshape(-1, 3)[both - first]
    area = np.linalg.norm(
        np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]), axis=1
    )
    return both[area > 1e-12]
