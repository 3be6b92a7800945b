"""How light falls on a thing, told apart from the pattern that was on it: what a new texture is lit by.

A pixel is albedo times shading, and the pixel alone does not say which of the two a dark spot is. On a thing of one
color everything that varies is shading. On a patterned one, shading is taken to be smooth: a quadratic in the normal
(all that a matte surface keeps of distant light: Ramamoorthi and Hanrahan 2001) and, only if that explains most of what
is left and falls off all around as the light of a near lamp does, in the place: else the broad parts of a pattern would
pass for light. What is then darker than the old pattern's contrast explains is a shadow, and stays.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64

from rpaug.core import memo, sampling
from rpaug.core.errors import SourceLacks, Unsupported
from rpaug.core.jit import kernel
from rpaug.core.types import Body, Episode, Scene
from rpaug.scene.lighting import albedo, highlights, intrinsic, rig
from rpaug.scene.recorded import surface

RGB = tuple[float, float, float]

FRAMES = 6
MOST_PIXELS = 600  # of one thing, from one image
PATTERN = 0.03  # spread of log brightness about the smooth fit from which a surface is taken for patterned
SPREADS = (2.5, 4.0)  # of them, below the fit: from where a pixel may be, and is, in shadow
SHADOW = (0.25, 0.5)  # the same in log brightness, at least: gaps between tiles are that dark too
NEVER = (1e6, 2e6)  # the same where nothing casts shadows
DARK, BRIGHT = 0.02, 0.98  # of the brightest channel: outside, no shading is measured
LIT = 0.98  # quantile of the fit that counts as fully lit, where the albedo is a guess
BY_NORMAL = 9  # terms of the fit that know the normal only
BY_PLACE = (
    0.6  # of the spread: light is taken to vary over the place only if it leaves no more than this
)
HOLLOW = (
    0.1  # of full light, per squared extent: by how much a lamp's pool of light may curve upwards
)
RIDGE = 1e-3
PASSES = 6  # of the robust fit


@dataclass(frozen=True)
class ShadedPixels:
    """Some pixels of one thing from several cameras and frames, 0..1, and where they lie in its body's frame."""

    color: Float32[np.ndarray, "n 3"]
    points: Float32[np.ndarray, "n 3"]
    normals: Float32[np.ndarray, "n 3"]
    facing: Float32[np.ndarray, "n 3"]


