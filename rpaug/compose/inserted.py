"""Things that were never recorded, drawn into a finished view: they hide what is farther, nearer things hide them."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float32, Float64, Int32, UInt8

from rpaug.core import color_space, geometry
from rpaug.core.types import Ambience, Body, Camera, Mesh, Scene
from rpaug.render import mesh
from rpaug.render.pinhole import NEAR
from rpaug.render.unmix import slits
from rpaug.render.window import Window
from rpaug.scene.lighting import irradiance

SAMPLES = 4  # along each side of a pixel, where the recording's outlines are smooth
KEPT = 32  # drawings of things that stand, in cameras that stand
MOST_KEPT = 1 << 18  # samples of a drawing that is kept
EVEN = Ambience(tuple(irradiance.even().tolist()), (1.0, 1.0, 1.0))

Image = tuple[UInt8[np.ndarray, "h w 3"], Float32[np.ndarray, "h w"], Int32[np.ndarray, "h w"]]


def bodies(scene: Scene) -> tuple[Body, ...]:
    """Those of the scene that are drawn from what they are, not from recorded pixels."""
    return tuple(body for body in scene.bodies if body.mesh is not None or body.soft is not None)


def draw(scene: Scene, camera: Camera, t: int, before: Image) -> Image:
    """Color, depth in metres (0: nothing there) and instance ids once all that has a shape of its own stands there
    too.
    """
    rgb, depth, ids = before
    ambience = scene.ambience or EVEN
    for body in bodies(scene):
        if body.soft is not None:
            from rpaug.compose import softened  # only here: it brings the rasteriser

            rgb, depth, ids = softened.draw(
                body.soft, scene.antialiased, camera, t, (rgb, depth, ids)
            )
            continue
        if body.splats is not None:
            rgb, depth, ids = _splatted(scene, body, camera, t, (rgb, depth, ids))
            continue
        piece = _piece(body, camera, t)
        if piece is None:
            continue
        at = np.s_[piece.rows, piece.columns]
        seen = _drawn(body, piece, t, 1)
        front = seen.hit & ((depth[at] <= 0) | (seen.depth < depth[at]))
        rgb, depth, ids = rgb.copy(), depth.copy(), ids.copy()
        if scene.antialiased:
            mixed = slits(before[1][at], before[2][at])
            fine = _drawn(body, piece, t, SAMPLES)
            rgb[at] = np.where(
                mixed[..., None], rgb[at], _blended(rgb[at], depth[at], fine, ambience)
            )
        else:
            rgb[at][front] = _lit(seen.albedo[front], seen.normals[front], ambience)
        (instance_id,) = body.instance_ids
        depth[at][front], ids[at][front] = seen.depth[front], instance_id
    return rgb, depth, ids


def _splatted(scene: Scene, body: Body, camera: Camera, t: int, before: Image) -> Image:
    """The same for a body of Gaussians: blended with what lies behind where the recording's outlines are smooth, cut
    at its surface where they are sharp. Its light is in its colors. The surface is its mesh's, if that is known."""
    from rpaug.compose import splatted  # only here: it brings the rasteriser

    picture = splatted.draw(body, camera, t, sharp_edges=not scene.antialiased)
    if picture is None:
        return before
    height, width = picture.alpha.shape
    if body.outlined:
        rows, columns = (
            slice(picture.row, picture.row + height),
            slice(picture.column, picture.column + width),
        )
        piece = Window(rows, columns, camera.K, camera.cam_to_world[t])
        solid = _drawn(body, piece, t, 1)
        picture = replace(picture, depth=solid.depth.astype(np.float32))  # 0 where it misses
    at = np.s_[picture.row : picture.row + height, picture.column : picture.column + width]
    rgb, depth, ids = (plane.copy() for plane in before)
    near = splatted.nearest(picture)
    seen = (picture.alpha > splatted.FAINT) & (near > 0)
    seen &= (depth[at] <= 0) | (near < depth[at])
    surface = seen & (picture.depth > 0)
    if scene.antialiased:
        color = picture.color + (1 - picture.alpha[..., None]) * rgb[at].astype(np.float32) / 255
    else:
        seen = surface
        color = picture.color / np.maximum(picture.alpha, splatted.FAINT)[..., None]
    rgb[at][seen] = np.rint(np.clip(color[seen], 0, 1) * 255).astype(np.uint8)
    (instance_id,) = body.instance_ids
    depth[at][surface], ids[at][surface] = picture.depth[surface], instance_id
    return rgb, depth, ids


def lit(
    albedo: Float32[np.ndarray, "n 3"], normals: Float32[np.ndarray, "n 3"], ambience: Ambience
) -> Float32[np.ndarray, "n 3"]:
    """Colors in 0..1 of surfaces under the scene's light, no darker and no brighter than the recording gets."""
    shade = irradiance.shading(irradiance.basis(normals), np.array(ambience.light))
    color = np.clip(albedo * shade[:, None] * np.array(ambience.tint, np.float32), 0, 1)
    return color if ambience.lightness is None else _within(color, ambience.lightness)


