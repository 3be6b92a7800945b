"""Stylise one thing by nearest neighbour feature matching (ARF, Zhang et al. 2022, arXiv 2206.06360), in 3D.

As in RoboPearls (arXiv 2506.22756): only the colours of the target's own Gaussians are optimised. Each step renders one
recorded view and shows its target to VGG16; every feature there is drawn to the most similar one of the style's
picture, while another term holds the pixels outside the target to what was recorded.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Float64, Int, UInt8
from torch import Tensor
from torch.nn import functional

from rpaug.errors import TargetError, Unsupported
from rpaug.providers.features import LEAST, VGG16
from rpaug.scene.painting import Painting
from rpaug.scene.windows import Window, colours_of, render, samples, windows
from rpaug.types import Scene

LAYERS = ("conv3_1", "conv3_2", "conv3_3")  # ARF's choice
COVERED = 0.5  # share of a feature's cell that is the target's, for it to count
BROAD = 6.0  # pixels over which the old brightness is taken for light
LIGHT = (0.25, 1.5)  # how much darker or brighter than the target's mean light may be
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
DIRECTIONS = 8  # on which colours are compared with the palette, a step


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How a target is stylised. `palette` False keeps the target's own colours as far as the features let it.

    `light` is the share (a power) of the old brightness, smoothed, that the new colours keep. `size` is what the
    target's longer side is enlarged to, and `picture` the style's, in pixels, before VGG16 sees them. The weights stand
    beside the matching term, which is a mean cosine distance.
    """

    steps: int = 160
    size: int = 128
    picture: int = 192
    frames: int = 2  # times that each camera is looked at
    rate: float = 0.03  # of colours in 0..1, in a step of Adam
    last_rate: float = 0.1  # share of it left at the end (cosine schedule)
    outside: float = 30.0  # weight of the mean squared error outside the target
    palette: float = 8.0  # weight of the squared distance to the style's distribution of colours
    light: float = 0.5


@dataclass(frozen=True)
class Loss:
    """The terms of one step, unweighted."""

    match: float
    outside: float
    palette: float


@dataclass(frozen=True)
class Styled:
    """Old and new colours of the Gaussians `rows`, 0..1, as they look in even light, and how the loss went."""

    rows: Int[np.ndarray, "m"]
    old: Float32[np.ndarray, "m 3"]
    new: Float32[np.ndarray, "m 3"]
    windows: tuple[Window, ...]
    losses: tuple[Loss, ...]


@dataclass(frozen=True)
class Style:
    """What the target is drawn to: unit features of the picture, and its colours in order along any direction."""

    features: Float[Tensor, "c n"]
    colours: Float[Tensor, "p 3"]


def stylise(
    scene: Scene,
    handles: frozenset[int],
    picture: UInt8[np.ndarray, "h w 3"],
    network: VGG16,
    seed: int,
    settings: Settings | None = None,
) -> Styled:
    """New colours of the target's Gaussians. The seed draws where the pattern begins and the order of the views.

    Raises Unsupported for a scene without Gaussians, TargetError where no camera shows enough of the target.
    """
    settings = settings or Settings()
    if scene.gaussians is None:
        raise Unsupported("stylising needs Gaussians, and this scene has none")
    rows = np.flatnonzero(np.isin(scene.gaussians.ids, list(handles)))
    looked = windows(scene, handles, rows, settings.frames)
    if not len(rows) or not looked:
        raise TargetError("stylising: no camera shows enough of the target")
    old = colours_of(scene.gaussians.sh[rows])
    style = _style(network, picture, settings.picture)
    light = torch.from_numpy(_light(scene, looked, rows, old) ** settings.light)[:, None]
    rng = np.random.default_rng(seed)
    free = torch.from_numpy(_begin(rng, old, style, settings)).requires_grad_()
    adam = torch.optim.Adam([free], settings.rate)
    losses: list[Loss] = []
    order: list[int] = []
    for step in range(settings.steps):
        order = order or rng.permutation(len(looked)).tolist()
        window = looked[order.pop()]
        for group in adam.param_groups:
            group["lr"] = settings.rate * _cosine(step / settings.steps, settings.last_rate)
        directions = torch.from_numpy(rng.standard_normal((3, DIRECTIONS)).astype(np.float32))
        total, terms = _loss(network, window, rows, free * light, style, directions, settings)
        adam.zero_grad()
        total.backward()
        adam.step()
        with torch.no_grad():
            free.clamp_(0, 1)
        losses.append(terms)
    new = (free * light).detach().numpy()
    return Styled(rows, old, new, tuple(looked), tuple(losses))


def painting(scene: Scene, styled: Styled) -> Painting:
    """Old and new colours (rgb and rgb) where the views saw the target, in its body's frame."""
    both = np.concatenate([styled.old, styled.new], -1)
    return Painting.of(*samples(scene, styled.windows, styled.rows, both))


