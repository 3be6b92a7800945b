"""Outline pixels of many images, taken apart as `rpaug.render.matting` does it for one: all of them side by side.

Only pixels with one of their 8 neighbours across the outline can be mixed, so that these alone are listed; costs are
compared in float64 as there.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Float32
from torch import Tensor

from rpaug.render import matting
from rpaug.render.batched.pixels import Pixels, neighbours, offsets

AT_ONCE = (
    1 << 15
)  # outline pixels whose pairs of colors are weighed together: 256 pairs each, a few numbers a pair
ROUND = tuple((j, i) for j in (-1, 0, 1) for i in (-1, 0, 1))


@dataclass(frozen=True)
class Outline:
    """The pixels of outlines, how much of each its thing covers, 0..1, and the thing's own color there."""

    at: Pixels
    share: Float32[Tensor, "n"]
    foreground: Float32[Tensor, "n 3"]


def rim(inside: Bool[Tensor, "m h w"]) -> Bool[Tensor, "m h w"]:
    """Pixels with an 8-neighbour on the other side of the outline."""
    shown = inside[:, None].float()
    grown = torch.nn.functional.max_pool2d(shown, 3, 1, 1)
    shrunk = -torch.nn.functional.max_pool2d(-shown, 3, 1, 1)
    return (grown != shrunk)[:, 0]


def outline(color: Float32[Tensor, "m h w 3"], inside: Bool[Tensor, "m h w"]) -> Outline:
    """`rpaug.render.matting.matte` of each image, where its outlines are."""
    edge = rim(inside)
    every = Pixels.where(edge)
    palette = _palettes(color, inside, edge)
    shares, foregrounds = [], []
    for start in range(0, len(every), AT_ONCE):
        some = every[start : start + AT_ONCE]
        share, foreground = _taken_apart(color, inside, edge, palette, some)
        shares.append(share)
        foregrounds.append(foreground)
    if not shares:
        return Outline(every, color.new_zeros(0), color.new_zeros(0, 3))
    return Outline(every, torch.cat(shares), torch.cat(foregrounds))


def _taken_apart(
    color: Float32[Tensor, "m h w 3"],
    inside: Bool[Tensor, "m h w"],
    edge: Bool[Tensor, "m h w"],
    palette: Float[Tensor, "m hues 3"],
    at: Pixels,
) -> tuple[Float32[Tensor, "n"], Float32[Tensor, "n 3"]]:
    """Shares and own colors of some outline pixels."""
    here, held = at.of(color).double(), at.of(inside)
    front, front_cost = _candidates(color, inside, edge, at, side=True)
    back, back_cost = _candidates(color, inside, edge, at, side=False)
    prior = _prior(inside, at)
    cost, part, light = _explained(here, front, back, prior)
    cost = cost + front_cost[:, :, None] + back_cost[:, None, :]
    rows = torch.arange(len(at), device=color.device)
    pair = cost.flatten(1).argmin(1)
    f, b = pair // back.shape[1], pair % back.shape[1]
    best = cost[rows, f, b]
    unmixed = matting.WEIGHT * (held.double() - prior) ** 2 + matting.UNMIXED
    mixed = best < unmixed
    share = torch.where(mixed, part[rows, f, b], held.double())
    own = _own(here, front[rows, f], back[rows, b], share, light[rows, f, b])
    foreground = torch.where(mixed[:, None], own, here)
    least = torch.where(mixed, best, unmixed)
    hues = palette[at.image]
    for p in range(hues.shape[1]):
        for q in range(p):
            one, other = hues[:, p], hues[:, q]
            tried, a, c = _explained_by_two(here, one, other, back, prior)
            tried = torch.where(torch.isfinite(back_cost), tried, torch.inf)
            cost, b = tried.min(1)
            a, c = a[rows, b], c[rows, b]
            better = cost < least  # never where a palette is short: NaN compares as false
            least = torch.where(better, cost, least)
            share = torch.where(better, a + c, share)
            blend = (a[:, None] * one + c[:, None] * other) / (a + c)[:, None]
            foreground = torch.where(better[:, None], blend, foreground)
    return share.float(), foreground.float()


def _palettes(
    color: Float32[Tensor, "m h w 3"], inside: Bool[Tensor, "m h w"], edge: Bool[Tensor, "m h w"]
) -> Float[Tensor, "m hues 3"]:
    """Up to `HUES` colors of each image's thing that differ most, NaN where there are fewer."""
    flat = color.flatten(1, 2)
    free = (inside & ~edge).flatten(1)
    images = torch.arange(len(flat), device=color.device)
    first = free.to(torch.uint8).argmax(1)
    palette = flat.new_full((len(flat), matting.HUES, 3), torch.nan)
    known = free.any(1)
    palette[:, 0] = torch.where(known[:, None], flat[images, first], torch.nan)
    away = torch.where(free, torch.inf, -torch.inf)
    for count in range(1, matting.HUES):
        off = ((flat - palette[:, count - 1, None]).double() ** 2).sum(-1)
        away = torch.minimum(away, torch.where(free, off, -torch.inf))
        farthest, place = away.max(1)
        known = known & (farthest > matting.LEAST_HUE)
        palette[:, count] = torch.where(known[:, None], flat[images, place], torch.nan)
    return palette.double()


