"""Stylise one thing by nearest neighbour feature matching (ARF, Zhang et al. 2022, arXiv 2206.06360), in 3D.

As in RoboPearls (arXiv 2506.22756): only the colors of the target's own Gaussians are optimised. Each step renders one
recorded view and shows its target to VGG16; every feature there is drawn to the most similar one of the style's
picture, while another term holds the pixels outside the target to what was recorded.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float32, Int, UInt8
from torch import Tensor
from torch.nn import functional

from rpaug.core.errors import TargetError, Unsupported
from rpaug.core.types import Scene
from rpaug.gaussians.cells import Cells
from rpaug.gaussians.painting import Painting
from rpaug.gaussians.windows import TargetWindow, colors_of, render, samples, windows
from rpaug.providers.features import LEAST, VGG16

LAYERS = ("conv3_1", "conv3_2", "conv3_3")  # ARF's choice
COVERED = 0.5  # share of a feature's cell that is the target's, for it to count
BROAD = 6.0  # pixels over which the old brightness is taken for light
LIT = 0.9  # quantile of the old brightness that is taken for full light
DARKEST = 0.1  # of full light
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
DIRECTIONS = 8  # on which colors are compared with the palette, a step


@dataclass(frozen=True, kw_only=True)
class StyleSettings:
    """How a target is stylised.

    `light` is the share (a power) of the old brightness, smoothed, that the new colors keep. `size` is what the
    target's longer side is enlarged to, and `picture` the style's, in pixels, before VGG16 sees them. The weights stand
    beside the matching term, which is a mean cosine distance.
    """

    steps: int = 120
    size: int = 128
    picture: int = 192
    frames: int = 2  # times that each camera is looked at
    rate: float = 0.05  # of colors in 0..1, in a step of Adam
    last_rate: float = 0.1  # share of it left at the end (cosine schedule)
    outside: float = 30.0  # weight of the mean squared error outside the target
    palette: float = 8.0  # weight of the squared distance to the style's distribution of colors
    light: float = 0.7


@dataclass(frozen=True)
class StyleLoss:
    """The terms of one step, unweighted."""

    match: float
    outside: float
    palette: float


@dataclass(frozen=True)
class Styled:
    """What came of it: `old` and `new` give the colors 0..1 of a place on the bodies, as they look in even light.

    `colors` are the new ones of the Gaussians `rows`. `losses` are those of each step.
    """

    old: Painting
    new: Painting
    rows: Int[np.ndarray, "m"]
    colors: Float32[np.ndarray, "m 3"]
    windows: tuple[TargetWindow, ...]
    losses: tuple[StyleLoss, ...]


@dataclass(frozen=True)
class Style:
    """What the target is drawn to: unit features of the picture, and its colors in order along any direction."""

    features: Float[Tensor, "c n"]
    colors: Float[Tensor, "p 3"]


def stylise(
    scene: Scene,
    instance_ids: frozenset[int],
    picture: UInt8[np.ndarray, "h w 3"],
    network: VGG16,
    seed: int,
    settings: StyleSettings | None = None,
) -> Styled:
    """New colors of the target's Gaussians. The seed draws where the pattern begins and the order of the views.

    Raises Unsupported for a scene without Gaussians, TargetError where no camera shows enough of the target.
    """
    settings = settings or StyleSettings()
    if scene.gaussians is None:
        raise Unsupported("stylising needs Gaussians, and this scene has none")
    rows = np.flatnonzero(np.isin(scene.gaussians.ids, list(instance_ids)))
    looked = windows(scene, instance_ids, rows, settings.frames)
    if not len(rows) or not looked:
        raise TargetError("stylising: no camera shows enough of the target")
    cells = Cells.of(scene.gaussians, rows, looked)
    style = style_of(network, picture, settings.picture)
    old, before = _before(scene, looked, rows, cells)
    light = torch.from_numpy(before**settings.light)[:, None]
    rng = np.random.default_rng(seed)
    free = torch.from_numpy(cells.blotches(rng, style.colors.numpy())).requires_grad_()
    adam = torch.optim.Adam([free], settings.rate)
    losses: list[StyleLoss] = []
    order: list[int] = []
    for step in range(settings.steps):
        order = order or rng.permutation(len(looked)).tolist()
        number = order.pop()
        for group in adam.param_groups:
            group["lr"] = settings.rate * cosine(step / settings.steps, settings.last_rate)
        image = render(looked[number], rows, cells.gaussians(free * light))
        surface = cells.pixels[number](free * light)
        seen = _within(network, looked[number], image, surface, settings.size)
        match, outside = matching(seen, style.features), _outside(looked[number], image)
        directions = torch.from_numpy(rng.standard_normal((3, DIRECTIONS)).astype(np.float32))
        apart = palette(free, style.colors, directions)
        adam.zero_grad()
        (match + settings.outside * outside + settings.palette * apart).backward()
        adam.step()
        with torch.no_grad():
            free.clamp_(0, 1)
        losses.append(StyleLoss(*(float(term.detach()) for term in (match, outside, apart))))
    with torch.no_grad():
        new = free * light
        colors = cells.gaussians(new).numpy()
    painted = Painting.of(cells.ids, cells.points, new.numpy(), cells.width)
    return Styled(old, painted, rows, colors, tuple(looked), tuple(losses))


def matching(seen: Float[Tensor, "c n"], wanted: Float[Tensor, "c m"]) -> Float[Tensor, ""]:
    """Mean cosine distance of features to the nearest of the wanted ones, which are unit vectors (ARF, equation 1)."""
    unit = seen / (seen.norm(dim=0, keepdim=True) + 1e-8)
    with torch.no_grad():
        nearest = (wanted.T @ unit).argmax(0)
    return 1 - (unit * wanted[:, nearest]).sum(0).mean()


def palette(
    colors: Float[Tensor, "n 3"], wanted: Float[Tensor, "p 3"], directions: Float[Tensor, "3 d"]
) -> Float[Tensor, ""]:
    """Squared Wasserstein distance between distributions of colors, sliced along directions (Rabin et al. 2011)."""
    unit = directions / directions.norm(dim=0, keepdim=True)
    mine, other = (colors @ unit).sort(0).values, (wanted @ unit).sort(0).values
    at = (torch.arange(len(mine)) + 0.5) * (len(other) / len(mine))
    return ((mine - other[at.long()]) ** 2).mean()


def _outside(window: TargetWindow, image: Float[Tensor, "h w 3"]) -> Float[Tensor, ""]:
    """Mean squared error of the pixels that are not the target's."""
    other = ~torch.from_numpy(window.mask)
    apart = (image - torch.from_numpy(window.recorded))[other] ** 2
    return apart.sum() / max(1, apart.numel())


