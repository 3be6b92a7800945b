"""The light an episode was recorded in: its color, read off grey surfaces, and where its lamp stands."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int

from rpaug.core import memo, sampling, white
from rpaug.core.errors import SourceLacks
from rpaug.core.types import Episode
from rpaug.scene.recorded import surface

LAMP = 0.5  # COLOSSEUM's scenes: each lamp's diffuse color is (0.5, 0.5, 0.5) before it is varied
BRIGHTEST = 0.995  # quantile of an image's brightest channel: more is highlights

DIRECTIONS = 300
AMBIENTS = (0.1, 0.2, 0.3, 0.45, 0.6, 0.75)
PIXELS = 500  # of one image
WELL_LIT = 0.98  # quantile of a thing's pixels


def estimate(episode: Episode) -> Float64[np.ndarray, "3"]:
    """The lamps' color, in COLOSSEUM's unit where white recorded light is (0.5, 0.5, 0.5).

    Only the chromaticity is measured: a brightness cannot be told from albedos.
    """
    return LAMP * white.hue(episode)


@memo.last
def headroom(episode: Episode, count: int = 3) -> float:
    """The factor by which light may grow until the brightest that an episode shows is white."""
    images = (rgb for _, _, rgb, _ in sampling.images(episode, count))
    white = max(float(np.quantile(rgb.max(-1), BRIGHTEST)) for rgb in images)
    return max(255.0 / max(white, 1.0), 1.0)


@memo.of_episode
def unlit(episode: Episode, count: int = 3) -> tuple[int, ...]:
    """Instance ids that no lamp lights, ascending: a renderer's sky, which fills no surface.

    All of its pixels lie at the greatest depth of their image, exactly, in images from two places or more. Empty
    without depth or masks.
    """
    places: dict[int, set[bytes]] = {}
    surfaces: set[int] = set()
    for view in episode.views.values():
        if view.depth is None or view.ids is None:
            continue
        for t in sampling.frames(episode.length, count):
            depth, ids = view.depth(t), view.ids(t)
            far = depth == depth.max()
            surfaces.update(np.unique(ids[~far]).tolist())
            for one in np.unique(ids[far]).tolist():
                places.setdefault(one, set()).add(view.camera.cam_to_world[t].tobytes())
    return tuple(
        sorted(one for one, seen in places.items() if one not in surfaces and len(seen) > 1)
    )


@dataclass(frozen=True)
class Lamp:
    """One lamp far away: pixel = albedo x (ambient + (1 - ambient) max(0, normal . direction)).

    `direction` points to the lamp, a unit vector in the world. `explained` is the share of the things' variation in
    brightness that this model explains: near 0, the direction means little.
    """

    direction: tuple[float, float, float]
    ambient: float
    explained: float

    def shading(self, facing: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Light on surfaces of these normals, 1 where the lamp is straight above them."""
        towards = np.maximum(facing @ np.array(self.direction, facing.dtype), 0)
        return self.ambient + (1 - self.ambient) * towards


@memo.last
def dominant(
    episode: Episode, direction: tuple[float, float, float] | None = None, count: int = 3
) -> Lamp:
    """The one lamp that explains best how things' brightness depends on where their faces turn (Lambert's law).

    Every direction of a grid over the upper half space is tried with several shares of ambient light; each thing has
    one albedo, fitted along. Where the lamp's `direction` is known, only its share is told. Raises SourceLacks without
    depth.
    """
    facing, level, things = seen(episode, count)
    _, owner = np.unique(things, return_inverse=True)
    level = level / (np.bincount(owner, level) / np.bincount(owner))[owner]
    axes = _upper_half() if direction is None else np.array([direction])
    towards = np.maximum(facing @ axes.T, 0)
    best = (np.inf, 0, 0.0)
    for ambient in AMBIENTS:
        light = ambient + (1 - ambient) * towards
        for index in range(len(axes)):
            shade = light[:, index]
            across = np.bincount(owner, shade * level) / np.bincount(owner, shade * shade)
            off = float(np.abs(level - across[owner] * shade).sum())
            if off < best[0]:
                best = (off, index, ambient)
    explained = 1 - best[0] / max(float(np.abs(level - 1).sum()), 1e-9)
    x, y, z = axes[best[1]].tolist()
    return Lamp((x, y, z), best[2], explained)


def brightest(episode: Episode, lamp: Lamp, count: int = 3) -> dict[int, float]:
    """Per thing, the mean of the channels that its well-lit parts would have straight below the lamp."""
    facing, level, things = seen(episode, count)
    albedo = level / lamp.shading(facing)
    return {int(h): float(np.quantile(albedo[things == h], WELL_LIT)) for h in np.unique(things)}


@memo.last
def seen(
    episode: Episode, count: int
) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n"], Int[np.ndarray, "n"]]:
    """World normals, brightness and instance id of some pixels. Raises SourceLacks without depth."""
    normals, light, things = [], [], []
    for name, t, rgb, ids in sampling.images(episode, count):
        view = episode.views[name]
        if view.depth is None:
            continue
        lit = True if ids is None else ~np.isin(ids, unlit(episode))
        known = np.flatnonzero((view.depth(t) > 0) & lit)
        rows = known[:: max(1, len(known) // PIXELS)]
        here = surface.of_view(view, t, (), ids)(rows)
        color = rgb.reshape(-1, 3)[rows] / 255.0
        good = (color.max(1) > 0.03) & (color.max(1) < 0.97)
        normals.append(here.facing[good].astype(float))
        light.append(color.mean(1)[good])
        things.append(here.ids[good])
    if not normals or not sum(map(len, light)):
        raise SourceLacks("light is told by surfaces, and this source has no depth to know them by")
    return np.concatenate(normals), np.concatenate(light), np.concatenate(things)


def _upper_half() -> Float64[np.ndarray, "n 3"]:
    """Directions spread evenly over the upper half space (a Fibonacci lattice)."""
    number = np.arange(DIRECTIONS) + 0.5
    z = number / DIRECTIONS
    turn = np.pi * (1 + 5**0.5) * number
    flat = np.sqrt(1 - z * z)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], -1)