@memo.of_episode
def sample(
    episode: Episode, bodies: tuple[Body, ...], wanted: tuple[int, ...]
) -> dict[int, ShadedPixels]:
    """Pixels of each of the `wanted` instance ids that is seen at all. Raises SourceLacks if no camera has depth."""
    if all(surface.depth_of(view, 0) is None for view in episode.views.values()):
        raise SourceLacks("a texture needs recorded depth to lie on, and this source has none")
    parts: dict[int, list[tuple[np.ndarray, ...]]] = {
        instance_id: [] for instance_id in sorted(wanted)
    }
    for name, t, rgb, ids in sampling.images(episode, FRAMES):
        view = episode.views[name]
        if ids is None or (view.depth is None and surface.depth_of(view, t) is None):
            continue
        at = surface.of_view(view, t, bodies, ids)
        for instance_id in wanted:
            rows = np.flatnonzero(ids == instance_id)
            rows = rows[:: max(1, len(rows) // MOST_PIXELS)]
            if len(rows):
                here = at(rows)
                color = rgb.reshape(-1, 3)[rows].astype(np.float32) / 255
                parts[instance_id].append((color, here.points, here.normals, here.facing))
    return {
        instance_id: ShadedPixels(*(np.concatenate(part) for part in zip(*found, strict=True)))
        for instance_id, found in parts.items()
        if found
    }


@dataclass(frozen=True)
class Smooth:
    """Shading as a smooth function of place and normal, fitted to a patterned surface.

    `spread` is the old pattern's contrast: one standard deviation of log brightness about the fit. What is much darker
    lies in shadow where something `casts` any, and is pattern else.
    """

    middle: tuple[float, ...]
    extent: float
    weights: tuple[float, ...]
    spread: float
    level: float = 1.0  # of the shading that pixels measure, where the fit says 1
    casts: bool = True

    def fitted(self, points: np.ndarray, facing: np.ndarray) -> Float32[np.ndarray, "n"]:
        """The fit at places of the surface: of each place the same, whichever others are asked for."""
        middle, weights = (np.array(one, np.float32) for one in (self.middle, self.weights))
        return _fitted(
            points.astype(np.float32), facing.astype(np.float32), middle, self.extent, weights
        )

    def of(
        self, measured: Float32[np.ndarray, "n"], fitted: Float32[np.ndarray, "n"]
    ) -> Float32[np.ndarray, "n"]:
        """The shading where `measured` is what the pixels' brightness came to: without pattern, with shadows."""
        darker = np.log(np.maximum(measured / self.level, 1e-3) / fitted)
        low, high = self.shadows
        kept = np.clip((-darker - low) / (high - low), 0, 1)
        return (fitted * np.exp(kept * darker)).astype(np.float32)

    @property
    def shadows(self) -> tuple[float, float]:
        """By how much in log brightness a place may be, and is, darker than the fit where it lies in shadow."""
        if not self.casts:
            return NEVER
        low, high = (
            max(spreads * self.spread, least)
            for spreads, least in zip(SPREADS, SHADOW, strict=True)
        )
        return low, high

    def describe(self) -> dict[str, Any]:
        """Plain values, from which `Smooth(**values)` makes it again."""
        return {
            "middle": list(self.middle),
            "extent": self.extent,
            "weights": list(self.weights),
            "spread": self.spread,
            "level": self.level,
            "casts": self.casts,
        }


def describe(scene: Scene, instance_ids: Iterable[int], known: RGB | None = None) -> dict[str, Any]:
    """What an edit stores of each thing's surface (`surfaces`), as `albedo.describe` does; see `paintable`.

    An albedo's brightness is that of the best-lit pixels; where depth tells light from pattern, that of the best-lit
    part of the fit, since the brightest pixels of a patterned thing are its palest spots. Raises Unsupported.
    """
    episode = intrinsic.unshadowed(scene)
    found = _described(episode, scene.bodies, tuple(instance_ids), known)
    surfaces = [dict(one) for one in found["surfaces"]]
    if known is None:
        surfaces = [one | {"albedo": fully_lit(scene, one)} for one in surfaces]
    surfaces = [one | (_as_metal(one, known) if _metal(scene, one) else {}) for one in surfaces]
    if known is None and rig.unexplained(scene):
        surfaces = [one | {"in_shadow": True} for one in surfaces]
    return found | {"surfaces": surfaces}


def _metal(scene: Scene, surface: Mapping[str, Any]) -> bool:
    red, green, blue = surface["albedo"]
    return highlights.metallic(scene, surface["handle"], (red, green, blue))


def _as_metal(surface: Mapping[str, Any], known: RGB | None) -> dict[str, Any]:
    """What is stored of a metal: unless its color is known it has the hue that it shows, and is as bright as metals
    are, for how much of its light is mirrored its matte part does not tell."""
    if known is not None:
        return {"metal": True}
    brightest = max(surface["albedo"])
    gain = max(albedo.METAL / brightest, 1.0) if brightest else 1.0
    return {"metal": True, "of_metal": True, "albedo": [gain * one for one in surface["albedo"]]}


def fully_lit(scene: Scene, surface: Mapping[str, Any]) -> list[float]:
    """The albedo of a surface whose best-lit part lamps are known to light less than level ground."""
    best = intrinsic.best_light(scene, surface["handle"])
    return [min(value / best, 1.0) for value in surface["albedo"]]


def paintable(
    instance_ids: Iterable[int], described: Callable[[int], dict[str, Any]]
) -> dict[str, Any]:
    """The `surfaces` among these instances, and by instance id why one is `left_out` that cannot be painted.

    Masks may hold ids that fill no surface: stray pixels of the void. Raises Unsupported if nothing can be painted.
    """
    surfaces, left_out = [], {}
    for instance_id in instance_ids:
        try:
            surfaces.append(described(instance_id))
        except Unsupported as error:
            left_out[str(instance_id)] = str(error)
    if not surfaces:
        raise Unsupported("; ".join(left_out.values()))
    return {"surfaces": surfaces, **({"left_out": left_out} if left_out else {})}


@memo.of_episode
def _described(
    episode: Episode, bodies: tuple[Body, ...], instance_ids: tuple[int, ...], known: RGB | None
) -> dict[str, Any]:
    found = paintable(instance_ids, lambda one: albedo.describe(episode, one, known))
    deep = any(view.depth is not None for view in episode.views.values())
    if known is None and deep and not albedo.cut_off_known(episode):
        seen = sample(episode, bodies, instance_ids)
        for one in found["surfaces"]:
            here = seen.get(one["handle"])
            smooth = fit(here, tuple(one["albedo"]), known=False) if here else None
            if smooth:
                one["albedo"] = [min(value * smooth.level, 1.0) for value in one["albedo"]]
    return found


def fit(
    samples: ShadedPixels,
    color: tuple[float, float, float],
    known: bool = True,
    best_light: float = 1.0,
) -> Smooth | None:
    """The smooth shading of a patterned thing, or None if its brightness varies no more than its shading does.

    `color` is the thing's albedo. Unless it is `known`, its brightness is a guess, and the best-lit part is taken to
    have the `best_light`.
    """
    old = np.array(color)
    high = samples.color.max(1)
    good = (high > DARK) & (high < BRIGHT)
    if good.sum() < 60 or old.max() < DARK:
        return None
    points, facing = samples.points[good], samples.facing[good]
    shade = samples.color[good] @ old / (old @ old)
    low, top = np.percentile(points, [1, 99], axis=0)
    middle, extent = (low + top) / 2, max(float((top - low).max()), 1e-3)
    basis = _basis(points, facing, middle, extent).astype(float)
    weights, spread = _robust(basis[:, :BY_NORMAL], shade)
    everywhere, less = _robust(basis, shade)
    if less < BY_PLACE * spread and _falls_off(everywhere):
        weights, spread = everywhere, less
    else:
        weights = np.pad(weights, (0, basis.shape[1] - BY_NORMAL))
    if spread < PATTERN:
        return None
    level = 1.0 if known else max(float(np.quantile(basis @ weights, LIT)), 0.05) / best_light
    return Smooth(tuple(middle.tolist()), extent, tuple((weights / level).tolist()), spread, level)


def _falls_off(weights: Float64[np.ndarray, "15"]) -> bool:
    """Whether the fit curves downwards over the place, in every direction: brightest in one spot."""
    p, q, cross = weights[BY_NORMAL + 3 :]
    bend = np.linalg.eigvalsh([[2 * p, cross], [cross, 2 * q]])
    return bool(bend.max() < HOLLOW)


def _robust(
    basis: Float64[np.ndarray, "n k"], value: Float64[np.ndarray, "n"]
) -> tuple[Float64[np.ndarray, "k"], float]:
    """Least squares with Cauchy weights, since shadows and highlights are few and far off; and the log's spread."""
    trust = np.ones(len(value))
    weights = np.zeros(basis.shape[1])
    ridge = RIDGE * np.diag([0.0] + [1.0] * (basis.shape[1] - 1))
    for _ in range(PASSES):
        weighted = basis * trust[:, None]
        weights = np.linalg.solve(basis.T @ weighted + trust.sum() * ridge, weighted.T @ value)
        off = value - basis @ weights
        scale = 1.4826 * np.median(np.abs(off)) + 1e-4
        trust = 1 / (1 + (off / (2 * scale)) ** 2)
    residual = np.log(np.maximum(value, 1e-3) / np.maximum(basis @ weights, 0.02))
    return weights, 1.4826 * float(np.median(np.abs(residual - np.median(residual))))


def _basis(
    points: np.ndarray, facing: np.ndarray, middle: np.ndarray | tuple[float, ...], extent: float
) -> Float32[np.ndarray, "n 15"]:
    """Quadratic in the normal and, more loosely, in the place."""
    return _terms(
        points.astype(np.float32), facing.astype(np.float32), np.array(middle, np.float32), extent
    )


@kernel
def _terms(
    points: Float32[np.ndarray, "n 3"],
    facing: Float32[np.ndarray, "n 3"],
    middle: Float32[np.ndarray, "3"],
    extent: float,
) -> Float32[np.ndarray, "n 15"]:
    out = np.empty((len(points), 15), np.float32)
    for n in range(len(points)):
        _place_terms(points[n], facing[n], middle, extent, out[n])
    return out


@kernel
def _fitted(
    points: Float32[np.ndarray, "n 3"],
    facing: Float32[np.ndarray, "n 3"],
    middle: Float32[np.ndarray, "3"],
    extent: float,
    weights: Float32[np.ndarray, "15"],
) -> Float32[np.ndarray, "n"]:
    out, terms = np.empty(len(points), np.float32), np.empty(15, np.float32)
    for n in range(len(points)):
        _place_terms(points[n], facing[n], middle, extent, terms)
        total = np.float32(0)
        for k in range(15):
            total += terms[k] * weights[k]
        out[n] = max(total, np.float32(0.02))
    return out


@kernel
def _place_terms(point, facing, middle, extent, out):
    x, y, z = facing
    p, q, r = (point - middle) / np.float32(extent)
    out[0], out[1], out[2], out[3] = 1.0, x, y, z
    out[4], out[5], out[6] = x * y, y * z, z * x
    out[7], out[8] = x * x - y * y, 3 * z * z - 1
    out[9], out[10], out[11] = p, q, r
    out[12], out[13], out[14] = p * p, q * q, p * q


def frame(samples: Mapping[int, ShadedPixels]) -> Float64[np.ndarray, "4 4"]:
    """From the bodies' frame to one that suits the thing: its middle, its side faces along x and y, z up.

    The faces' bearing is the mean of their normals' with all quarter turns taken for the same; round things keep the
    world's.
    """
    points = np.concatenate([one.points for one in samples.values()])
    normals = np.concatenate([one.normals for one in samples.values()]).astype(float)
    low, high = np.percentile(points, [1, 99], axis=0)
    sides = normals[np.abs(normals[:, 2]) < 0.3]
    bearing = 0.0
    if len(sides):
        quarter = np.exp(4j * np.arctan2(sides[:, 1], sides[:, 0])).mean()
        bearing = float(np.angle(quarter)) / 4 if abs(quarter) > 0.5 else 0.0
    back = np.eye(4)
    cosine, sine = np.cos(bearing), np.sin(bearing)
    back[:2, :2] = [[cosine, sine], [-sine, cosine]]
    back[:3, 3] = -back[:3, :3] @ ((low + high) / 2)
    return back