def _within(
    network: VGG16,
    window: TargetWindow,
    image: Float[Tensor, "h w 3"],
    surface: Float[Tensor, "p 3"],
    size: int,
) -> Float[Tensor, "c n"]:
    """Features of the cells that the target covers, its picture enlarged to `size`.

    The target is shown half by its Gaussians and half by its pixels; around it is the recording, where no gradient
    leads.
    """
    inside = torch.from_numpy(window.mask)
    shown = torch.from_numpy(window.recorded).clone()
    shown[inside] = (image[inside] + surface) / 2
    found = network.features(resized(shown.permute(2, 0, 1)[None], size), LAYERS)
    cells = torch.cat([found[layer] for layer in LAYERS], 1)[0]
    share = functional.interpolate(inside[None, None].float(), cells.shape[1:], mode="area")[0, 0]
    covered = share >= min(COVERED, float(share.max()))
    return cells[:, covered]


def style_of(network: VGG16, picture: UInt8[np.ndarray, "h w 3"], size: int) -> Style:
    """What a picture asks for, its longer side scaled to `size` pixels."""
    image = torch.from_numpy(picture.astype(np.float32) / 255).permute(2, 0, 1)[None]
    image = resized(image, size)
    with torch.no_grad():
        found = network.features(image, LAYERS)
        cells = torch.cat([found[layer] for layer in LAYERS], 1)[0].flatten(1)
        unit = cells / (cells.norm(dim=0, keepdim=True) + 1e-8)
    return Style(unit, image[0].flatten(1).T.contiguous())


def resized(image: Float[Tensor, "1 c h w"], size: int) -> Float[Tensor, "1 c y x"]:
    """The picture with its longer side scaled to `size` pixels."""
    factor = size / max(image.shape[2:])
    shape = [max(LEAST, round(side * factor)) for side in image.shape[2:]]
    return functional.interpolate(image, shape, mode="bilinear", antialias=True)


def _before(
    scene: Scene, looked: Sequence[TargetWindow], rows: Int[np.ndarray, "m"], cells: Cells
) -> tuple[Painting, Float32[np.ndarray, "m"]]:
    """The old colors of places on the target, and the light at each cell: the old brightness around it, 1 at most."""
    assert scene.gaussians is not None
    ids, points, colors = samples(looked, rows, colors_of(scene.gaussians.sh[rows]))
    bright = np.maximum(colors @ LUMINANCE, 1e-3)
    wide = Painting.of(ids, points, bright[:, None], BROAD * cells.width)
    found, weight = wide.at(cells.ids, cells.points, np.zeros(len(cells.points), np.float32))
    full = float(np.quantile(bright, LIT))
    light = np.clip(np.where(weight > 0, found[:, 0], full) / full, DARKEST, 1)
    return Painting.of(ids, points, colors, cells.width), light.astype(np.float32)


def cosine(done: float, last: float) -> float:
    """From 1 to `last` as `done` goes from 0 to 1 (Loshchilov and Hutter 2017)."""
    return last + (1 - last) * 0.5 * (1 + math.cos(math.pi * done))