def _prior(inside: Bool[Tensor, "m h w"], at: Pixels) -> Float[Tensor, "n"]:
    """Share of the pixel that the mask's neighbourhood suggests: a 3 x 3 binomial filter."""
    around, known = neighbours(at, torch.tensor(ROUND, device=inside.device), inside.shape[1:])
    weight = torch.tensor(
        [(2.0 - abs(j)) * (2.0 - abs(i)) for j, i in ROUND],
        dtype=torch.float64,
        device=inside.device,
    )
    weight = weight * known
    return (weight * around.of(inside)).sum(1) / weight.sum(1)


def _candidates(
    color: Float32[Tensor, "m h w 3"],
    inside: Bool[Tensor, "m h w"],
    edge: Bool[Tensor, "m h w"],
    at: Pixels,
    side: bool,
) -> tuple[Float[Tensor, "n k 3"], Float[Tensor, "n k"]]:
    """The colors of the nearest pixels of one side, unmixed ones and ones on the outline, and what each costs:
    infinite for a place that is not taken."""
    around, known = neighbours(at, offsets(matting.REACH, inside.device), inside.shape[1:])
    mine, mixed = (around.of(inside) == side) & known, around.of(edge)
    order = torch.arange(around.row.shape[1], device=inside.device, dtype=torch.float32)
    colors, costs = [], []
    for kind, most in ((False, matting.MOST), (True, matting.MIXED)):
        chosen = mine & (mixed == kind)
        place = torch.where(chosen, order, torch.inf).topk(most, dim=1, largest=False)
        taken = torch.isfinite(place.values)
        colors.append(around.pick(place.indices).of(color))
        cost = torch.full_like(place.values, matting.BLUR * kind, dtype=torch.float64)
        costs.append(torch.where(taken, cost, torch.inf))
    return torch.cat(colors, 1).double(), torch.cat(costs, 1)


def _explained(
    here: Float[Tensor, "n 3"],
    front: Float[Tensor, "n f 3"],
    back: Float[Tensor, "n b 3"],
    prior: Float[Tensor, "n"],
) -> tuple[Float[Tensor, "n f b"], Float[Tensor, "n f b"], Float[Tensor, "n f b"]]:
    """Costs, shares and lights of the best mixtures of every pair of colors (`rpaug.render.matting._explain`)."""
    rest = here[:, None] - back
    ff = (front**2).sum(-1)[:, :, None]
    fb = front @ back.transpose(1, 2)
    bb = (back**2).sum(-1)[:, None, :]
    fd = front @ rest.transpose(1, 2)
    bd = (back * rest).sum(-1)[:, None, :]
    prior = prior[:, None, None]
    steady = matting.SHADING * ff + 1e-6
    own, cross, other = ff + steady, fb + steady, bb + steady + matting.WEIGHT
    right = matting.WEIGHT * prior - bd
    part = ((own * right + cross * fd) / (own * other - cross * cross)).clamp(0, 1)
    lit = torch.minimum(2 * part, ((fd + cross * part) / own).clamp(min=0))
    cost = matting.WEIGHT * (part - prior) ** 2 + steady * (lit - part) ** 2
    for c in range(3):
        behind = (1 - part) * back[:, None, :, c]
        cost = cost + (here[:, None, None, c] - lit * front[:, :, None, c] - behind) ** 2
    return cost, part, torch.where(part > 0, lit / part, 1.0)


def _explained_by_two(
    here: Float[Tensor, "n 3"],
    one: Float[Tensor, "n 3"],
    other: Float[Tensor, "n 3"],
    back: Float[Tensor, "n b 3"],
    prior: Float[Tensor, "n"],
) -> tuple[Float[Tensor, "n b"], Float[Tensor, "n b"], Float[Tensor, "n b"]]:
    """Costs and shares of the best mixtures of two colors of the thing and one behind; infinite if there is none."""
    f, g, rest = one[:, None] - back, other[:, None] - back, here[:, None] - back
    weight, prior = matting.WEIGHT, prior[:, None]
    aa, ac, cc = (f * f).sum(-1) + weight, (f * g).sum(-1) + weight, (g * g).sum(-1) + weight
    da, dc = (f * rest).sum(-1) + weight * prior, (g * rest).sum(-1) + weight * prior
    determinant = aa * cc - ac * ac
    a, c = (da * cc - dc * ac) / determinant, (dc * aa - da * ac) / determinant
    fits = (determinant >= 1e-6) & (a >= 0) & (c >= 0) & (a + c <= 1) & (a + c >= 1e-3)
    left = rest - a[..., None] * f - c[..., None] * g
    cost = weight * (a + c - prior) ** 2 + matting.PAIR + (left**2).sum(-1)
    return torch.where(fits, cost, torch.inf), a, c


def _own(
    here: Float[Tensor, "n 3"],
    front: Float[Tensor, "n 3"],
    back: Float[Tensor, "n 3"],
    part: Float[Tensor, "n"],
    light: Float[Tensor, "n"],
) -> Float[Tensor, "n 3"]:
    """The thing's color at each pixel: the sampled one, moved by its part of what the mixture leaves over."""
    part = part[:, None]
    f = light[:, None] * front
    left = here - part * f - (1 - part) * back
    return (f + left * part / (part**2 + (1 - part) ** 2)).clamp(0, 1)


def nearest(inside: Bool[Tensor, "m h w"], at: Pixels) -> Pixels:
    """The pixel itself if it is inside, else the neighbour that is, straight ones first."""
    order = sorted(ROUND, key=lambda off: abs(off[0]) + abs(off[1]))
    around, known = neighbours(at, torch.tensor(order, device=inside.device), inside.shape[1:])
    mine = around.of(inside) & known
    place = torch.where(mine.any(1), mine.to(torch.uint8).argmax(1), 0)
    return around.pick(place[:, None])[:, 0]
