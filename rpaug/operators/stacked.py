"""Appearance edits of many images at once, by torch: what `stacked` of their classes gives.

Each takes colors (n, 3) in 0..1, which of the edits each row belongs to, and where the rows lie; it computes what the
edit itself does, in float32 as there.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int64
from torch import Tensor

from rpaug.assets.textures import batched
from rpaug.scene.lighting import albedo, shading

Color = Float32[Tensor, "n 3"]
Edited = Callable[[Color, Int64[Tensor, "n"], Any], Color]
NEVER = -(2**31)  # an instance id that no pixel has


def gains(several: Sequence[Any], device: torch.device) -> Edited:
    """`light_color.Gain`: colors times a gain each; what is unlit keeps its own."""
    gain = torch.tensor([edit.gain for edit in several], device=device)
    unlit = _table([edit.unlit for edit in several], device)

    def edited(color: Color, which: Int64[Tensor, "n"], surface: Any) -> Color:
        lit = (color * gain[which]).clamp(max=1)
        if not unlit.shape[1]:
            return lit
        kept = (surface.ids[:, None] == unlit[which]).any(1)
        return torch.where(kept[:, None], color, lit)

    return edited


def ratios(several: Sequence[Any], device: torch.device) -> Edited:
    """`recolor.AlbedoRatio`: colors with another albedo under their highlights."""
    old = torch.tensor([edit.old for edit in several], device=device)
    new = torch.tensor([edit.new for edit in several], device=device)
    plain = torch.tensor([edit.plain for edit in several], device=device)
    metal = torch.tensor([edit.metal for edit in several], device=device)
    hues = _hues([edit.hues for edit in several], device)
    part = _table([edit.part for edit in several], device)
    own = old / (old**2).sum(1, keepdim=True).clamp(min=1e-6)
    gain = (new / old.clamp(min=1e-6)).clamp(max=1)
    beneath = _beneath([edit.beneath for edit in several], device)

    def edited(color: Color, which: Int64[Tensor, "n"], surface: Any) -> Color:
        shine = shone(color, surface, old[which], plain[which], hues[which])
        shine = torch.where(metal[which][:, None], 0, shine)
        matte = color - shine
        shading = (matte * own[which]).sum(1, keepdim=True)
        painted = shading * new[which] + gain[which] * (matte - shading * old[which]) + shine
        painted = painted.clamp(0, 1)
        if not part.shape[1]:
            return painted
        owner = owners(color, hues[which])
        mine = (owner[:, None] == part[which]).any(1) | (part[which] == NEVER).all(1)
        return torch.where(mine[:, None], painted, beneath(color, which, surface))

    return edited


def _beneath(several: Sequence[Any], device: torch.device) -> Edited:
    """What each edit's paint beneath it makes of colors; of those without any, nothing."""
    kinds = []
    for kind in dict.fromkeys(type(one) for one in several if one is not None):
        rows = [n for n, one in enumerate(several) if type(one) is kind]
        place = torch.full((len(several),), -1, device=device)
        place[rows] = torch.arange(len(rows), device=device)
        kinds.append((place, kind.stacked([several[n] for n in rows], device)))

    def edited(color: Color, which: Int64[Tensor, "n"], surface: Any) -> Color:
        out = color
        for place, made in kinds:
            own = place[which]
            painted = made(color, own.clamp(min=0), surface)
            out = torch.where((own >= 0)[:, None], painted, out)
        return out

    return edited


def textures(several: Sequence[Any], device: torch.device) -> Edited:
    """`texturing.Textured`: colors of textures under the recorded light."""
    old = torch.tensor([edit.old for edit in several], device=device)
    own = old / (old**2).sum(1, keepdim=True).clamp(min=1e-4)
    patterned = torch.tensor([edit.smooth is not None for edit in several], device=device)
    plain = torch.tensor([edit.plain for edit in several], device=device) & ~patterned
    hues = _hues([()] * len(several), device)
    pose = np.stack([edit.to_texture for edit in several]).astype(np.float32)
    turn, shift = (torch.from_numpy(part).to(device) for part in (pose[:, :3, :3], pose[:, :3, 3]))
    laid = batched.LaidTextures.of(
        [(edit.texture, edit.scale, edit.mapping) for edit in several], device
    )
    smooth = _Smooths.of_edits([edit.smooth for edit in several], device)
    white = torch.tensor([edit.white for edit in several], device=device)

    def edited(color: Color, which: Int64[Tensor, "n"], surface: Any) -> Color:
        points = (turn[which] @ surface.points[:, :, None])[..., 0] + shift[which]
        normals = (turn[which] @ surface.normals[:, :, None])[..., 0]
        new = laid.on(which, points, normals, surface.footprint) * white[which]
        shine = shone(color, surface, old[which], plain[which], hues[which])
        shade = ((color - shine) * own[which]).sum(1)
        if smooth is not None:
            lit = surface.lit
            evened = smooth.of(which, shade / lit.clamp(min=0.02), surface.points, surface.facing)
            shade = torch.where(patterned[which], evened * lit, shade)
        return (new * shade[:, None] + shine).clamp(0, 1)

    return edited