def matching(seen: Float[Tensor, "c n"], wanted: Float[Tensor, "c m"]) -> Float[Tensor, ""]:
    """Mean cosine distance of features to the nearest of the wanted ones, which are unit vectors (ARF, equation 1)."""
    unit = seen / (seen.norm(dim=0, keepdim=True) + 1e-8)
    with torch.no_grad():
        nearest = (wanted.T @ unit).argmax(0)
    return 1 - (unit * wanted[:, nearest]).sum(0).mean()


def palette(
    colours: Float[Tensor, "n 3"], wanted: Float[Tensor, "p 3"], directions: Float[Tensor, "3 d"]
) -> Float[Tensor, ""]:
    """Squared Wasserstein distance between distributions of colours, sliced along directions (Rabin et al. 2011)."""
    unit = directions / directions.norm(dim=0, keepdim=True)
    mine, other = (colours @ unit).sort(0).values, (wanted @ unit).sort(0).values
    at = (torch.arange(len(mine)) + 0.5) * (len(other) / len(mine))
    return ((mine - other[at.long()]) ** 2).mean()


def _loss(
    network: VGG16,
    window: Window,
    rows: Int[np.ndarray, "m"],
    colours: Float[Tensor, "m 3"],
    style: Style,
    directions: Float[Tensor, "3 d"],
    settings: Settings,
) -> tuple[Tensor, Loss]:
    image = render(window, rows, colours)
    recorded, inside = torch.from_numpy(window.recorded), torch.from_numpy(window.mask)
    # Outside the target VGG16 sees the recording, where no gradient leads.
    shown = torch.where(inside[..., None], image, recorded)
    match = matching(_within(network, shown, inside, settings.size), style.features)
    outside = ((image - recorded)[~inside] ** 2).sum() / max(1, 3 * int((~inside).sum()))
    total = match + settings.outside * outside
    apart = torch.zeros(())
    if settings.palette:
        apart = palette(image[inside], style.colours, directions)
        total = total + settings.palette * apart
    return total, Loss(*(float(term.detach()) for term in (match, outside, apart)))


def _within(
    network: VGG16, image: Float[Tensor, "h w 3"], inside: Bool[Tensor, "h w"], size: int
) -> Float[Tensor, "c n"]:
    """Features of the cells that the target covers, its picture enlarged to `size`."""
    stack = _resized(image.permute(2, 0, 1)[None], size)
    found = network.features(stack, LAYERS)
    cells = torch.cat([found[layer] for layer in LAYERS], 1)[0]
    share = functional.interpolate(inside[None, None].float(), cells.shape[1:], mode="area")[0, 0]
    covered = share >= min(COVERED, float(share.max()))
    return cells[:, covered]


def _style(network: VGG16, picture: UInt8[np.ndarray, "h w 3"], size: int) -> Style:
    image = torch.from_numpy(picture.astype(np.float32) / 255).permute(2, 0, 1)[None]
    image = _resized(image, size)
    with torch.no_grad():
        found = network.features(image, LAYERS)
        cells = torch.cat([found[layer] for layer in LAYERS], 1)[0].flatten(1)
        unit = cells / (cells.norm(dim=0, keepdim=True) + 1e-8)
    return Style(unit, image[0].flatten(1).T.contiguous())


def _resized(image: Float[Tensor, "1 c h w"], size: int) -> Float[Tensor, "1 c y x"]:
    factor = size / max(image.shape[2:])
    shape = [max(LEAST, round(side * factor)) for side in image.shape[2:]]
    return functional.interpolate(image, shape, mode="bilinear", antialias=True)


def _begin(
    rng: np.random.Generator, old: Float32[np.ndarray, "m 3"], style: Style, settings: Settings
) -> Float32[np.ndarray, "m 3"]:
    """Colours to start from: drawn from the style's at random, or the target's own, in disorder."""
    if not settings.palette:
        return np.clip(old + rng.normal(0, 0.1, old.shape), 0, 1).astype(np.float32)
    return style.colours.numpy()[rng.integers(len(style.colours), size=len(old))]


def _light(
    scene: Scene,
    looked: list[Window],
    rows: Int[np.ndarray, "m"],
    old: Float32[np.ndarray, "m 3"],
) -> Float32[np.ndarray, "m"]:
    """How bright each Gaussian's neighbourhood was beside the whole target: 1 on average."""
    assert scene.gaussians is not None
    ids, points, colours, width = samples(scene, looked, rows, old)
    bright = np.maximum(colours @ LUMINANCE, 1e-3)
    map = Painting.of(ids, points, bright[:, None], BROAD * width)
    own, means = scene.gaussians.ids[rows], scene.gaussians.means[rows]
    found, weight = map.at(own, means, np.full(len(rows), map.cell, np.float32))
    relative = np.where(weight > 0, found[:, 0], bright.mean()) / bright.mean()
    return np.clip(relative, *LIGHT).astype(np.float32)


def _cosine(done: float, last: float) -> float:
    return last + (1 - last) * 0.5 * (1 + math.cos(math.pi * done))
