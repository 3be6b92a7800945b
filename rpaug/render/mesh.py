"""Triangles drawn as a camera sees them: which one is nearest at each pixel, and where in it the pixel's ray hits."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int16

from rpaug.core import geometry
from rpaug.core.jit import kernel
from rpaug.core.types import Mesh

NEAREST = 0.005  # metres before the camera: a triangle that reaches nearer is not drawn


@dataclass(frozen=True)
class MeshView:
    """What one camera sees of a mesh, per pixel; only where `hit` does the rest mean anything.

    `depth` is in metres, `normals` are unit vectors in the world towards the camera, `albedo` display sRGB in 0..1.
    """

    hit: Bool[np.ndarray, "h w"]
    depth: Float64[np.ndarray, "h w"]
    normals: Float32[np.ndarray, "h w 3"]
    albedo: Float32[np.ndarray, "h w 3"]


def draw(
    mesh: Mesh,
    to_world: Float64[np.ndarray, "4 4"],
    K: Float64[np.ndarray, "3 3"],
    cam_to_world: Float64[np.ndarray, "4 4"],
    size: tuple[int, int],
) -> MeshView:
    """The mesh as the camera `K`, `cam_to_world` of `size` (width, height) sees it, sampled at pixels' centres."""
    width, height = size
    pose = geometry.inverse(cam_to_world) @ to_world
    local = geometry.transform(pose, mesh.points)
    near = np.zeros((height, width))
    face = np.full((height, width), -1, np.int32)
    weights = np.zeros((height, width, 3))
    _rasterise(local, mesh.faces, K, near, face, weights)
    hit = face >= 0
    normals, albedo = (
        np.zeros((height, width, 3), np.float32),
        np.zeros((height, width, 3), np.float32),
    )
    if hit.any():
        corners = mesh.faces[face[hit]]
        share = weights[hit][..., None]
        world = ((mesh.normals[corners] * share).sum(1)) @ to_world[:3, :3].T
        rows, columns = np.nonzero(hit)
        ray = geometry.rays(columns, rows, K)
        away = (world * (ray @ cam_to_world[:3, :3].T)).sum(-1) > 0
        world *= np.where(away, -1.0, 1.0)[:, None]
        normals[hit] = world / np.maximum(np.linalg.norm(world, axis=-1, keepdims=True), 1e-9)
        spread = _spread(mesh, local[corners], mesh.uv[corners], ray, K)
        albedo[hit] = look_up(mesh, (mesh.uv[corners] * share).sum(1), spread)
    depth = np.divide(1.0, near, out=np.zeros_like(near), where=hit)
    return MeshView(hit, depth, normals, albedo)


@dataclass(frozen=True)
class NearestView:
    """What one camera sees of several meshes: depth in metres, which one (-1: none), normals in the world."""

    depth: Float64[np.ndarray, "h w"]
    number: Int16[np.ndarray, "h w"]
    normals: Float32[np.ndarray, "h w 3"]


def nearest(
    meshes: Sequence[tuple[Mesh, Float64[np.ndarray, "4 4"]]],
    K: Float64[np.ndarray, "3 3"],
    cam_to_world: Float64[np.ndarray, "4 4"],
    size: tuple[int, int],
) -> NearestView:
    """The nearest of some meshes, each with its pose in the world, in each pixel of `size` (width, height)."""
    depth = np.full(size[::-1], np.inf)
    number = np.full(size[::-1], -1, np.int16)
    normals = np.zeros((*size[::-1], 3), np.float32)
    for n, (each, to_world) in enumerate(meshes):
        seen = draw(each, to_world, K, cam_to_world, size)
        nearer = seen.hit & (seen.depth < depth)
        depth[nearer], number[nearer] = seen.depth[nearer], n
        normals[nearer] = seen.normals[nearer]
    return NearestView(np.where(number >= 0, depth, 0.0), number, normals)


def depths(
    meshes: Sequence[tuple[Mesh, Float64[np.ndarray, "4 4"]]],
    K: Float64[np.ndarray, "3 3"],
    cam_to_world: Float64[np.ndarray, "4 4"],
    size: tuple[int, int],
) -> Float64[np.ndarray, "h w"]:
    """Metres to the nearest of some meshes in each pixel of `size` (width, height), 0 where there is none."""
    near = np.zeros(size[::-1])
    face, weights = np.full(near.shape, -1, np.int32), np.zeros((*near.shape, 3))
    to_camera = geometry.inverse(cam_to_world)
    for each, to_world in meshes:
        local = geometry.transform(to_camera @ to_world, each.points)
        _rasterise(local, each.faces, K, near, face, weights)
    return np.divide(1.0, near, out=np.zeros_like(near), where=near > 0)