def _piece(body: Body, camera: Camera, t: int) -> Window | None:
    """The part of the image that can show the body, None if none can."""
    assert body.mesh is not None
    at = body.to_world[t], camera.cam_to_world[t], camera.K
    found = _extent(body.mesh, *(one.tobytes() for one in at), (camera.width, camera.height))
    return None if found is None else Window(*found, camera.K, camera.cam_to_world[t])


@lru_cache(KEPT)
def _extent(
    thing: Mesh, pose: bytes, cam_to_world: bytes, K: bytes, size: tuple[int, int]
) -> tuple[slice, slice] | None:
    """Rows and columns of an image that can show a thing."""
    world = geometry.transform(_matrix(pose, 4), thing.points)
    camera = Camera(_matrix(K, 3), _matrix(cam_to_world, 4)[None], *size)
    pixel, z = geometry.project(world, camera, 0)
    first, last = np.zeros(2, int), np.array(size)
    if (z > NEAR).all():
        first = np.clip(np.floor(pixel.min(0)).astype(int) - 1, 0, size)
        last = np.clip(np.ceil(pixel.max(0)).astype(int) + 2, 0, size)
    elif not (z > NEAR).any():
        return None
    if (first >= last).any():
        return None
    columns, rows = (slice(int(low), int(high)) for low, high in zip(first, last, strict=True))
    return rows, columns


def _drawn(body: Body, piece: Window, t: int, samples: int) -> mesh.MeshView:
    """The body as the piece shows it, `samples` along each side of a pixel."""
    assert body.mesh is not None
    K = piece.own
    # Sample (i, j) of a pixel lies at (i + 1/2) / samples - 1/2 from its centre.
    K[:2] *= samples
    K[:2, 2] += (samples - 1) / 2
    width, height = (samples * side for side in piece.size)
    pose, camera = body.to_world[t].tobytes(), piece.cam_to_world.tobytes()
    draw = _kept if width * height <= MOST_KEPT else _kept.__wrapped__
    return draw(body.mesh, pose, K.tobytes(), camera, (width, height))


@lru_cache(KEPT)
def _kept(
    thing: Mesh, pose: bytes, K: bytes, camera: bytes, size: tuple[int, int]
) -> mesh.MeshView:
    """What was drawn before looks the same wherever thing and camera stand as they did."""
    return mesh.draw(thing, _matrix(pose, 4), _matrix(K, 3), _matrix(camera, 4), size)


def _matrix(given: bytes, side: int) -> Float64[np.ndarray, "side side"]:
    return np.frombuffer(given).reshape(side, side)


def _blended(
    rgb: UInt8[np.ndarray, "h w 3"],
    depth: Float32[np.ndarray, "h w"],
    fine: mesh.MeshView,
    ambience: Ambience,
) -> UInt8[np.ndarray, "h w 3"]:
    """The colors with each pixel's share of the thing, as an anti-aliased recording would show it."""
    behind = depth.repeat(SAMPLES, 0).repeat(SAMPLES, 1)
    front = fine.hit & ((behind <= 0) | (fine.depth < behind))
    color = np.zeros((*front.shape, 3), np.float32)
    color[front] = _lit(fine.albedo[front], fine.normals[front], ambience)
    share = _pooled(front.astype(np.float32)[..., None])
    mixed = _pooled(color) + (1 - share) * rgb
    return np.where(share > 0, np.rint(mixed).astype(np.uint8), rgb)


def _pooled(fine: Float32[np.ndarray, "h w k"]) -> Float32[np.ndarray, "h w k"]:
    height, width, depth = fine.shape
    return fine.reshape(height // SAMPLES, SAMPLES, width // SAMPLES, SAMPLES, depth).mean((1, 3))


def _lit(
    albedo: Float32[np.ndarray, "n 3"], normals: Float32[np.ndarray, "n 3"], ambience: Ambience
) -> UInt8[np.ndarray, "n 3"]:
    return np.rint(lit(albedo, normals, ambience) * 255).astype(np.uint8)


def _within(
    color: Float32[np.ndarray, "n 3"], lightness: tuple[float, float]
) -> Float32[np.ndarray, "n 3"]:
    """Lightness held within what was recorded (CIELAB); colors inside stay as they are."""
    lab = color_space.to_lab(color)
    held = np.clip(lab[:, 0], *lightness)
    outside = held != lab[:, 0]
    if not outside.any():
        return color
    lab[:, 0] = held
    shown = np.clip(color_space.from_lab(lab), 0, 1)
    return np.where(outside[:, None], shown, color).astype(np.float32)
