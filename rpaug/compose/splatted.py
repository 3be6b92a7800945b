"""An inserted thing of Gaussians, drawn into a finished view: its color is blended, its depth is one surface's."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32, Float64, Int32

from rpaug.core import geometry
from rpaug.core.pixels import filled
from rpaug.core.types import Body, Camera, Gaussians
from rpaug.gaussians import gaussians, harmonics
from rpaug.gaussians.gaussian_view import plane_depth, sharp, view_of
from rpaug.render.splat import Rasteriser, Settings, Splats

REACH = 3.0  # standard deviations that a Gaussian is seen out to
FAINT = 1 / 255  # share of a pixel below which nothing is shown
FINE = 0.6  # samples that a typical Gaussian's standard deviation covers, at least
MOST_SAMPLES = 1 << 20  # of one picture
SAME_FACE = 0.7  # cosine between normals of one face, and of a curved one's neighbouring places


@dataclass(frozen=True)
class SplatImage:
    """A thing alone, in a piece of a camera's image whose first pixel is (`row`, `column`).

    `color` is 0..1, already multiplied by `alpha`, the share of light that the thing takes. `depth` in metres is that
    of the surface at which half of the light is gone, 0 where it never is; never a mean over surfaces.
    """

    row: int
    column: int
    color: Float32[np.ndarray, "h w 3"]
    alpha: Float32[np.ndarray, "h w"]
    depth: Float32[np.ndarray, "h w"]


def standing(splats: Gaussians, to_world: Float64[np.ndarray, "4 4"]) -> Gaussians:
    """Gaussians of a body's frame in the world, their colors turned along."""
    there = gaussians.moved(splats, to_world)
    return replace(there, sh=harmonics.turned(splats.sh, to_world[:3, :3]))


def draw(body: Body, camera: Camera, t: int, sharp_edges: bool = False) -> SplatImage | None:
    """The body alone as the camera sees it at t, None if it is out of sight.

    With `sharp_edges` a pixel is of the face in its middle alone, as where nothing was anti-aliased.
    """
    assert body.splats is not None
    there = standing(body.splats, body.to_world[t])
    window = _window(there, camera, t)
    if window is None:
        return None
    row, column, height, width = window
    samples = _samples(there, camera, t, height * width)
    K = camera.K.copy()
    K[:2, 2] -= column, row
    # Sample (i, j) of a pixel lies at (i + 1/2) / samples - 1/2 from its centre.
    K[:2] *= samples
    K[:2, 2] += (samples - 1) / 2
    piece = replace(camera, K=K, width=width * samples, height=height * samples)
    splats = Splats.of(there)
    drawn = Rasteriser(small(splats)).forward(splats, view_of(piece, t))
    depth = plane_depth(drawn, splats, piece, t)[samples // 2 :: samples, samples // 2 :: samples]
    color, alpha = _pooled(drawn.color, samples), _pooled(drawn.alpha, samples)
    if sharp_edges and samples > 1:
        face = _one_face(outward(there, piece, t), drawn.surface_index, samples)
        light = _pooled(drawn.alpha * face, samples)
        own = _pooled(drawn.color * face[..., None], samples) / np.maximum(light, FAINT)[..., None]
        color = np.where((light > FAINT)[..., None], own * alpha[..., None], color)
    return SplatImage(row, column, color, alpha, depth)


def _one_face(
    faces: Float32[np.ndarray, "n 3"], shown: Int32[np.ndarray, "h w"], samples: int
) -> Float32[np.ndarray, "h w"]:
    """1 for samples of the face that the middle of their pixel shows, 0 for others."""
    known = shown >= 0
    normal = np.where(known[..., None], faces[np.maximum(shown, 0)], 0)
    middle = normal[samples // 2 :: samples, samples // 2 :: samples]
    middle = middle.repeat(samples, 0).repeat(samples, 1)
    return ((normal * middle).sum(-1) > SAME_FACE).astype(np.float32)


def outward(there: Gaussians, camera: Camera, t: int) -> Float32[np.ndarray, "n 3"]:
    """Each Gaussian's shortest axis, to the side from which the camera sees it."""
    order = there.scales.argmin(1)
    axes = np.stack([gaussians.normals(_led(there.quats, axis)) for axis in range(3)], 1)
    across = axes[np.arange(len(order)), order]
    away = (across * (there.means - camera.cam_to_world[t, :3, 3])).sum(1) > 0
    return np.where(away[:, None], -across, across).astype(np.float32)


def _led(quats: Float32[np.ndarray, "n 4"], axis: int) -> Float32[np.ndarray, "n 4"]:
    """Quaternions whose third axis is the given one of these: a third of a turn brings each axis on the next."""
    w, x, y, z = quats.T
    if axis == 2:
        return quats
    if axis == 0:  # times (1, 1, 1, 1) / 2, which takes z to x
        return np.stack([w - x - y - z, w + x + y - z, w - x + y + z, w + x - y + z], 1) / 2
    return np.stack([w + x + y + z, -w + x - y + z, -w + x + y - z, -w - x + y + z], 1) / 2


def _samples(there: Gaussians, camera: Camera, t: int, pixels: int) -> int:
    """Along each side of a pixel, an odd number, so that a typical Gaussian is not much smaller than a sample: what is
    smaller is blurred, and a blur loses light at outlines."""
    middle, size = np.median(there.means, axis=0), float(np.median(there.scales.max(1)))
    _, z = geometry.project(middle[None].astype(np.float64), camera, t)
    wide = size * camera.K[0, 0] / max(float(z[0]), 1e-3)
    most = max(1, int(np.sqrt(MOST_SAMPLES / max(pixels, 1))))
    return max(1, min(int(np.ceil(FINE / max(wide, 1e-6))), most, 15) // 2 * 2 + 1)


def _pooled(fine: Float32[np.ndarray, "h w ..."], samples: int) -> Float32[np.ndarray, "h w ..."]:
    height, width, *rest = fine.shape
    shape = (height // samples, samples, width // samples, samples, *rest)
    return fine.reshape(shape).mean((1, 3))


def small(splats: Splats) -> Settings:
    """Gaussians that may be smaller than a pixel must not grow by being drawn (Mip-Splatting, Yu et al. 2024)."""
    return replace(sharp(splats), antialiased=True)


def nearest(picture: SplatImage) -> Float32[np.ndarray, "h w"]:
    """The depth of each pixel's nearest surface: what a faint rim is hidden by is what hides the surface beside it."""
    known = picture.depth > 0
    if not known.any():
        return picture.depth
    return filled(picture.depth, known)


def _window(there: Gaussians, camera: Camera, t: int) -> tuple[int, int, int, int] | None:
    """First row and column, height and width of the pixels that the Gaussians can reach."""
    pixel, z = geometry.project(there.means.astype(np.float64), camera, t)
    ahead = z > 1e-3
    if not ahead.any():
        return None
    reach = 2 + REACH * there.scales.max(1)[ahead] / z[ahead] * max(camera.K[0, 0], camera.K[1, 1])
    low = np.floor((pixel[ahead] - reach[:, None]).min(0)).clip(0)
    high = np.ceil((pixel[ahead] + reach[:, None]).max(0))
    high = np.minimum(high, [camera.width - 1, camera.height - 1])
    if (high < low).any():
        return None
    (left, top), (right, bottom) = low.astype(int), high.astype(int)
    return int(top), int(left), int(bottom - top + 1), int(right - left + 1)