@kernel
def _rasterise(points, faces, K, near, face, weights):
    """Per pixel the largest 1/z of all triangles, whose it is, and the hit's weights of its corners."""
    height, width = near.shape
    x, y, w = np.empty(3), np.empty(3), np.empty(3)
    for f in range(len(faces)):
        behind = False
        for k in range(3):
            p = points[faces[f, k]]
            if p[2] < NEAREST:
                behind = True
                break
            w[k] = 1.0 / p[2]
            x[k] = K[0, 0] * p[0] * w[k] + K[0, 2]
            y[k] = K[1, 1] * p[1] * w[k] + K[1, 2]
        if behind:
            continue
        area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
        if area == 0.0:
            continue
        left, right = max(math.ceil(x.min()), 0), min(math.floor(x.max()), width - 1)
        top, bottom = max(math.ceil(y.min()), 0), min(math.floor(y.max()), height - 1)
        for v in range(top, bottom + 1):
            for u in range(left, right + 1):
                a = ((x[1] - u) * (y[2] - v) - (x[2] - u) * (y[1] - v)) / area
                b = ((x[2] - u) * (y[0] - v) - (x[0] - u) * (y[2] - v)) / area
                c = 1.0 - a - b
                if a < 0.0 or b < 0.0 or c < 0.0:
                    continue
                hit = a * w[0] + b * w[1] + c * w[2]
                if hit > near[v, u]:
                    near[v, u] = hit
                    face[v, u] = f
                    weights[v, u, 0] = a * w[0] / hit
                    weights[v, u, 1] = b * w[1] / hit
                    weights[v, u, 2] = c * w[2] / hit


def _spread(
    mesh: Mesh,
    corners: Float64[np.ndarray, "n 3 3"],
    uv: Float64[np.ndarray, "n 3 2"],
    ray: Float64[np.ndarray, "n 3"],
    K: Float64[np.ndarray, "3 3"],
) -> Float64[np.ndarray, "n"]:
    """Texels that go on a pixel along its longer side, as renderers count them (Heckbert 1983): a corner's weight is
    its share of a sum, and linear in the ray."""
    sides = np.stack([np.cross(corners[:, k - 2], corners[:, k - 1]) for k in range(3)], 1)
    weight = np.einsum("nkj,nj->nk", sides, ray)
    total = weight.sum(1)[:, None]
    at = np.einsum("nk,nkc->nc", weight, uv) / total
    longest = np.zeros(len(ray))
    for axis in range(2):
        step = sides[:, :, axis] / K[axis, axis]
        moved = (np.einsum("nk,nkc->nc", step, uv) - at * step.sum(1)[:, None]) / total
        longest = np.maximum(longest, np.linalg.norm(moved * mesh.image.shape[1::-1], axis=1))
    return longest


@lru_cache(64)
def texels(mesh: Mesh) -> Float64[np.ndarray, "f"]:
    """Texels of the image to a metre on each face."""
    corners, tiles = mesh.points[mesh.faces], mesh.uv[mesh.faces] * mesh.image.shape[1::-1]
    sides = corners[:, 1:] - corners[:, :1]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=-1)
    flat = tiles[:, 1:] - tiles[:, :1]
    covered = np.abs(flat[:, 0, 0] * flat[:, 1, 1] - flat[:, 0, 1] * flat[:, 1, 0])
    return np.sqrt(covered / np.maximum(area, 1e-12))


@lru_cache(64)
def _pyramid(mesh: Mesh) -> tuple[Float32[np.ndarray, "h w 3"], ...]:
    """The image, and the same ever half as large."""
    levels: list[np.ndarray] = [mesh.image.astype(np.float32) / 255]
    while min(levels[-1].shape[:2]) > 1:
        height, width = levels[-1].shape[:2]
        levels.append(
            cv2.resize(
                levels[-1], (max(width // 2, 1), max(height // 2, 1)), interpolation=cv2.INTER_AREA
            )
        )
    return tuple(levels)


def look_up(
    mesh: Mesh, uv: Float64[np.ndarray, "n 2"], spread: Float64[np.ndarray, "n"]
) -> Float32[np.ndarray, "n 3"]:
    """The image at those places, linear between texels and between sizes of texels (Williams 1983); `spread` texels go
    on a pixel."""
    levels = _pyramid(mesh)
    wanted = np.minimum(np.log2(np.maximum(spread, 1.0)), len(levels) - 1)
    finer = np.floor(wanted).astype(int)
    out = np.zeros((len(uv), 3), np.float32)
    for size, level in enumerate(levels):
        share = np.where(
            finer == size, 1 - (wanted - size), np.where(finer == size - 1, wanted - finer, 0)
        )
        rows = share > 0
        if rows.any():
            out[rows] += share[rows, None].astype(np.float32) * _bilinear(level, uv[rows])
    return out


def _bilinear(
    image: Float32[np.ndarray, "h w 3"], uv: Float64[np.ndarray, "n 2"]
) -> Float32[np.ndarray, "n 3"]:
    height, width = image.shape[:2]
    at = np.stack([uv[:, 0] * width, (1 - uv[:, 1]) * height], -1) - 0.5
    corner = np.floor(at).astype(int)
    out = np.zeros((len(uv), 3), np.float32)
    for right in (0, 1):
        for down in (0, 1):
            step = corner + np.array([right, down])
            weight = (1 - np.abs(at - step)).prod(1)
            out += weight[:, None] * image[step[:, 1] % height, step[:, 0] % width]
    return out
