"""A mesh as Gaussians: points drawn evenly from its surface, each a flat disc in the color of its texture."""

import numpy as np
from jaxtyping import Float64

from rpaug.core.types import Gaussians, Mesh
from rpaug.gaussians.carrying import SH0
from rpaug.gaussians.gaussians import quaternions
from rpaug.render import mesh as triangles

COUNT = 50_000
SPREAD = (
    0.6  # standard deviation over the mean distance of neighbours: less leaves gaps, more blurs
)
THIN = 0.05  # thickness over that
OPACITY = 0.98


def gaussians(thing: Mesh, count: int = COUNT) -> Gaussians:
    """`count` Gaussians on the mesh, in its frame: as many on a face as its share of the area.

    The same mesh gives the same ones.
    """
    corners = thing.points[thing.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=-1) / 2
    face, share = _drawn(area, count)
    chosen = thing.faces[face]
    points = (thing.points[chosen] * share[..., None]).sum(1)
    size = np.full(count, SPREAD * np.sqrt(area.sum() / count))
    texels = triangles.texels(thing)[face] * size
    color = triangles.look_up(thing, (thing.uv[chosen] * share[..., None]).sum(1), texels)
    flat = across[face] / np.maximum(2 * area[face], 1e-15)[:, None]
    return Gaussians(
        means=points.astype(np.float32),
        quats=quaternions(_frames(flat)).astype(np.float32),
        scales=np.stack([size, size, THIN * size], -1).astype(np.float32),
        opacities=np.full(count, OPACITY, np.float32),
        sh=((color - 0.5) / SH0)[:, None].astype(np.float32),
        ids=np.zeros(count, np.int32),
    )


def _drawn(
    area: Float64[np.ndarray, "f"], count: int
) -> tuple[np.ndarray, Float64[np.ndarray, "n 3"]]:
    """Faces, and weights of their corners: evenly spaced along the summed area, in each face by a low-discrepancy
    sequence (R2, Roberts 2018) folded into the triangle."""
    edges = np.cumsum(area)
    place = (np.arange(count) + 0.5) / count * edges[-1]
    face = np.minimum(np.searchsorted(edges, place), len(area) - 1)
    number = np.arange(count) + 1
    ratio = 1.32471795724474602596
    u, v = (number / ratio) % 1.0, (number / ratio**2) % 1.0
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    return face, np.stack([1 - u - v, u, v], -1)


def _frames(normals: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3 3"]:
    """Rotations whose third column is the normal."""
    axis = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(normals, axis)
    first /= np.maximum(np.linalg.norm(first, axis=-1, keepdims=True), 1e-12)
    return np.stack([first, np.cross(normals, first), normals], -1)