@dataclass(frozen=True)
class _Smooths:
    """`shading.Smooth` of several edits; those that have none get anything."""

    middle: Float32[Tensor, "m 3"]
    extent: Float32[Tensor, "m"]
    weights: Float32[Tensor, "m 15"]
    low: Float32[Tensor, "m"]
    high: Float32[Tensor, "m"]
    level: Float32[Tensor, "m"]

    @classmethod
    def of_edits(
        cls, several: Sequence[shading.Smooth | None], device: torch.device
    ) -> "_Smooths | None":
        """None where none has any."""
        if not any(several):
            return None
        any_one = next(one for one in several if one)
        held = [one or any_one for one in several]

        def numbers(rows: Sequence[Any]) -> Tensor:
            return torch.tensor(rows, dtype=torch.float32, device=device)

        low, high = zip(*(one.shadows for one in held), strict=True)
        return cls(
            numbers([one.middle for one in held]),
            numbers([one.extent for one in held]),
            numbers([one.weights for one in held]),
            numbers(low),
            numbers(high),
            numbers([one.level for one in held]),
        )

    def of(
        self,
        which: Int64[Tensor, "n"],
        measured: Float32[Tensor, "n"],
        points: Color,
        facing: Color,
    ) -> Float32[Tensor, "n"]:
        """`shading.Smooth.of`."""
        x, y, z = facing.unbind(1)
        p, q, r = ((points - self.middle[which]) / self.extent[which, None]).unbind(1)
        one = torch.ones_like(x)
        by_normal = [one, x, y, z, x * y, y * z, z * x, x * x - y * y, 3 * z * z - 1]
        by_place = [p, q, r, p * p, q * q, p * q]
        fitted = (torch.stack(by_normal + by_place, 1) * self.weights[which]).sum(1).clamp(min=0.02)
        darker = torch.log((measured / self.level[which]).clamp(min=1e-3) / fitted)
        low, high = self.low[which], self.high[which]
        kept = ((-darker - low) / (high - low)).clamp(0, 1)
        return fitted * torch.exp(kept * darker)


def shone(
    color: Color,
    surface: Any,
    old: Color,
    plain: Bool[Tensor, "n"],
    hues: Float32[Tensor, "n k 3"],
) -> Color:
    """`albedo.shine`: the part of each color that is a highlight."""
    by_hue = torch.where(plain[:, None], white_part(color, old), highlights(color, hues))
    known = surface.mirrored
    if known is None:
        return by_hue.expand_as(color)
    return torch.where(torch.isnan(known), by_hue, torch.minimum(known, color))


def white_part(color: Color, old: Color) -> Float32[Tensor, "n 1"]:
    """`albedo.highlight`, each color by an albedo of its own."""
    a, b, c = (old**2).sum(1), old.sum(1), 3.0
    determinant = a * c - b * b
    told = determinant > albedo.HUELESS * a * c
    safe = torch.where(told, determinant, 1.0)
    part = a / safe * color.sum(1) - b / safe * (color * old).sum(1)
    part = torch.minimum(part, color.min(1).values)
    return torch.where(told & (part > albedo.HIGHLIGHT), part, 0.0)[:, None]


def highlights(color: Color, hues: Float32[Tensor, "n k 3"]) -> Float32[Tensor, "n 1"]:
    """`albedo.highlights`, each color by hues of its own; NaN is no hue."""
    least = torch.full_like(color[:, :1], torch.inf)
    for k in range(hues.shape[1]):
        part, explained = _lit(color, hues[:, k])
        least = torch.where(explained[:, None], torch.minimum(least, part), least)
    return torch.where(torch.isfinite(least), least, 0.0)


def owners(color: Color, hues: Float32[Tensor, "n k 3"]) -> Int64[Tensor, "n"]:
    """`albedo.owners`: which of the hues each pixel has."""
    costs = []
    for k in range(hues.shape[1]):
        hue = hues[:, k]
        shade = (color * hue).sum(1, keepdim=True) / (hue**2).sum(1, keepdim=True).clamp(min=1e-9)
        off = (color - shade * hue).norm(dim=1)
        part, explained = _lit(color, hue)
        near = off.clamp(max=albedo.PLAIN) + albedo.WHITER * part[:, 0]
        cost = torch.where(explained, near, off)
        costs.append(torch.where(torch.isnan(cost), torch.inf, cost))
    return torch.stack(costs, 1).argmin(1)


def _lit(color: Color, hue: Color) -> tuple[Float32[Tensor, "n 1"], Bool[Tensor, "n"]]:
    """The white part of each pixel, were it of its hue, and whether hue and white part explain it."""
    gray = 1 - hue.sum(1) ** 2 / (3 * (hue**2).sum(1)).clamp(min=1e-9) <= albedo.HUELESS
    near = torch.where(gray, albedo.GRAYISH, albedo.PLAIN)
    part = white_part(color, hue)
    matte = color - part
    shade = (matte * hue).sum(1) / (hue**2).sum(1).clamp(min=1e-9)
    off = (matte - shade[:, None] * hue).norm(dim=1)
    return part, (off < near) & ((part[:, 0] == 0) | (shade > albedo.MATTE))


def _table(rows: Sequence[Sequence[int]], device: torch.device) -> Int64[Tensor, "m k"]:
    """Numbers of several edits side by side, `NEVER` where one has fewer."""
    most = max(map(len, rows))
    padded = [[*row, *[NEVER] * (most - len(row))] for row in rows]
    return torch.tensor(padded, dtype=torch.int64, device=device).reshape(len(rows), most)


def _hues(
    several: Sequence[Sequence[tuple[float, float, float]]], device: torch.device
) -> Float32[Tensor, "m k 3"]:
    most = max(map(len, several))
    nothing = (float("nan"),) * 3
    padded = [[*hues, *[nothing] * (most - len(hues))] for hues in several]
    return torch.tensor(padded, dtype=torch.float32, device=device).reshape(len(several), most, 3)
